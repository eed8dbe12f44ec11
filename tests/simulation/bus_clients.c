#include "bus_clients.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "held_time.h"

#define ERRORS "org.mesorig.Error."

struct client {
    int number; /* of the connection, from 0 on */
    int fd;     /* −1: it is not connected */
    gboolean deaf;
    guint32 serial;
    GByteArray *in;
};

struct bus_clients {
    struct scene *scene;
    Bus *bus;
    char *guid;
    struct client named[BUS_CLIENTS];
    GArray *calls;    /* of struct bus_call */
    GArray *answered; /* of guint */
    GArray *gone_us;  /* by number; −1: connected */
    int greeting;     /* the descriptor of a client that has still to say the rest */
};

static gint64 clients_now_us(const struct bus_clients *clients) {
    return clients->scene->disk.ended_us;
}

struct bus_clients *bus_clients_new(struct scene *scene, Bus *bus) {
    struct bus_clients *clients = g_new0(struct bus_clients, 1);
    clients->scene = scene;
    clients->bus = bus;
    clients->guid = g_dbus_generate_guid();
    clients->calls = g_array_new(FALSE, FALSE, sizeof(struct bus_call));
    clients->answered = g_array_new(FALSE, FALSE, sizeof(guint));
    clients->gone_us = g_array_new(FALSE, FALSE, sizeof(gint64));
    for (int i = 0; i < BUS_CLIENTS; i++)
        clients->named[i].fd = -1;
    return clients;
}

const GArray *bus_clients_calls(const struct bus_clients *clients) {
    return clients->calls;
}

const GArray *bus_clients_answered(const struct bus_clients *clients) {
    return clients->answered;
}

gint64 bus_clients_gone_us(const struct bus_clients *clients, const struct bus_call *call) {
    return g_array_index(clients->gone_us, gint64, call->client);
}

static void client_say_rest(gpointer data) {
    static const char rest[] = "NEGOTIATE_UNIX_FD\r\nBEGIN\r\n";
    struct bus_clients *clients = data;
    held_time_set_feeder(NULL, NULL);
    if (write(clients->greeting, rest, strlen(rest)) != (ssize_t)strlen(rest))
        g_error("simulate: a client cannot greet: %s", g_strerror(errno));
}

/* Takes what is there; FALSE: the daemon has closed the connection. */
static gboolean client_take(struct client *client) {
    char bytes[65536];
    for (;;) {
        char control[CMSG_SPACE(16 * sizeof(int))];
        struct iovec to = {bytes, sizeof bytes};
        struct msghdr head = {.msg_iov = &to,
                              .msg_iovlen = 1,
                              .msg_control = control,
                              .msg_controllen = sizeof control};
        const ssize_t n = recvmsg(client->fd, &head, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
        if (n <= 0)
            return n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK);
        for (struct cmsghdr *part = CMSG_FIRSTHDR(&head); part; part = CMSG_NXTHDR(&head, part)) {
            const int *fds = (const int *)(gconstpointer)CMSG_DATA(part);
            for (gsize i = 0; i < (part->cmsg_len - CMSG_LEN(0)) / sizeof *fds; i++)
                close(fds[i]);
        }
        g_byte_array_append(client->in, (const guint8 *)bytes, (guint)n);
    }
}

/* The daemon's end of a connection, which has heard the greeting. */
static GDBusConnection *client_connect(struct bus_clients *clients, struct client *client) {
    g_autofree char *uid = g_strdup_printf("%u", (guint)getuid());
    g_autoptr(GString) hello = g_string_new(NULL);
    g_autoptr(GError) error = NULL;
    const gint64 connected = -1;
    int fds[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, fds) != 0)
        g_error("simulate: no sockets: %s", g_strerror(errno));
    g_string_append_c(hello, '\0');
    g_string_append(hello, "AUTH EXTERNAL ");
    for (const char *c = uid; *c; c++)
        g_string_append_printf(hello, "%02x", (guint)*c);
    g_string_append(hello, "\r\n");
    client->fd = fds[0];
    client->deaf = FALSE;
    client->serial = 0;
    client->in = g_byte_array_new();
    client->number = (int)clients->gone_us->len;
    g_array_append_val(clients->gone_us, connected);
    if (write(client->fd, hello->str, hello->len) != (ssize_t)hello->len)
        g_error("simulate: a client cannot greet: %s", g_strerror(errno));
    g_autoptr(GSocket) socket = g_socket_new_from_fd(fds[1], &error);
    if (!socket)
        g_error("simulate: %s", error->message);
    g_autoptr(GSocketConnection) stream = g_socket_connection_factory_create_connection(socket);
    clients->greeting = client->fd;
    held_time_set_feeder(client_say_rest, clients);
    GDBusConnection *connection =
        g_dbus_connection_new_sync(G_IO_STREAM(stream), clients->guid,
                                   G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_SERVER |
                                       G_DBUS_CONNECTION_FLAGS_DELAY_MESSAGE_PROCESSING,
                                   NULL, NULL, &error);
    held_time_set_feeder(NULL, NULL);
    if (!connection)
        g_error("simulate: a client is not let in: %s", error->message);
    held_time_set_bus();
    held_time_wait();
    client_take(client);
    g_byte_array_set_size(client->in, 0);
    return connection;
}

