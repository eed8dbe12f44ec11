/* Finds the daemon that a command means. If this is not clear, the command fails and lists the
 * daemons, because it could otherwise act on somebody else's capture. */
#include "bus/bus.h"
#include "bus/bus_client.h"
#include "cli.h"
#include "link_private.h"

#include <fcntl.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MAX_CONTROL   1024 /* maximum size of a control file in bytes */
#define STALE_AFTER_S 60   /* age in seconds from which the folder of a dead daemon is removed */

static const char *const buses[] = {"system", "session"};

static const char *session_of(Link *link) {
    const char *session = bus_rig1_get_session(link->rig);
    return session ? session : "";
}

static const char *rig_of(Link *link) {
    const char *rig = bus_rig1_get_rig_path(link->rig);
    return rig ? rig : "";
}

/* Adds a link to the list and takes ownership of it. A link to a daemon that is already in the list
 * is freed. link may be NULL. */
static void add(GPtrArray *links, Link *link) {
    if (!link)
        return;
    const char *guid = g_dbus_connection_get_guid(link->connection);
    for (guint i = 0; i < links->len; i++) {
        const Link *other = links->pdata[i];
        if (g_strcmp0(g_dbus_connection_get_guid(other->connection), guid) == 0) {
            link_free(link);
            return;
        }
    }
    g_ptr_array_add(links, link);
}

/* Connects to the daemon of a folder (bus_client.h). Returns NULL if the folder belongs to another
 * user or the daemon cannot be reached. Removes the folder if no daemon listens there and the
 * folder is older than STALE_AFTER_S, because its daemon was then killed. */
static Link *in_folder(const char *folder) {
    g_autofree char *at = g_build_filename(folder, "bus", NULL);
    g_autofree char *target = g_file_read_link(at, NULL);
    g_autofree char *path = g_dbus_address_escape_value(target ? target : at);
    g_autofree char *address = g_strconcat("unix:path=", path, NULL);
    g_autoptr(GError) error = NULL;
    GStatBuf info;
    if (g_lstat(folder, &info) != 0 || info.st_uid != getuid() || !S_ISDIR(info.st_mode))
        return NULL;
    Link *link = link_to(address, &error);
    if (link)
        link->passing = !target;
    else if ((g_error_matches(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND) ||
              g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CONNECTION_REFUSED)) &&
             info.st_mtime + STALE_AFTER_S < g_get_real_time() / G_USEC_PER_SEC)
        bus_client_remove_folder(folder);
    return link;
}

/* Returns links to all daemons that this user may call: first the user's own daemons, then those on
 * buses. */
static GPtrArray *find_all(void) {
    GPtrArray *links = g_ptr_array_new_with_free_func((GDestroyNotify)link_free);
    g_autoptr(GDir) dir = g_dir_open(bus_client_folder(), 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *folder = g_build_filename(bus_client_folder(), name, NULL);
        if (g_str_has_prefix(name, "mesorig-"))
            add(links, in_folder(folder));
    }
    if (bus_client_address())
        add(links, link_to(bus_client_address(), NULL));
    for (gsize i = 0; i < G_N_ELEMENTS(buses); i++)
        add(links, link_on_bus(buses[i], NULL));
    return links;
}

static char *list(const GPtrArray *links) {
    GString *text = g_string_new(NULL);
    for (guint i = 0; i < links->len; i++) {
        Link *link = links->pdata[i];
        const char *state = bus_rig1_get_state(link->rig);
        g_string_append_printf(text, "\n  %s\n    rig %s, %s%s%s%s", link->option,
                               *rig_of(link) ? rig_of(link) : "none",
                               *session_of(link) ? "session " : "", session_of(link),
                               *session_of(link) ? ", " : "", state ? state : "no answer");
    }
    return g_string_free(text, FALSE);
}

/* Returns the link if the list has only one, and removes it from the list. Returns NULL without an
 * error if the list is empty, and NULL with an error that lists the daemons if there are
 * several. */
static Link *the_only(GPtrArray *links, GError **error) {
    if (links->len == 1)
        return g_ptr_array_steal_index(links, 0);
    if (links->len == 0)
        return NULL;
    g_autofree char *text = list(links);
    g_set_error(
        error, G_IO_ERROR, G_IO_ERROR_FAILED,
        "%u daemons are running; say which one is meant, by its session directory or by one "
        "of these options (%s may hold an address for all commands):%s",
        links->len, BUS_CLIENT_VARIABLE, text);
    return NULL;
}

/* Returns the address in a session's control file, or NULL if there is none. The directory may
 * belong to other users. The control file is therefore ignored if it is a symbolic link or not a
 * regular file. If it belongs to another user, it counts only if it says "system" or "session". */
static char *read_control(const char *directory) {
    g_autofree char *path = g_build_filename(directory, BUS_CONTROL, NULL);
    const int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    char text[MAX_CONTROL + 1] = "";
    struct stat info;
    gssize n = -1;
    if (fd >= 0 && fstat(fd, &info) == 0 && S_ISREG(info.st_mode) && info.st_size <= MAX_CONTROL)
        n = read(fd, text, MAX_CONTROL);
    const gboolean own = n > 0 && info.st_uid == geteuid();
    if (fd >= 0)
        close(fd);
    g_strstrip(text);
    if (n > 0 && (strcmp(text, "system") == 0 || strcmp(text, "session") == 0))
        return g_strdup(text);
    /* Only a single address of a local socket is accepted. Another address could name a host, and a
     * file whose contents would be sent to that host. */
    return own && g_str_has_prefix(text, "unix:") && !strchr(text, ';') ? g_strdup(text) : NULL;
}

