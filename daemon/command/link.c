#include "link.h"

#include "base/input_file.h"
#include "bus/bus.h"
#include "capture/follower.h"
#include "cli.h"

#include <fcntl.h>
#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>

#define START_WAIT_MS   15000
#define MOST_CONTROL    1024 /* bytes of a control file */
#define LONGEST_FOLDER  80   /* a socket's path is 107 bytes at most */
#define STALE_AFTER_S   60
#define ASK_WAIT_MS     5000
#define MOST_TEXT       (1 << 20) /* bytes, as of every configuration file */
#define CALL_TIMEOUT_MS 600000    /* opening a rig may take its time */

struct Link {
    GDBusConnection *connection;
    BusRig1 *rig;
    GSubprocess *daemon; /* private: ours */
    char *folder;        /* of its socket and log */
};

static gboolean make_proxy(Link *link, const char *name, GError **error) {
    link->rig = bus_rig1_proxy_new_sync(link->connection, G_DBUS_PROXY_FLAGS_DO_NOT_AUTO_START,
                                        name, BUS_PATH, NULL, error);
    if (link->rig)
        g_dbus_proxy_set_default_timeout(G_DBUS_PROXY(link->rig), CALL_TIMEOUT_MS);
    return link->rig != NULL;
}

static gboolean connect_to(Link *link, const char *address, GError **error) {
    link->connection = g_dbus_connection_new_for_address_sync(
        address, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL, error);
    if (!link->connection)
        return FALSE;
    g_dbus_connection_set_exit_on_close(link->connection, FALSE);
    return make_proxy(link, NULL, error);
}

static Link *link_to(const char *address, GError **error) {
    g_autoptr(Link) link = g_new0(Link, 1);
    return connect_to(link, address, error) ? g_steal_pointer(&link) : NULL;
}

/* A proxy is made even for a user who may not call the daemon. */
static gboolean may_ask(BusRig1 *rig, const char *bus, GError **error) {
    g_autoptr(GError) why = NULL;
    if (bus_rig1_get_state(rig))
        return TRUE;
    g_autoptr(GVariant) state = g_dbus_proxy_call_sync(
        G_DBUS_PROXY(rig), "org.freedesktop.DBus.Properties.Get",
        g_variant_new("(ss)", BUS_NAME, "State"), G_DBUS_CALL_FLAGS_NONE, ASK_WAIT_MS, NULL, &why);
    if (state)
        return TRUE;
    if (g_error_matches(why, G_DBUS_ERROR, G_DBUS_ERROR_ACCESS_DENIED))
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_PERMISSION_DENIED,
                    "the rig on the %s bus is for members of the group mesorig: adduser %s "
                    "mesorig, then log in again",
                    bus, g_get_user_name());
    else
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_TIMED_OUT,
                    "mesorigd on the %s bus does not answer: %s", bus, why->message);
    return FALSE;
}

static Link *link_on_bus(const char *bus, GError **error) {
    g_autoptr(Link) link = g_new0(Link, 1);
    const GBusType type = strcmp(bus, "system") == 0 ? G_BUS_TYPE_SYSTEM : G_BUS_TYPE_SESSION;
    g_autoptr(GError) why = NULL;
    link->connection = g_bus_get_sync(type, NULL, &why);
    if (link->connection && make_proxy(link, BUS_NAME, &why)) {
        g_dbus_connection_set_exit_on_close(link->connection, FALSE);
        g_autofree char *owner = g_dbus_proxy_get_name_owner(G_DBUS_PROXY(link->rig));
        if (owner)
            return may_ask(link->rig, bus, error) ? g_steal_pointer(&link) : NULL;
    }
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND, "no mesorigd is on the %s bus%s%s", bus,
                why ? ": " : "", why ? why->message : "");
    return NULL;
}

static const char *runtime_folder(void) {
    const char *folder = g_get_user_runtime_dir();
    return strlen(folder) > LONGEST_FOLDER || g_access(folder, W_OK) != 0 ? g_get_tmp_dir()
                                                                          : folder;
}

static void remove_folder(const char *folder) {
    g_autofree char *socket = g_build_filename(folder, "bus", NULL);
    g_autofree char *log = g_build_filename(folder, "log", NULL);
    g_unlink(socket);
    g_unlink(log);
    g_rmdir(folder);
}

/* The private daemon of this user that answers; folders of killed ones are removed on the way. NULL
 * without an error: there is none. More than one is an error. */
