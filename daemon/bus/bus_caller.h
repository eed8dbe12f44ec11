/* A user as the kernel knows the user, and the user's rights to a folder. Any thread may call the
 * function. */
#pragma once

#include <gio/gio.h>

#define BUS_CALLER_GROUPS 256 /* of a user; further groups do not count */

struct bus_caller {
    guint32 uid;
    guint32 groups[BUS_CALLER_GROUPS];
    int n_groups;
};

/* Returns TRUE if the caller may make or change files in the folder. If the folder does not exist
 * yet, the caller must have the right to make it: each folder of the path must let the caller pass,
 * and the last one that exists must let the caller write. Owner, group and mode decide. Of an
 * access list, only the mask counts. Processes with more rights than their callers need this check.
 * The error is BUS_ERROR_DENIED, with folder and mode. */
gboolean bus_caller_may_write(const struct bus_caller *caller, const char *directory,
                              GError **error);
