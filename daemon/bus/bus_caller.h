/* A user who calls a method, with the user's groups. The function checks the user's rights to a
 * folder. Any thread may call it. */
#pragma once

#include <glib.h>

#define BUS_CALLER_GROUPS 256 /* maximum number of groups of a user; further ones are ignored */

struct bus_caller {
    guint32 uid;
    guint32 groups[BUS_CALLER_GROUPS];
    int n_groups;
};

/* Returns TRUE if the caller may make or change files in the folder. Otherwise returns FALSE with
 * BUS_ERROR_DENIED; the message names the folder. The daemon needs this check because it has more
 * rights than its callers.
 *
 * If the folder does not exist yet, the caller must have the right to make it: each folder of the
 * path must let the caller pass, and the last one that exists must let the caller write.
 *
 * Owner, group and mode of the folders decide. Access control lists are not read. In a folder with
 * such a list, the mode shows the mask of the list as the rights of the group. */
gboolean bus_caller_may_write(const struct bus_caller *caller, const char *directory,
                              GError **error);
