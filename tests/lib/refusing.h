/* Imitates file systems with fewer functions than the native ones of Linux, such as FUSE, NFS and
 * exFAT. */
#pragma once

#include <glib.h>

/* From now on, three system calls fail in this thread and in every program that it starts: a rename
 * with flags, such as “do not replace”, with EINVAL; the reservation of space with EOPNOTSUPP; and,
 * unless links is TRUE, a hard link with EPERM. This cannot be undone. */
void refusing_begin(gboolean links);
