/* A stand-in for file systems that can do less than Linux's own, as FUSE, NFS and exFAT. */
#pragma once

#include <glib.h>

/* From now on this thread, and every program that it starts, gets EINVAL for a rename that must not
 * replace anything, EOPNOTSUPP for space that is to be reserved, and without links EPERM for a hard
 * link. There is no way back. */
void refusing_begin(gboolean links);
