/*
 * What an export writes: files that are made in memory, so that all of them appear or none does.
 * Any thread.
 */
#pragma once

#include <gio/gio.h>

typedef GPtrArray MapsFiles;

MapsFiles *maps_files_new(void);
void maps_files_free(MapsFiles *files); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MapsFiles, maps_files_free)
void maps_files_take(MapsFiles *files, char *name, GBytes *bytes); /* takes both */
void maps_files_take_text(MapsFiles *files, char *name, GString *text);

/* FALSE with DATA_ERROR_EXISTS if something has the name and may not be replaced, or DATA_ERROR_IO
 * if there is no folder to put it into: to be asked before long work. */
gboolean maps_files_check(const char *path, gboolean replace, GError **error);

/* Makes a folder of that name with the files; it must not exist. replace: if it does, the files go
 * into it, each in place of one of its name, and what else is there stays. */
gboolean maps_files_write_folder(const MapsFiles *files, const char *path, gboolean replace,
                                 GError **error);
/* Writes the files into the folder of path, none of which may exist unless replace is set; the
 * first one the last. */
gboolean maps_files_write_beside(const MapsFiles *files, const char *path, gboolean replace,
                                 GError **error);
