/*
 * Writes a file so that it appears under its name only when it is complete: it is written under a
 * unique name in the same folder and then renamed. Neither step follows a symbolic link. A device,
 * pipe or socket of that name is an error (EEXIST). A killed process leaves a file
 * NAME.XXXXXXXX.part. A file that a user has named is written through output_file.h. Any thread.
 */
#pragma once

#include <glib.h>

struct new_file {
    int folder, fd;
    char *name, *beside;
};

/* relative: path below directory. Its folders must not be symbolic links; directory may be one.
 * FALSE: errno says why. */
gboolean new_file_begin(struct new_file *file, const char *directory, const char *relative);

/* Writes n bytes to a descriptor, in as many steps as that takes. FALSE: errno says why. */
gboolean new_file_write(int fd, const void *bytes, gsize n);

/* Makes the file that long and reserves its space, so that a full disk is an error now. Where the
 * file system cannot reserve space, the file only gets its length. FALSE: errno says why. */
gboolean new_file_reserve(const struct new_file *file, gsize n);

/* Appends n bytes to the file. Returns FALSE and sets errno on failure. */
gboolean new_file_put(const struct new_file *file, const void *bytes, gsize n);

/* Renames the file to its name; sync: the file and its folder entry are on disk on return. For each
 * file begun, call either commit or abandon, once. */
gboolean new_file_commit(struct new_file *file, gboolean sync); /* FALSE: errno */
void new_file_abandon(struct new_file *file);

/* Removes, in a folder of directory, the .part files and folders that killed processes left for
 * names that begin with prefix. No process may be writing such files. */
void new_file_remove_left(const char *directory, const char *folder, const char *prefix);
