/*
 * A lock for who writes a file: the kernel gives it back when its holder ends, however it ends. The
 * lock is a file of its own, which tells the holder's process number and is removed with the lock.
 * Any thread.
 */
#pragma once

#include <gio/gio.h>

/* Never waits. −1: error, G_IO_ERROR_BUSY where another holds it. what is being made, for the
 * message: "products of this session". */
int file_lock_take(const char *path, const char *what, GError **error);
void file_lock_give(int lock, const char *path); /* −1 is ignored */

/* Asks only; who takes the lock meanwhile is not disturbed. */
gboolean file_lock_is_held(const char *path);
