#include "bus_client.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <string.h>
#include <unistd.h>

/* maximum length in bytes; the path of a socket in the folder has at most 107 bytes */
#define LONGEST_FOLDER  80
#define CONNECT_WAIT_MS 15000 /* a mesorigd on a busy computer may need several seconds */
#define UNIX_PATH       "unix:path="

const char *bus_client_address(void) {
    const char *address = g_getenv(BUS_CLIENT_VARIABLE);
    return address && *address ? address : NULL;
}

gboolean bus_client_is_bus(const char *value) {
    return g_str_equal(value, "system") || g_str_equal(value, "session");
}

const char *bus_client_folder(void) {
    const char *folder = g_get_user_runtime_dir();
    return strlen(folder) > LONGEST_FOLDER || g_access(folder, W_OK) != 0 ? g_get_tmp_dir()
                                                                          : folder;
}

char *bus_client_make_folder(GError **error) {
    char *folder = g_build_filename(bus_client_folder(), "mesorig-XXXXXX", NULL);
    if (g_mkdtemp_full(folder, 0700))
        return folder;
    g_set_error(error, G_IO_ERROR, g_io_error_from_errno(errno),
                "cannot make a folder for the socket of mesorigd in %s: %s; set XDG_RUNTIME_DIR to "
                "a folder in which you may write",
                bus_client_folder(), g_strerror(errno));
    g_free(folder);
    return NULL;
}

void bus_client_remove_folder(const char *folder) {
    g_autofree char *socket = g_build_filename(folder, "bus", NULL);
    g_autofree char *log = g_build_filename(folder, "log", NULL);
    g_unlink(socket);
    g_unlink(log);
    g_rmdir(folder);
}

char *bus_client_announce(const char *address, GError **error) {
    g_return_val_if_fail(g_str_has_prefix(address, UNIX_PATH), NULL);
    g_autofree char *path = g_uri_unescape_string(address + strlen(UNIX_PATH), NULL);
    if (!path) {
        g_set_error(
            error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
            "“%s” is not an address: every %% in it must be followed by two hexadecimal digits",
            address);
        return NULL;
    }
    g_autofree char *own = g_path_get_dirname(path);
    g_autofree char *parent = g_path_get_dirname(own);
    g_autofree char *name = g_path_get_basename(own);
    if (g_str_has_suffix(path, "/bus") && g_str_has_prefix(name, "mesorig-") &&
        g_str_equal(parent, bus_client_folder()))
        return NULL;
    g_autofree char *folder = bus_client_make_folder(error);
    if (!folder)
        return NULL;
    g_autofree char *link = g_build_filename(folder, "bus", NULL);
    if (symlink(path, link) == 0)
        return g_steal_pointer(&folder);
    g_set_error(
        error, G_IO_ERROR, g_io_error_from_errno(errno),
        "cannot make the link %s: %s; free space there, or set XDG_RUNTIME_DIR to another folder",
        link, g_strerror(errno));
    bus_client_remove_folder(folder);
    return NULL;
}

struct attempt {
    char *address;
    GCancellable *stop; /* cancelled by the caller, or after CONNECT_WAIT_MS */
    GCancellable *caller;
    gulong caller_id;
    guint timer;
};

static void attempt_free(gpointer data) {
    struct attempt *attempt = data;
    g_clear_handle_id(&attempt->timer, g_source_remove);
    if (attempt->caller)
        g_cancellable_disconnect(attempt->caller, attempt->caller_id);
    g_clear_object(&attempt->caller);
    g_object_unref(attempt->stop);
    g_free(attempt->address);
    g_free(attempt);
}

static gboolean give_up(gpointer data) {
    struct attempt *attempt = data;
    attempt->timer = 0;
    g_cancellable_cancel(attempt->stop);
    return G_SOURCE_REMOVE;
}

static void on_cancelled(GCancellable *caller, gpointer stop) {
    g_cancellable_cancel(stop);
}

/* Returns the error to show in place of GLib's error `why`, which names neither the address nor a
 * remedy. */
static GError *explain(const struct attempt *attempt, const GError *why) {
    const char *address = attempt->address;
    if (g_error_matches(why, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT) ||
        g_error_matches(why, G_IO_ERROR, G_IO_ERROR_NOT_SUPPORTED))
        return g_error_new(G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                           "“%s” is not the address of a mesorigd: write unix:path=/…/NAME, as was "
                           "given to mesorigd --listen",
                           address);
    if (g_cancellable_is_cancelled(attempt->stop))
        return g_error_new(G_IO_ERROR, G_IO_ERROR_TIMED_OUT,
                           "the program that listens at %s has not answered within %d s; end it, "
                           "and start mesorigd again",
                           address, CONNECT_WAIT_MS / 1000);
    const char *colon = strstr(why->message, ": "); /* after "Could not connect" */
    if (g_error_matches(why, G_IO_ERROR, G_IO_ERROR_PERMISSION_DENIED))
        return g_error_new(why->domain, why->code,
                           "this user may not connect to the mesorigd at %s (%s); work as the user "
                           "who has started that mesorigd",
                           address, colon ? colon + 2 : why->message);
    return g_error_new(why->domain, why->code,
                       "no mesorigd answers at %s (%s); start one there: mesorigd --listen %s "
                       "--rig RIG",
                       address, colon ? colon + 2 : why->message, address);
}

static void on_connected(GObject *source, GAsyncResult *result, gpointer data) {
    g_autoptr(GTask) task = data;
    const struct attempt *attempt = g_task_get_task_data(task);
    g_autoptr(GError) error = NULL;
    GDBusConnection *connection = g_dbus_connection_new_for_address_finish(result, &error);
    if (!connection) {
        g_task_return_error(task, explain(attempt, error));
        return;
    }
    g_dbus_connection_set_exit_on_close(connection, FALSE);
    g_task_return_pointer(task, connection, g_object_unref);
}

void bus_client_connect_async(const char *address, GCancellable *cancellable,
                              GAsyncReadyCallback callback, gpointer data) {
    GTask *task = g_task_new(NULL, cancellable, callback, data);
    struct attempt *attempt = g_new0(struct attempt, 1);
    attempt->address = g_strdup(address);
    attempt->stop = g_cancellable_new();
    attempt->timer = g_timeout_add(CONNECT_WAIT_MS, give_up, attempt);
    g_task_set_task_data(task, attempt, attempt_free);
    if (cancellable) {
        attempt->caller = g_object_ref(cancellable);
        attempt->caller_id =
            g_cancellable_connect(cancellable, G_CALLBACK(on_cancelled), attempt->stop, NULL);
    }
    g_dbus_connection_new_for_address(address, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL,
                                      attempt->stop, on_connected, task);
}

GDBusConnection *bus_client_connect_finish(GAsyncResult *result, GError **error) {
    return g_task_propagate_pointer(G_TASK(result), error);
}

static void take_result(GObject *source, GAsyncResult *result, gpointer data) {
    *(GAsyncResult **)data = g_object_ref(result);
}

GDBusConnection *bus_client_connect(const char *address, GError **error) {
    g_autoptr(GAsyncResult) result = NULL;
    bus_client_connect_async(address, NULL, take_result, &result);
    while (!result)
        g_main_context_iteration(NULL, TRUE);
    return bus_client_connect_finish(result, error);
}
