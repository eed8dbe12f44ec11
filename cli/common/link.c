#include "link_private.h"

#include "base/input_file.h"
#include "base/program.h"
#include "bus/bus.h"
#include "bus/bus_client.h"

#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <unistd.h>

#define START_WAIT_MS 15000
#define ASK_WAIT_MS   5000
/* Maximum size of a text in bytes. It is the limit of a calibration; other files have lower
 * limits. */
#define MAX_TEXT        (16 << 20)
#define CALL_TIMEOUT_MS 600000 /* opening a rig may take a long time */

static gboolean make_proxy(Link *link, const char *name, GError **error) {
    link->rig = bus_rig1_proxy_new_sync(link->connection, G_DBUS_PROXY_FLAGS_DO_NOT_AUTO_START,
                                        name, BUS_PATH, NULL, error);
    if (link->rig)
        g_dbus_proxy_set_default_timeout(G_DBUS_PROXY(link->rig), CALL_TIMEOUT_MS);
    return link->rig != NULL;
}

static gboolean connect_to(Link *link, const char *address, GError **error) {
    link->connection = bus_client_connect(address, error);
    return link->connection && make_proxy(link, NULL, error);
}

/* Asks the daemon for its state, and returns FALSE with an error if it does not answer. This is
 * necessary because GDBus also makes a proxy if the user may not call the daemon, or if the daemon
 * does not respond. `where` is a text for the error, such as "on the system bus". */
static gboolean may_ask(BusRig1 *rig, const char *where, GError **error) {
    g_autoptr(GError) why = NULL;
    if (bus_rig1_get_state(rig))
        return TRUE;
    g_autoptr(GVariant) state = g_dbus_proxy_call_sync(
        G_DBUS_PROXY(rig), "org.freedesktop.DBus.Properties.Get",
        g_variant_new("(ss)", BUS_NAME, "State"), G_DBUS_CALL_FLAGS_NONE, ASK_WAIT_MS, NULL, &why);
    if (state)
        return TRUE;
    if (g_error_matches(why, G_DBUS_ERROR, G_DBUS_ERROR_ACCESS_DENIED))
        g_set_error(
            error, G_IO_ERROR, G_IO_ERROR_PERMISSION_DENIED,
            "only members of the group mesorig may use the rig %s: run “adduser %s mesorig” "
            "as root, then log in again",
            where, g_get_user_name());
    else
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_TIMED_OUT,
                    "mesorigd %s does not answer: %s; wait until it is ready, or start it again",
                    where, why->message);
    return FALSE;
}

Link *link_to(const char *address, GError **error) {
    g_autoptr(Link) link = g_new0(Link, 1);
    g_autofree char *where = g_strconcat("at ", address, NULL);
    link->option = g_strconcat("--address ", address, NULL);
    return connect_to(link, address, error) && may_ask(link->rig, where, error)
               ? g_steal_pointer(&link)
               : NULL;
}

Link *link_on_bus(const char *bus, GError **error) {
    g_autoptr(Link) link = g_new0(Link, 1);
    const GBusType type = strcmp(bus, "system") == 0 ? G_BUS_TYPE_SYSTEM : G_BUS_TYPE_SESSION;
    g_autoptr(GError) why = NULL;
    g_autofree char *where = g_strdup_printf("on the %s bus", bus);
    link->option = g_strconcat("--bus ", bus, NULL);
    link->connection = g_bus_get_sync(type, NULL, &why);
    if (link->connection && make_proxy(link, BUS_NAME, &why)) {
        g_dbus_connection_set_exit_on_close(link->connection, FALSE);
        g_autofree char *owner = g_dbus_proxy_get_name_owner(G_DBUS_PROXY(link->rig));
        if (owner)
            return may_ask(link->rig, where, error) ? g_steal_pointer(&link) : NULL;
    }
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                "no mesorigd is on the %s bus%s%s; start one there: mesorigd --bus %s", bus,
                why ? ": " : "", why ? why->message : "", bus);
    return NULL;
}

/* Runs in the new process between fork and exec. setsid() puts the daemon into a session of its
 * own, so that Ctrl-C in the terminal reaches only this process. The daemon gets its requests over
 * the bus, and is ended when this process ends. */