/* As the daemon's server does it; takes the connection. */
static void client_show(struct bus_clients *clients, GDBusConnection *connection) {
    g_autoptr(GError) error = NULL;
    if (bus_export(clients->bus, connection, &error))
        g_dbus_connection_start_message_processing(connection);
    else
        disk_say(&clients->scene->disk, "a client is not served: %s", error->message);
    g_object_unref(connection);
    held_time_wait();
}

static void client_close(struct bus_clients *clients, struct client *client) {
    if (client->fd < 0)
        return;
    g_array_index(clients->gone_us, gint64, client->number) = clients_now_us(clients);
    close(client->fd);
    client->fd = -1;
    g_clear_pointer(&client->in, g_byte_array_unref);
    disk_say(&clients->scene->disk, "client %d goes", client->number);
    held_time_wait();
}

static GVariant *step_parameters(const struct bus_clients *clients, const struct bus_step *step) {
    const char *device = bus_schedule_device(step->method, step->device);
    g_autofree char *conf = g_build_filename(clients->scene->folder, "session.conf", NULL);
    g_autofree char *rig = g_build_filename(clients->scene->folder, "rig.conf", NULL);
    switch (step->method) {
    case BUS_SET_LASER:
    case BUS_SET_LAMP:
        return g_variant_new("(sbd)", device, step->on, step->for_s);
    case BUS_MOVE_AXIS:
        return g_variant_new("(sd)", device, step->deg);
    case BUS_HOME_AXIS:
        return g_variant_new("(s)", device);
    case BUS_SNAP:
        return g_variant_new("(sxd)", device, step->exposure_us, 0.0);
    case BUS_START:
        return g_variant_new("(ss@a{sv})", conf, clients->scene->session,
                             g_variant_new("a{sv}", NULL));
    case BUS_RESUME:
        return g_variant_new("(s@a{sv})", clients->scene->session, g_variant_new("a{sv}", NULL));
    case BUS_OPEN_RIG:
        return g_variant_new("(s)", rig);
    case BUS_GET_ALL:
        return g_variant_new("(s)", BUS_NAME);
    default:
        return NULL;
    }
}

static void client_send(struct bus_clients *clients, struct client *client,
                        const struct bus_step *step) {
    const char *method = bus_schedule_method(step->method);
    const gboolean of_properties = step->method == BUS_GET_ALL;
    g_autoptr(GDBusMessage) message = g_dbus_message_new_method_call(
        NULL, BUS_PATH, of_properties ? "org.freedesktop.DBus.Properties" : BUS_NAME, method);
    g_autoptr(GError) error = NULL;
    GVariant *parameters = step_parameters(clients, step);
    gsize size;
    if (parameters)
        g_dbus_message_set_body(message, parameters);
    g_dbus_message_set_serial(message, ++client->serial);
    g_autofree guchar *blob =
        g_dbus_message_to_blob(message, &size, G_DBUS_CAPABILITY_FLAGS_UNIX_FD_PASSING, &error);
    if (!blob)
        g_error("simulate: %s", error->message);
    const struct bus_call call = {.client = client->number,
                                  .serial = client->serial,
                                  .method = step->method,
                                  .device = step->device,
                                  .on = step->on,
                                  .for_s = step->for_s,
                                  .sent_us = clients_now_us(clients),
                                  .answered_us = -1,
                                  .deaf = client->deaf};
    g_array_append_val(clients->calls, call);
    clients->scene->bus_calls++;
    disk_say(&clients->scene->disk, "client %d calls %s %s%s", client->number, method,
             bus_schedule_device(step->method, step->device),
             step->method == BUS_SET_LASER || step->method == BUS_SET_LAMP
                 ? (step->on ? " on" : " off")
                 : "");
    if (send(client->fd, blob, size, MSG_NOSIGNAL) != (ssize_t)size)
        client_close(clients, client); /* the daemon has closed it */
    held_time_wait();
}

static void client_flash(struct bus_clients *clients, const struct bus_step *step) {
    struct client client = {.fd = -1};
    GDBusConnection *connection = client_connect(clients, &client);
    const gboolean shown = step->flash == FLASH_SHOWN || step->flash == FLASH_LOOPS;
    if (shown)
        client_show(clients, connection);
    client_send(clients, &client, step);
    for (int i = 0; step->flash == FLASH_LOOPS && i < step->n % 4; i++)
        g_main_context_iteration(NULL, FALSE);
    client_close(clients, &client);
    if (step->flash == FLASH_CLOSED_FIRST)
        g_main_context_iteration(NULL, FALSE);
    if (!shown)
        client_show(clients, connection);
}

