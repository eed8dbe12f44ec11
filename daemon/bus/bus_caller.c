#include "bus_caller.h"

#include "bus_errors.h"

#include <errno.h>
#include <string.h>
#include <sys/stat.h>

/* Returns the three permission bits (read, write, execute) that apply to the caller: those of the
 * owner, of the group, or of others. */
static guint caller_rights(const struct bus_caller *caller, const struct stat *info) {
    if (caller->uid == info->st_uid)
        return (guint)(info->st_mode >> 6) & 7;
    for (int i = 0; i < caller->n_groups; i++)
        if (caller->groups[i] == info->st_gid)
            return (guint)(info->st_mode >> 3) & 7;
    return (guint)info->st_mode & 7;
}

static gboolean caller_denied(const char *folder, const struct stat *info, const char *what,
                              GError **error) {
    g_set_error(error, BUS_ERROR, BUS_ERROR_DENIED,
                "you may not %s %s (mode %04o): choose another folder, or have the rights of this "
                "one changed",
                what, folder, (guint)info->st_mode & 07777);
    return FALSE;
}

gboolean bus_caller_may_write(const struct bus_caller *caller, const char *directory,
                              GError **error) {
    g_autofree char *nearest = g_canonicalize_filename(directory, "/");
    g_autofree char *real = NULL;
    struct stat info;
    while (!(real = realpath(nearest, NULL)) && errno == ENOENT && strcmp(nearest, "/") != 0) {
        char *parent = g_path_get_dirname(nearest);
        g_free(nearest);
        nearest = parent;
    }
    if (!real || stat(real, &info) != 0) {
        g_set_error(error, BUS_ERROR, BUS_ERROR_DENIED,
                    "your rights in %s are not known: %s; choose another directory for the session",
                    nearest, g_strerror(errno));
        return FALSE;
    }
    if (!S_ISDIR(info.st_mode)) {
        g_set_error(error, BUS_ERROR, BUS_ERROR_DENIED,
                    "%s is not a folder: choose another directory for the session", real);
        return FALSE;
    }
    if ((caller_rights(caller, &info) & 3) != 3)
        return caller_denied(real, &info, "write in", error);
    while (strcmp(real, "/") != 0) {
        char *parent = g_path_get_dirname(real);
        g_free(real);
        real = parent;
        if (stat(real, &info) != 0) {
            g_set_error(
                error, BUS_ERROR, BUS_ERROR_DENIED,
                "your rights in %s are not known: %s; choose another directory for the session",
                real, g_strerror(errno));
            return FALSE;
        }
        if (!(caller_rights(caller, &info) & 1))
            return caller_denied(real, &info, "enter", error);
    }
    return TRUE;
}
