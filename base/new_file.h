/*
 * A file that appears under its name only when it is whole: written beside it under a name that
 * nobody else has, then renamed. Neither follows a symbolic link. What a killed process leaves is
 * called NAME.XXXXXXXX.part. Any thread.
 */
#pragma once

#include <glib.h>

struct new_file {
    int folder, fd;
    char *name, *beside;
};

/* relative to directory; the folders that it names are no symbolic links, which directory may be.
 * FALSE: errno says why. */
gboolean new_file_begin(struct new_file *file, const char *directory, const char *relative);

/* In its place; sync: on disk when it returns, folder entry included. Either ends it. */
gboolean new_file_commit(struct new_file *file, gboolean sync); /* FALSE: errno */
void new_file_abandon(struct new_file *file);

/* Removes what killed processes have left of files in a folder of directory whose names begin with
 * prefix. Nobody may be writing such files. */
void new_file_remove_left(const char *directory, const char *folder, const char *prefix);