static void prepare_daemon(gpointer parent) {
    setsid();
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != GPOINTER_TO_INT(parent))
        _exit(1);
}

static gboolean wait_for_daemon(Link *link, const char *address, GError **error) {
    for (int ms = 0; ms < START_WAIT_MS; ms += 10) {
        if (connect_to(link, address, NULL))
            return TRUE;
        g_clear_object(&link->connection);
        if (!g_subprocess_get_identifier(link->daemon))
            break;
        g_usleep(10 * 1000);
    }
    g_autofree char *log = link_log(link);
    if (g_subprocess_get_identifier(link->daemon))
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED,
                    "mesorigd was started, but has not answered within 15 s; try again when the "
                    "computer is less busy%s%s",
                    *log ? "\nIts last messages:\n" : "", log);
    else
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED, "mesorigd did not start: %s",
                    *log ? log
                         : "it printed no message; run mesorigd in a terminal to see how it ends");
    return FALSE;
}

Link *link_start(GError **error) {
    g_autofree char *program = program_find("mesorigd", error);
    g_autoptr(Link) link = g_new0(Link, 1);
    if (!program)
        return NULL;
    link->folder = bus_client_make_folder(error);
    if (!link->folder)
        return NULL;
    g_autofree char *address = g_strdup_printf("unix:path=%s/bus", link->folder);
    g_autofree char *log = g_build_filename(link->folder, "log", NULL);
    link->option = g_strconcat("--address ", address, NULL);
    g_autoptr(GSubprocessLauncher) launcher =
        g_subprocess_launcher_new(G_SUBPROCESS_FLAGS_STDOUT_SILENCE);
    g_subprocess_launcher_set_stderr_file_path(launcher, log);
    g_subprocess_launcher_set_child_setup(launcher, prepare_daemon, GINT_TO_POINTER(getpid()),
                                          NULL);
    g_subprocess_launcher_unsetenv(launcher, "NOTIFY_SOCKET");
    g_subprocess_launcher_unsetenv(launcher, "WATCHDOG_USEC");
    link->daemon = g_subprocess_launcher_spawn(launcher, error, program, "--listen", address,
                                               "--exit-with-client", NULL);
    return link->daemon && wait_for_daemon(link, address, error) ? g_steal_pointer(&link) : NULL;
}

void link_free(Link *link) {
    if (!link)
        return;
    if (link->connection && !link->rig)
        g_clear_object(&link->connection);
    g_clear_object(&link->rig);
    if (link->daemon) {
        if (link->connection)
            g_dbus_connection_close_sync(link->connection, NULL, NULL);
        g_subprocess_send_signal(link->daemon, SIGTERM);
        g_subprocess_wait(link->daemon, NULL, NULL);
    }
    g_clear_object(&link->connection);
    g_clear_object(&link->daemon);
    if (link->folder)
        bus_client_remove_folder(link->folder);
    g_free(link->folder);
    g_free(link->option);
    g_free(link);
}

BusRig1 *link_rig(Link *link) {
    return link->rig;
}

const char *link_option(const Link *link) {
    return link->option;
}

gboolean link_is_private(const Link *link) {
    return link->daemon != NULL;
}

gboolean link_is_lost(const Link *link) {
    if (g_dbus_connection_is_closed(link->connection))
        return TRUE;
    if (!g_dbus_proxy_get_name(G_DBUS_PROXY(link->rig)))
        return FALSE;
    g_autofree char *owner = g_dbus_proxy_get_name_owner(G_DBUS_PROXY(link->rig));
    return owner == NULL;
}

gboolean link_add_text(Link *link, GVariantDict *options, const char *key, const char *path,
                       GError **error) {
    if (!g_dbus_proxy_get_name(G_DBUS_PROXY(link->rig)))
        return TRUE;
    g_autofree char *text = input_file_read_text(path, MAX_TEXT, error);
    if (text)
        g_variant_dict_insert(options, key, "s", text);
    return text != NULL;
}

char *link_log(const Link *link) {
    char *text = NULL;
    if (link->folder) {
        g_autofree char *path = g_build_filename(link->folder, "log", NULL);
        g_file_get_contents(path, &text, NULL, NULL);
    }
    return text ? g_strstrip(text) : g_strdup("");
}