static Link *link_to_private(GError **error) {
    g_autoptr(GPtrArray) links = g_ptr_array_new_with_free_func((GDestroyNotify)link_free);
    g_autoptr(GDir) dir = g_dir_open(runtime_folder(), 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *folder = g_build_filename(runtime_folder(), name, NULL);
        g_autofree char *address = g_strdup_printf("unix:path=%s/bus", folder);
        GStatBuf info;
        if (!g_str_has_prefix(name, "mesorig-") || g_lstat(folder, &info) != 0 ||
            info.st_uid != getuid() || !S_ISDIR(info.st_mode))
            continue;
        Link *link = link_to(address, NULL);
        if (link)
            g_ptr_array_add(links, link);
        else if (info.st_mtime + STALE_AFTER_S < g_get_real_time() / G_USEC_PER_SEC)
            remove_folder(folder);
    }
    if (links->len == 1)
        return g_ptr_array_steal_index(links, 0);
    if (links->len == 0)
        return NULL;
    g_autoptr(GString) sessions = g_string_new(NULL);
    for (guint i = 0; i < links->len; i++)
        g_string_append_printf(sessions, "\n  %s", bus_rig1_get_session(link_rig(links->pdata[i])));
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED,
                "several captures are under way: name one by its session directory%s",
                sessions->str);
    return NULL;
}

/* The address in a session's control file. The directory may belong to others: a link, a file of
 * another user, or something that is not a regular file, is ignored. NULL: nothing. */
static char *read_control(const char *directory) {
    g_autofree char *path = g_build_filename(directory, BUS_CONTROL, NULL);
    const int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    char text[MOST_CONTROL + 1] = "";
    struct stat info;
    gssize n = -1;
    if (fd >= 0 && fstat(fd, &info) == 0 && S_ISREG(info.st_mode) && info.st_size <= MOST_CONTROL)
        n = read(fd, text, MOST_CONTROL);
    const gboolean own = n > 0 && info.st_uid == geteuid();
    if (fd >= 0)
        close(fd);
    g_strstrip(text);
    if (n > 0 && (strcmp(text, "system") == 0 || strcmp(text, "session") == 0))
        return g_strdup(text);
    /* A single address of a local socket: others may name a host, and a file to send to it. */
    return own && g_str_has_prefix(text, "unix:") && !strchr(text, ';') ? g_strdup(text) : NULL;
}

static Link *link_by_directory(const char *directory, GError **error) {
    g_autofree char *text = read_control(directory);
    if (text) {
        const gboolean bus = strcmp(text, "system") == 0 || strcmp(text, "session") == 0;
        Link *link = bus ? link_on_bus(text, NULL) : link_to(text, NULL);
        if (link && (!bus || g_strcmp0(bus_rig1_get_session(link->rig), directory) == 0))
            return link;
        link_free(link);
    }
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                "no daemon captures into %s at present; “mesorig resume” goes on with it",
                directory);
    return NULL;
}

/* A daemon that is running but refuses is an error; no other daemon is tried. */
static Link *link_on_any_bus(GError **error) {
    g_autoptr(GError) why = NULL;
    Link *link = link_on_bus("system", &why);
    if (!link && !g_error_matches(why, G_IO_ERROR, G_IO_ERROR_NOT_FOUND)) {
        g_propagate_error(error, g_steal_pointer(&why));
        return NULL;
    }
    if (!link)
        link = link_on_bus("session", NULL);
    if (!link)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                    "no mesorigd is running: neither for this user nor on the system or session "
                    "bus (systemctl start mesorigd)");
    return link;
}

Link *link_find(const char *directory, GError **error) {
    g_autoptr(GError) several = NULL;
    if (cli_address)
        return link_to(cli_address, error);
    if (cli_bus)
        return link_on_bus(cli_bus, error);
    if (directory)
        return link_by_directory(directory, error);
    Link *link = link_to_private(&several);
    if (several)
        g_propagate_error(error, g_steal_pointer(&several));
    else if (!link)
        link = link_on_any_bus(error);
    return link;
}

Link *link_find_rig(const char *rig_path, GError **error) {
    if (cli_address || cli_bus)
        return link_find(NULL, error);
    const char *const buses[] = {"system", "session"};
    for (gsize i = 0; i < G_N_ELEMENTS(buses); i++) {
        Link *link = link_on_bus(buses[i], NULL);
        if (link && g_strcmp0(bus_rig1_get_rig_path(link->rig), rig_path) == 0)
            return link;
        link_free(link);
    }
    return NULL;
}

/* Between fork and exec. Ctrl-C must reach this process only: the daemon gets its requests over the
 * bus and notices when this process ends. */
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
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED, "mesorigd did not start: %s",
                *log ? log : "it printed no message");
    return FALSE;
}

Link *link_start(GError **error) {
    g_autofree char *program = follower_find_program("mesorigd", error);
    g_autoptr(Link) link = g_new0(Link, 1);
    if (!program)
        return NULL;
    link->folder = g_build_filename(runtime_folder(), "mesorig-XXXXXX", NULL);
    if (!g_mkdtemp_full(link->folder, 0700)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED, "cannot make a folder in %s: %s",
                    runtime_folder(), g_strerror(errno));
        g_clear_pointer(&link->folder, g_free);
        return NULL;
    }
    g_autofree char *address = g_strdup_printf("unix:path=%s/bus", link->folder);
    g_autofree char *log = g_build_filename(link->folder, "log", NULL);
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
        remove_folder(link->folder);
    g_free(link->folder);
    g_free(link);
}

BusRig1 *link_rig(Link *link) {
    return link->rig;
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
    g_autofree char *text = input_file_read_text(path, MOST_TEXT, error);
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
