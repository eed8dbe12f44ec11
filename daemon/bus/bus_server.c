#include "bus.h"
#include "bus_client.h"

#include <errno.h>
#include <fcntl.h>
#include <gio/gunixsocketaddress.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

/*
 * GDBusServer is not used, for two reasons:
 * - If no more descriptors can be opened, GDBusServer tries again without pause and logs an error
 *   for each connection that it cannot accept.
 * - A client that does not authenticate itself keeps a thread for ever.
 */

#define RESERVED_PART 8  /* 1/8 of the descriptors is kept free for devices and files */
#define MAX_CLIENTS   64 /* largest number of connections of one process */
#define JOIN_S        10 /* time in seconds within which a client must have authenticated itself */
/* Maximum number of descriptors that GLib opens for a client while the client authenticates itself.
 * GLib aborts the program if it cannot open one. */
#define JOIN_FILES   4
#define AGAIN_MS     500
#define SAY_AGAIN_US (60 * G_USEC_PER_SEC)

struct BusServer {
    Bus *bus;
    char *path, *guid, *announced;
    GDBusAuthObserver *observer;
    GSocket *socket;
    /* Sources of the main loop, or 0 if a source is not attached. `waiting` is called when a client
     * connects. After a client could not be accepted, `waiting` is removed, and the timer `again`
     * attaches it again. */
    guint waiting, again;
    GList *clients; /* of struct client */
    gint64 said_us; /* time at which the log last got a warning from say(); 0 if never */
};

struct client {
    BusServer *server;
    pid_t pid;
    GSocketConnection *stream;
    GDBusConnection *connection; /* set by `thread` after authentication; NULL before */
    GThread *thread;             /* thread that authenticates the client; NULL after that */
    GSource *joined;             /* ready when the thread has finished */
    guint timer;
    gulong closed;
};

/* Allows only the authentication EXTERNAL, in which the kernel tells the user of the client.
 * Without this function, GDBus would also allow authentication by a cookie in the user's home
 * folder. */
static gboolean allow_mechanism(GDBusAuthObserver *observer, const char *mechanism, gpointer data) {
    return strcmp(mechanism, "EXTERNAL") == 0;
}

static void client_free(struct client *client) {
    GSocket *socket = g_socket_connection_get_socket(client->stream);
    client->server->clients = g_list_remove(client->server->clients, client);
    g_clear_handle_id(&client->timer, g_source_remove);
    if (client->thread) {
        g_socket_shutdown(socket, TRUE, TRUE, NULL); /* ends the wait of the thread */
        g_thread_join(client->thread);
    }
    g_source_destroy(client->joined);
    g_source_unref(client->joined);
    if (client->closed)
        g_signal_handler_disconnect(client->connection, client->closed);
    g_clear_object(&client->connection);
    g_object_unref(client->stream);
    g_free(client);
}

static void on_closed(GDBusConnection *connection, gboolean vanished, GError *error,
                      gpointer client) {
    client_free(client);
}

/* Authenticates a client, in a thread of its own. The connection handles no messages until
 * bus_export() has put the rig's object on it. */
static gpointer authenticate(gpointer data) {
    const GDBusConnectionFlags flags = G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_SERVER |
                                       G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_REQUIRE_SAME_USER |
                                       G_DBUS_CONNECTION_FLAGS_DELAY_MESSAGE_PROCESSING;
    struct client *client = data;
    client->connection =
        g_dbus_connection_new_sync(G_IO_STREAM(client->stream), client->server->guid, flags,
                                   client->server->observer, NULL, NULL);
    g_source_set_ready_time(client->joined, 0);
    return NULL;
}

static gboolean on_joined(GSource *source, GSourceFunc unused, gpointer data);
static GSourceFuncs joined_funcs = {.dispatch = on_joined};

struct joined_source {
    GSource base;
    struct client *client;
};

static gboolean on_joined(GSource *source, GSourceFunc unused, gpointer unused_data) {
    struct client *client = ((struct joined_source *)source)->client;
    g_autoptr(GError) error = NULL;
    g_source_set_ready_time(source, -1);
    g_thread_join(g_steal_pointer(&client->thread));
    g_clear_handle_id(&client->timer, g_source_remove);
    if (!client->connection || !bus_export(client->server->bus, client->connection, &error)) {
        if (error)
            g_warning("cannot serve a client: %s", error->message);
        client_free(client);
        return G_SOURCE_CONTINUE;
    }
    client->closed = g_signal_connect(client->connection, "closed", G_CALLBACK(on_closed), client);
    g_dbus_connection_start_message_processing(client->connection);
    return G_SOURCE_CONTINUE;
}

