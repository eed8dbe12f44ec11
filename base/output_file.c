#include "output_file.h"

#include <errno.h>

#include "data_error.h"
#include "new_file.h"

static gboolean output_file_fail(const char *path, GError **error) {
    const int saved = errno;
    g_set_error(error, DATA_ERROR, DATA_ERROR_IO,
                saved == ENOSPC || saved == EDQUOT ? "%s: cannot be written, the disk is full: %s"
                                                   : "%s: cannot be written: %s",
                path, g_strerror(saved));
    return FALSE;
}

gboolean output_file_write(const char *path, const void *bytes, gsize n, GError **error) {
    g_autofree char *folder = g_path_get_dirname(path), *name = g_path_get_basename(path);
    struct new_file file;
    if (!new_file_begin(&file, folder, name))
        return output_file_fail(path, error);
    if (!new_file_put(&file, bytes, n)) {
        new_file_abandon(&file);
        return output_file_fail(path, error);
    }
    return new_file_commit(&file, TRUE) || output_file_fail(path, error);
}
