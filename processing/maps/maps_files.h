/* The files of an export. All files are made in memory before the first is written. If replace is
 * FALSE, either all of them appear or none. Any thread. */
#pragma once

#include <glib.h>

typedef GPtrArray MapsFiles;

MapsFiles *maps_files_new(void);
void maps_files_free(MapsFiles *files); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MapsFiles, maps_files_free)
void maps_files_take(MapsFiles *files, char *name, GBytes *bytes); /* takes ownership of both */
void maps_files_take_text(MapsFiles *files, char *name, GString *text);

/* Fails with DATA_ERROR_EXISTS if the path exists and may not be replaced, and with DATA_ERROR_IO
 * if its folder does not exist. An export calls this before long work. */
gboolean maps_files_check(const char *path, gboolean replace, GError **error);

/* Makes the folder path with the files. If replace is FALSE, the folder must not exist. If replace
 * is TRUE and the folder exists, the files are written into it and replace files of the same names;
 * other files in the folder are kept. */
gboolean maps_files_write_folder(const MapsFiles *files, const char *path, gboolean replace,
                                 GError **error);
/* Writes the files into the folder that contains path. If replace is FALSE, none of the files may
 * exist. The first file is written last. */
gboolean maps_files_write_beside(const MapsFiles *files, const char *path, gboolean replace,
                                 GError **error);
