/*
 * A lock for the writer of a file. The kernel releases it when its holder ends, however it ends.
 * The lock is a separate file that holds the process number of its holder and is removed with the
 * lock. Any thread.
 */
#pragma once

#include <gio/gio.h>

/* Takes the lock, without waiting. −1: error, G_IO_ERROR_BUSY if another process holds it. what:
 * names the files to be written, for the message: "products of this session". */
int file_lock_take(const char *path, const char *what, GError **error);

/* Takes the lock for writing the file at path; *ret_lock is PATH.lock (g_free()) in any case.
 * Removes the unfinished files that killed writers left beside it. */
int file_lock_take_output(const char *path, char **ret_lock, GError **error);

void file_lock_give(int lock, const char *path); /* −1 is ignored */

/* Tells whether the file is locked, without taking the lock even for a moment. */
gboolean file_lock_is_held(const char *path);
