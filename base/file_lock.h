/*
 * A lock for the writer of a file. The lock is a separate file that contains the process number of
 * its holder. file_lock_give() releases the lock and removes that file. If the holder ends for any
 * other reason, the kernel releases the lock, and the file remains. Any thread may call these
 * functions.
 */
#pragma once

#include <glib.h>

/* Takes the lock at path. Does not wait if another process holds the lock. Returns a descriptor for
 * file_lock_give(). Returns −1 with an error on failure; the error is G_IO_ERROR_BUSY if another
 * process holds the lock. `what` names the files that the lock protects, for the error message:
 * "products of this session". */
int file_lock_take(const char *path, const char *what, GError **error);

/* Takes the lock for writing the file at path. The path of the lock is PATH.lock, and *ret_lock is
 * always set to it; free it with g_free(). If the lock was taken, removes the unfinished files next
 * to path that killed writers have left. Returns a descriptor, or −1 with an error, as
 * file_lock_take() does. */
int file_lock_take_output(const char *path, char **ret_lock, GError **error);

/* Releases the lock at path and removes its file. lock is the descriptor that was returned for it;
 * −1 is ignored. */
void file_lock_give(int lock, const char *path);

/* Returns whether another open descriptor holds the lock at path. Does not take the lock, even for
 * a moment. */
gboolean file_lock_is_held(const char *path);