static gboolean on_silent(gpointer data) {
    struct client *client = data;
    client->timer = 0;
    client_free(client);
    return G_SOURCE_REMOVE;
}

static void client_new(BusServer *server, GSocket *socket, pid_t pid) {
    struct client *client = g_new0(struct client, 1);
    client->server = server;
    client->pid = pid;
    client->stream = g_socket_connection_factory_create_connection(socket);
    client->joined = g_source_new(&joined_funcs, sizeof(struct joined_source));
    ((struct joined_source *)client->joined)->client = client;
    g_source_attach(client->joined, NULL);
    client->timer = g_timeout_add_seconds(JOIN_S, on_silent, client);
    client->thread = g_thread_new("client", authenticate, client);
    server->clients = g_list_prepend(server->clients, client);
}

/* Writes a warning to the log, unless the last warning is less than a minute old. */
G_GNUC_PRINTF(2, 3)
static void say(BusServer *server, const char *format, ...) {
    const gint64 now_us = g_get_monotonic_time();
    va_list args;
    if (server->said_us && now_us - server->said_us < SAY_AGAIN_US)
        return;
    server->said_us = now_us;
    va_start(args, format);
    g_autofree char *text = g_strdup_vprintf(format, args);
    va_end(args);
    g_warning("%s", text);
}

static pid_t process_of(GSocket *socket) {
    g_autoptr(GCredentials) credentials = g_socket_get_credentials(socket, NULL);
    return credentials ? g_credentials_get_unix_pid(credentials, NULL) : 0;
}

/* Returns how many descriptors below `most` are free. `most` is at most FD_SETSIZE, because
 * libmodbus calls select(), which accepts no higher descriptors. */
static int count_free_files(int most) {
    int n = 0;
    for (int fd = 0; fd < most; fd++)
        n += fcntl(fd, F_GETFD) < 0;
    return n;
}

static gboolean has_room(BusServer *server, pid_t pid) {
    struct rlimit limit = {0};
    int of_process = 0, joining = 0;
    for (GList *item = server->clients; item; item = item->next) {
        const struct client *client = item->data;
        of_process += client->pid == pid;
        joining += client->thread != NULL;
    }
    if (of_process >= MAX_CLIENTS) {
        say(server,
            "process %d has %d connections, which is the maximum: no more of its connections are "
            "accepted",
            (int)pid, of_process);
        return FALSE;
    }
    getrlimit(RLIMIT_NOFILE, &limit);
    const int most = (int)MIN(limit.rlim_cur, FD_SETSIZE);
    if (count_free_files(most) >= most / RESERVED_PART + joining * JOIN_FILES)
        return TRUE;
    say(server,
        "%u clients are connected, and few more files can be opened, so no more clients are "
        "accepted: end clients, or raise the limit of open files (LimitNOFILE in mesorigd.service)",
        g_list_length(server->clients));
    return FALSE;
}

static void wait_for_clients(BusServer *server);

static gboolean on_again(gpointer data) {
    BusServer *server = data;
    server->again = 0;
    wait_for_clients(server);
    return G_SOURCE_REMOVE;
}

/* Accepts a client, or refuses it by closing its connection. If accepting fails, the server waits
 * AGAIN_MS before it tries again. Otherwise the client that is still waiting would keep the main
 * loop busy. */
static gboolean on_client(GSocket *listener, GIOCondition condition, gpointer data) {
    BusServer *server = data;
    g_autoptr(GError) error = NULL;
    g_autoptr(GSocket) socket = g_socket_accept(listener, NULL, &error);
    if (socket) {
        const pid_t pid = process_of(socket);
        if (has_room(server, pid))
            client_new(server, socket, pid);
        return G_SOURCE_CONTINUE;
    }
    if (g_error_matches(error, G_IO_ERROR, G_IO_ERROR_WOULD_BLOCK))
        return G_SOURCE_CONTINUE;
    say(server, "cannot accept a client: %s", error->message);
    server->waiting = 0;
    server->again = g_timeout_add(AGAIN_MS, on_again, server);
    return G_SOURCE_REMOVE;
}