static void client_stop_reading(struct bus_clients *clients, struct client *client) {
    client->deaf = TRUE;
    for (guint i = 0; i < clients->calls->len; i++) {
        struct bus_call *call = &g_array_index(clients->calls, struct bus_call, i);
        call->deaf |= client->fd >= 0 && call->client == client->number && call->answered_us < 0;
    }
}

void bus_clients_step(struct bus_clients *clients, const struct bus_step *step) {
    struct client *client = &clients->named[step->client];
    const gboolean calls = step->action == STEP_CALL || step->action == STEP_FLOOD;
    if (calls && client->fd < 0)
        client_show(clients, client_connect(clients, client));
    switch (step->action) {
    case STEP_CALL:
        client_send(clients, client, step);
        break;
    case STEP_FLOOD:
        for (int i = 0; i < step->n && client->fd >= 0; i++)
            client_send(clients, client, step);
        break;
    case STEP_CLOSE:
        client_close(clients, client);
        break;
    case STEP_DEAF:
        client_stop_reading(clients, client);
        break;
    case STEP_HEARS:
        client->deaf = FALSE;
        break;
    default:
        client_flash(clients, step);
    }
}

/* From the last one on; −1: there is none. */
static int find_call(const struct bus_clients *clients, int client, guint32 serial) {
    for (guint i = clients->calls->len; i-- > 0;) {
        const struct bus_call *call = &g_array_index(clients->calls, struct bus_call, i);
        if (call->client == client && call->serial == serial)
            return (int)i;
    }
    return -1;
}

static void client_hear(const struct bus_clients *clients, const struct client *client,
                        GDBusMessage *message) {
    struct disk *disk = &clients->scene->disk;
    const GDBusMessageType type = g_dbus_message_get_message_type(message);
    GVariant *body = g_dbus_message_get_body(message);
    g_autofree char *text = body ? g_variant_print(body, FALSE) : g_strdup("");
    g_autofree char *neutral = disk_neutral(disk, text);
    if (type == G_DBUS_MESSAGE_TYPE_SIGNAL) {
        disk_say(disk, "client %d hears %s %08x", client->number,
                 g_dbus_message_get_member(message), g_str_hash(neutral));
        return;
    }
    const int at = find_call(clients, client->number, g_dbus_message_get_reply_serial(message));
    struct bus_call *call = at < 0 ? NULL : &g_array_index(clients->calls, struct bus_call, at);
    if (!call || call->answered_us >= 0) {
        scene_break(clients->scene, "answered", "client %d gets an answer to no call",
                    client->number);
        return;
    }
    const char *error =
        type == G_DBUS_MESSAGE_TYPE_ERROR ? g_dbus_message_get_error_name(message) : NULL;
    call->answered_us = clients_now_us(clients);
    call->ok = !error;
    g_array_append_val(clients->answered, at);
    if (error)
        g_strlcpy(call->error, g_str_has_prefix(error, ERRORS) ? error + strlen(ERRORS) : error,
                  sizeof call->error);
    if (call->ok && call->method == BUS_SAFE_STATE)
        g_variant_get_child(body, 0, "b", &call->safe);
    disk_say(disk, "client %d: %s %s: %s%s%.200s", client->number,
             bus_schedule_method(call->method), bus_schedule_device(call->method, call->device),
             error ? call->error : "done", *neutral ? " " : "",
             call->method == BUS_GET_ALL ? "" : neutral);
}

static void client_read(struct bus_clients *clients, struct client *client) {
    g_autoptr(GError) error = NULL;
    const gboolean open = client_take(client);
    while (client->in->len >= 16) {
        const gssize needed =
            g_dbus_message_bytes_needed(client->in->data, client->in->len, &error);
        if (needed < 0)
            g_error("simulate: a client hears no D-Bus: %s", error->message);
        if ((guint)needed > client->in->len)
            break;
        g_autoptr(GDBusMessage) message = g_dbus_message_new_from_blob(
            client->in->data, (gsize)needed, G_DBUS_CAPABILITY_FLAGS_UNIX_FD_PASSING, &error);
        if (!message)
            g_error("simulate: a client hears no D-Bus: %s", error->message);
        g_byte_array_remove_range(client->in, 0, (guint)needed);
        client_hear(clients, client, message);
    }
    if (!open)
        client_close(clients, client);
}

void bus_clients_read(struct bus_clients *clients) {
    struct pollfd fds[BUS_CLIENTS];
    struct client *by[BUS_CLIENTS];
    nfds_t n = 0;
    for (int i = 0; i < BUS_CLIENTS; i++)
        if (clients->named[i].fd >= 0 && !clients->named[i].deaf) {
            by[n] = &clients->named[i];
            fds[n++] = (struct pollfd){.fd = clients->named[i].fd, .events = POLLIN};
        }
    if (n == 0 || poll(fds, n, 0) <= 0)
        return;
    for (nfds_t i = 0; i < n; i++)
        if (fds[i].revents)
            client_read(clients, by[i]);
}

void bus_clients_close_all(struct bus_clients *clients) {
    for (int i = 0; i < BUS_CLIENTS; i++)
        client_close(clients, &clients->named[i]);
}
