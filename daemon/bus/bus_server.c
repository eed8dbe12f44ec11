#include "bus.h"
#include "bus_client.h"

#include <gio/gunixsocketaddress.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

/* The kernel identifies the client; cookies in home folders are not used. */
static gboolean allow_mechanism(GDBusAuthObserver *observer, const char *mechanism, gpointer data) {
    return strcmp(mechanism, "EXTERNAL") == 0;
}

static gboolean new_connection(GDBusServer *server, GDBusConnection *connection, gpointer bus) {
    g_autoptr(GError) error = NULL;
    if (bus_export(bus, connection, &error))
        return TRUE;
    g_warning("cannot serve a client: %s", error->message);
    return FALSE;
}

/* TRUE if no process listens at a socket's path any more; the socket is then removed. */
static gboolean remove_stale(const char *path, GError **error) {
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    struct stat info;
    /* GLib would cut it short, and listen at another path. */
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
    const gboolean answered = fd >= 0 && connect(fd, (struct sockaddr *)&to, sizeof(to)) == 0;
    if (fd >= 0)
        close(fd);
    if (answered)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_ADDRESS_IN_USE,
                    "another program listens at %s: choose another path for --listen", path);
    else
        g_unlink(path);
    return !answered;
}

GDBusServer *bus_serve(Bus *bus, const char *address, GError **error) {
    if (!g_str_has_prefix(address, "unix:path=/")) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "%s is not an address to listen at: write unix:path=/…/NAME", address);
        return NULL;
    }
    if (!remove_stale(address + strlen("unix:path="), error))
        return NULL;
    g_autofree char *guid = g_dbus_generate_guid();
    g_autoptr(GDBusAuthObserver) observer = g_dbus_auth_observer_new();
    g_signal_connect(observer, "allow-mechanism", G_CALLBACK(allow_mechanism), NULL);
    GDBusServer *server = g_dbus_server_new_sync(
        address, G_DBUS_SERVER_FLAGS_AUTHENTICATION_REQUIRE_SAME_USER, guid, observer, NULL, error);
    if (!server)
        return NULL;
    g_signal_connect(server, "new-connection", G_CALLBACK(new_connection), bus);
    g_dbus_server_start(server);
    g_autoptr(GError) why = NULL;
    char *folder = bus_client_announce(address, &why);
    if (why)
        g_warning("commands find this daemon only with --address: %s", why->message);
    g_object_set_data_full(G_OBJECT(server), "announced", folder, g_free);
    return server;
}

void bus_unserve(Bus *bus, GDBusServer *server) {
    const char *announced = g_object_get_data(G_OBJECT(server), "announced");
    if (announced)
        bus_client_remove_folder(announced);
    g_signal_handlers_disconnect_by_func(server, new_connection, bus);
    g_dbus_server_stop(server);
    g_object_unref(server);
}
