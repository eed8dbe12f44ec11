/* The files of an export. All files are made in memory before the first is written. If replace is
 * FALSE, either all of them appear or none. Any thread. */
#pragma once

#include <gio/gio.h>

typedef GPtrArray MapsFiles;

MapsFiles *maps_files_new(void);
void maps_files_free(MapsFiles *files); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MapsFiles, maps_files_free)
void maps_files_take(MapsFiles *files, char *name, GBytes *bytes); /* takes ownership of both */
void maps_files_take_text(MapsFiles *files, char *name, GString *text);

/* Fails with DATA_ERROR_EXISTS if the path exists and may not be replaced, and with DATA_ERROR_IO
 * if its folder does not exist. An export calls this before long work. */
gboolean maps_files_check(const char *path, gboolean replace, GError **error);

/* Makes the folder path with the files. If replace is FALSE, the folder must not exist. Otherwise
 * the files are written into an existing folder, and replace files with the same names. Other files
 * in the folder are kept. */
gboolean maps_files_write_folder(const MapsFiles *files, const char *path, gboolean replace,
                                 GError **error);
/* Writes the files into the folder that contains path. None of the files may exist unless replace
 * is set. The first file is written last. */
gboolean maps_files_write_beside(const MapsFiles *files, const char *path, gboolean replace,
                                 GError **error);
