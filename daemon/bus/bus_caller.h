/* A user as the kernel knows one, and what that user may do with a folder. Any thread. */
#pragma once

#include <gio/gio.h>

#define BUS_CALLER_GROUPS 256 /* of a user at most; the others do not count */

struct bus_caller {
    guint32 uid;
    guint32 groups[BUS_CALLER_GROUPS];
    int n_groups;
};

/* TRUE if the caller may make or change files in the folder, or, if there is none yet, may make it:
 * each folder on the way lets the caller pass, the last one that exists lets the caller write. By
 * owner, group and mode; an access list is as its mask says. It is there for processes that may do
 * more than their callers. Error: BUS_ERROR_DENIED, with folder and mode. */
gboolean bus_caller_may_write(const struct bus_caller *caller, const char *directory,
                              GError **error);
