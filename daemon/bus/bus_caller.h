/* A user as the kernel knows one, and what that user may do with a folder. Any thread. */
#pragma once

#include <gio/gio.h>

#define BUS_CALLER_GROUPS 256 /* of a user at most; the others do not count */

struct bus_caller {
    guint32 uid;
    guint32 groups[BUS_CALLER_GROUPS];
    int n_groups;
};

/* TRUE if the caller may make or change files in the folder or, if the folder does not exist yet,
 * may make it: each folder of the path lets the caller pass, and the last one that exists lets the
 * caller write. Owner, group and mode decide; of an access list, only the mask counts. Processes
 * that may do more than their callers need this check. Error: BUS_ERROR_DENIED, with folder and
 * mode. */
gboolean bus_caller_may_write(const struct bus_caller *caller, const char *directory,
                              GError **error);