static void wait_for_clients(BusServer *server) {
    GSource *source = g_socket_create_source(server->socket, G_IO_IN, NULL);
    g_source_set_callback(source, G_SOURCE_FUNC(on_client), server, NULL);
    server->waiting = g_source_attach(source, NULL);
    g_source_unref(source);
}

/* Removes the socket at path if no process listens there. Returns TRUE if nothing is then at path.
 * Returns FALSE with an error if the path is too long, if another kind of file is at the path, or
 * if a process listens or may listen at the socket. */
static gboolean remove_stale(const char *path, GError **error) {
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    struct stat info;
    /* A longer path is refused, because GLib would truncate it and listen at another path. */
    if (strlen(path) >= sizeof(to.sun_path)) {
        g_set_error(
            error, G_IO_ERROR, G_IO_ERROR_FILENAME_TOO_LONG,
            "%s has %zu bytes, and a socket's path has at most %zu: choose another path for "
            "--listen",
            path, strlen(path), sizeof(to.sun_path) - 1);
        return FALSE;
    }
    if (lstat(path, &info) != 0)
        return TRUE;
    if (!S_ISSOCK(info.st_mode)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_EXISTS,
                    "%s exists and is not a socket: choose another path for --listen", path);
        return FALSE;
    }
    strcpy(to.sun_path, path);
    const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const int why = fd >= 0 && connect(fd, (struct sockaddr *)&to, sizeof(to)) == 0 ? 0 : errno;
    /* Only ECONNREFUSED proves that nobody listens. Other errors may have other reasons, such as a
     * full backlog or missing rights. */
    const gboolean stale = fd >= 0 && why == ECONNREFUSED;
    if (fd >= 0)
        close(fd);
    if (stale)
        g_unlink(path);
    else if (why == 0)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_ADDRESS_IN_USE,
                    "another program listens at %s: choose another path for --listen", path);
    else
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_ADDRESS_IN_USE,
                    "it is not known whether another program listens at %s (%s): choose another "
                    "path for --listen",
                    path, g_strerror(why));
    return stale;
}

static GSocket *listen_at(const char *path, GError **error) {
    g_autoptr(GSocketAddress) address = g_unix_socket_address_new(path);
    g_autoptr(GSocket) socket =
        g_socket_new(G_SOCKET_FAMILY_UNIX, G_SOCKET_TYPE_STREAM, G_SOCKET_PROTOCOL_DEFAULT, error);
    if (!socket)
        return NULL;
    g_socket_set_blocking(socket, FALSE);
    g_socket_set_listen_backlog(socket, SOMAXCONN);
    if (g_socket_bind(socket, address, FALSE, error) && g_socket_listen(socket, error))
        return g_steal_pointer(&socket);
    g_prefix_error(
        error,
        "cannot listen at %s (make its folder, or choose another path for --listen): ", path);
    return NULL;
}

BusServer *bus_serve(Bus *bus, const char *address, GError **error) {
    if (!g_str_has_prefix(address, "unix:path=/") || strpbrk(address, ",;%")) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "“%s” is not an address to listen at: write unix:path=/…/NAME, without commas, "
                    "semicolons and percent signs",
                    address);
        return NULL;
    }
    const char *path = address + strlen("unix:path=");
    if (!remove_stale(path, error))
        return NULL;
    GSocket *socket = listen_at(path, error);
    if (!socket)
        return NULL;
    BusServer *server = g_new0(BusServer, 1);
    server->bus = bus;
    server->socket = socket;
    server->path = g_strdup(path);
    server->guid = g_dbus_generate_guid();
    server->observer = g_dbus_auth_observer_new();
    g_signal_connect(server->observer, "allow-mechanism", G_CALLBACK(allow_mechanism), NULL);
    wait_for_clients(server);
    g_autoptr(GError) why = NULL;
    server->announced = bus_client_announce(address, &why);
    if (why)
        g_warning("commands find this mesorigd only with --address=%s (%s)", address, why->message);
    return server;
}

void bus_unserve(Bus *bus, BusServer *server) {
    if (server->announced)
        bus_client_remove_folder(server->announced);
    g_clear_handle_id(&server->waiting, g_source_remove);
    g_clear_handle_id(&server->again, g_source_remove);
    g_unlink(server->path);
    g_socket_close(server->socket, NULL);
    while (server->clients)
        client_free(server->clients->data);
    g_object_unref(server->socket);
    g_object_unref(server->observer);
    g_free(server->announced);
    g_free(server->path);
    g_free(server->guid);
    g_free(server);
}
