/* Writes a file that is in memory as a whole; see new_file.h. Any thread. */
#pragma once

#include <gio/gio.h>

/* Writes a file, which appears under its name when all of it is on disk, and then replaces an
 * existing one. Errors, DATA_ERROR_IO, name the file. */
gboolean output_file_write(const char *path, const void *bytes, gsize n, GError **error);
