/*
 * Writes a file so that it appears under its name only when it is complete. The file is written
 * under a unique name in the same folder and then renamed. Neither step follows a symbolic link. If
 * the name belongs to a device, pipe or socket, the error is EEXIST. A killed process leaves a file
 * NAME.XXXXXXXX.part.
 *
 * Files that a user has named are written through output_file.h. Any thread may call these
 * functions.
 */
#pragma once

#include <glib.h>

struct new_file {
    int folder, fd;      /* descriptors of the folder and of the unfinished file */
    char *name, *beside; /* the final name, and the name of the unfinished file */
};

/* Begins a file. `relative` is its path below directory. The folders in `relative` must exist and
 * must not be symbolic links; directory may be one. Returns FALSE and sets errno on failure. */
gboolean new_file_begin(struct new_file *file, const char *directory, const char *relative);

/* Writes n bytes to a descriptor, with as many calls of write() as necessary. Returns FALSE and
 * sets errno on failure. */
gboolean new_file_write(int fd, const void *bytes, gsize n);

/* Sets the length of the file and reserves its space on disk, so that a full disk is reported now.
 * On a file system that cannot reserve space, only the length is set. Returns FALSE and sets errno
 * on failure. */
gboolean new_file_reserve(const struct new_file *file, gsize n);

/* Appends n bytes to the file. Returns FALSE and sets errno on failure. */
gboolean new_file_put(const struct new_file *file, const void *bytes, gsize n);

/* new_file_commit() gives the file its name. If sync is TRUE, the file and its folder entry are on
 * disk when the function returns. On failure it returns FALSE, sets errno, and removes the file. If
 * only the sync of the folder entry fails, it also returns FALSE, but the file keeps its name.
 *
 * new_file_abandon() removes the file. Call one of the two once for each file that was begun. */
gboolean new_file_commit(struct new_file *file, gboolean sync);
void new_file_abandon(struct new_file *file);

/* Removes the .part files and folders that killed processes have left in a folder. `folder` is the
 * path of this folder below directory, or "" for directory itself. Only files for names that begin
 * with prefix are removed. Call the function only while no process writes such files. */
void new_file_remove_left(const char *directory, const char *folder, const char *prefix);