static Link *by_directory(const char *directory, GError **error) {
    g_autofree char *text = read_control(directory);
    if (text) {
        const gboolean bus = strcmp(text, "system") == 0 || strcmp(text, "session") == 0;
        Link *link = bus ? link_on_bus(text, NULL) : link_to(text, NULL);
        if (link && (!bus || g_strcmp0(bus_rig1_get_session(link->rig), directory) == 0))
            return link;
        link_free(link);
    }
    g_set_error(
        error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
        "no daemon captures into %s at present; to continue that session: mesorig resume %s",
        directory, directory);
    return NULL;
}

/* Looks for a daemon on the buses once more, after no daemon that this user may call was found. If
 * a daemon on a bus refuses this user, fails with the error of that daemon, because the user
 * probably meant it. */
static Link *none_at_all(GError **error) {
    for (gsize i = 0; i < G_N_ELEMENTS(buses); i++) {
        g_autoptr(GError) why = NULL;
        Link *link = link_on_bus(buses[i], &why);
        if (link)
            return link;
        if (!g_error_matches(why, G_IO_ERROR, G_IO_ERROR_NOT_FOUND)) {
            g_propagate_error(error, g_steal_pointer(&why));
            return NULL;
        }
    }
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                "no mesorigd is running, neither for this user nor on the system or session bus; "
                "start one: systemctl start mesorigd, or mesorigd --listen unix:path=/tmp/NAME "
                "--rig RIG (a mesorigd that was started with another XDG_RUNTIME_DIR is found only "
                "with --address or %s)",
                BUS_CLIENT_VARIABLE);
    return NULL;
}

/* Connects according to --address or --bus. Returns NULL without an error if neither was given. */
static Link *named(GError **error) {
    return cli_address ? link_to(cli_address, error) : cli_bus ? link_on_bus(cli_bus, error) : NULL;
}

static Link *named_for(const char *directory, GError **error) {
    g_autoptr(Link) link = named(error);
    if (!link || !directory || g_str_equal(session_of(link), directory))
        return g_steal_pointer(&link);
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                "%s names a daemon that does not capture %s (it captures %s); leave out %s, or "
                "leave out the directory",
                link->option, directory, *session_of(link) ? session_of(link) : "nothing",
                link->option);
    return NULL;
}

Link *link_find(const char *directory, GError **error) {
    GError *why = NULL;
    if (cli_address || cli_bus)
        return named_for(directory, error);
    if (directory)
        return by_directory(directory, error);
    if (bus_client_address())
        return link_to(bus_client_address(), error);
    g_autoptr(GPtrArray) links = find_all();
    Link *link = the_only(links, &why);
    if (!link && !why)
        link = none_at_all(&why);
    if (why)
        g_propagate_error(error, why);
    return link;
}

/* Keeps only the links whose daemon has this rig open, or no rig if rig_path is "". Private daemons
 * of other programs are removed too. */
static void keep_rig(GPtrArray *links, const char *rig_path) {
    for (guint i = links->len; i-- > 0;) {
        Link *link = links->pdata[i];
        if (link->passing || !g_str_equal(rig_of(link), rig_path))
            g_ptr_array_remove_index(links, i);
    }
}

Link *link_find_rig(const char *rig_path, GError **error) {
    if (cli_address || cli_bus)
        return named(error);
    g_autoptr(GPtrArray) links = find_all();
    keep_rig(links, rig_path);
    return the_only(links, error);
}

Link *link_find_free(const char *rig_path, GError **error) {
    GError *why = NULL;
    if (cli_address || cli_bus)
        return named(error);
    if (bus_client_address())
        return link_to(bus_client_address(), error);
    g_autoptr(GPtrArray) links = find_all();
    if (links->len == 0) {
        Link *found = none_at_all(&why);
        if (g_error_matches(why, G_IO_ERROR, G_IO_ERROR_NOT_FOUND)) {
            g_clear_error(&why);
            g_set_error(&why, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                        "%s has real devices, which only mesorigd opens, and none is running; "
                        "start it: mesorigd --listen unix:path=/tmp/NAME --rig %s (a mesorigd that "
                        "was started with another XDG_RUNTIME_DIR is found only with --address or "
                        "%s)",
                        rig_path, rig_path, BUS_CLIENT_VARIABLE);
        }
        if (why)
            g_propagate_error(error, why);
        return found;
    }
    g_autofree char *text = list(links);
    keep_rig(links, "");
    Link *link = the_only(links, &why);
    if (why)
        g_propagate_error(error, why);
    else if (!link)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                    "no mesorigd has the rig %s open, and none is free to open it; start one: "
                    "mesorigd --listen unix:path=/tmp/NAME --rig %s. The running daemons are:%s",
                    rig_path, rig_path, text);
    return link;
}

char *link_again(const Link *link) {
    return cli_address || cli_bus ? g_strconcat(" ", link->option, NULL) : g_strdup("");
}
