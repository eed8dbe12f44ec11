#include "maps_files.h"

#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <stdio.h>
#include <unistd.h>

#include "base/data_error.h"
#include "base/new_file.h"
#include "base/output_file.h"

struct maps_file {
    char *name;
    GBytes *bytes;
};

static void free_one(gpointer data) {
    struct maps_file *file = data;
    g_free(file->name);
    g_bytes_unref(file->bytes);
    g_free(file);
}

MapsFiles *maps_files_new(void) {
    return g_ptr_array_new_with_free_func(free_one);
}

void maps_files_free(MapsFiles *files) {
    g_clear_pointer(&files, g_ptr_array_unref);
}

void maps_files_take(MapsFiles *files, char *name, GBytes *bytes) {
    struct maps_file *file = g_new(struct maps_file, 1);
    *file = (struct maps_file){name, bytes};
    g_ptr_array_add(files, file);
}

void maps_files_take_text(MapsFiles *files, char *name, GString *text) {
    maps_files_take(files, name, g_string_free_to_bytes(text));
}

static gboolean exists(const char *path, GError **error) {
    g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS,
                "%s exists already: give another name, or --force to replace it", path);
    return FALSE;
}

static gboolean maps_files_io(const char *path, int number, GError **error) {
    const gboolean full = number == ENOSPC || number == EDQUOT;
    g_set_error(error, DATA_ERROR, DATA_ERROR_IO, "%s cannot be written: %s%s", path,
                g_strerror(number),
                full ? "; free some space and export again"
                     : "; check the access rights of its folder, and the disk");
    return FALSE;
}

gboolean maps_files_check(const char *path, gboolean replace, GError **error) {
    struct stat status;
    g_autofree char *folder = g_path_get_dirname(path);
    if (!replace && g_lstat(path, &status) == 0)
        return exists(path, error);
    if (!g_file_test(folder, G_FILE_TEST_IS_DIR)) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_IO,
                    "%s cannot be written: there is no folder %s; make it first", path, folder);
        return FALSE;
    }
    return TRUE;
}

/* Writes a file into an existing folder. Returns FALSE with errno set if it cannot be written. */
static gboolean write_one(const struct maps_file *file, const char *folder) {
    struct new_file to;
    if (!new_file_begin(&to, folder, file->name))
        return FALSE;
    gsize size;
    const void *data = g_bytes_get_data(file->bytes, &size);
    if (new_file_put(&to, data, size))
        return new_file_commit(&to, TRUE);
    new_file_abandon(&to);
    return FALSE;
}

/* Writes a file into a folder of the user. Also fails if the file exists and replace is FALSE. */
static gboolean write_output(const struct maps_file *file, const char *folder, gboolean replace,
                             GError **error) {
    g_autofree char *path = g_build_filename(folder, file->name, NULL);
    g_autoptr(OutputFile) to = output_file_new(path, NULL, replace, error);
    gsize size;
    const void *data = g_bytes_get_data(file->bytes, &size);
    return to && output_file_put(to, data, size, error);
}

static void maps_files_remove(const MapsFiles *files, guint first, const char *folder) {
    for (guint i = first; i < files->len; i++) {
        const struct maps_file *file = files->pdata[i];
        g_autofree char *path = g_build_filename(folder, file->name, NULL);
        g_unlink(path);
    }
}

/* Writes all files into an existing folder, and replaces files of the same names. Stops with an
 * error at the first file that cannot be written. */
static gboolean maps_files_replace(const MapsFiles *files, const char *path, GError **error) {
    for (guint i = 0; i < files->len; i++)
        if (!write_output(files->pdata[i], path, TRUE, error))
            return FALSE;
    return TRUE;
}

gboolean maps_files_write_folder(const MapsFiles *files, const char *path, gboolean replace,
                                 GError **error) {
    g_autofree char *parent = g_path_get_dirname(path), *name = g_path_get_basename(path);
    g_autofree char *hidden = g_strdup_printf("%s/.%s.XXXXXX", parent, name);
    if (replace && g_file_test(path, G_FILE_TEST_IS_DIR))
        return maps_files_replace(files, path, error);
    if (!maps_files_check(path, FALSE, error))
        return FALSE;
    if (!g_mkdtemp_full(hidden, 0777))
        return maps_files_io(path, errno, error);
    int number = 0;
    for (guint i = 0; i < files->len && !number; i++)
        if (!write_one(files->pdata[i], hidden))
            number = errno ? errno : EIO;
    if (!number)
        return output_file_move_folder(hidden, path, error);
    maps_files_remove(files, 0, hidden);
    g_rmdir(hidden);
    return maps_files_io(path, number, error);
}

gboolean maps_files_write_beside(const MapsFiles *files, const char *path, gboolean replace,
                                 GError **error) {
    g_autofree char *folder = g_path_get_dirname(path);
    for (guint i = 0; i < files->len; i++) {
        const struct maps_file *file = files->pdata[i];
        g_autofree char *one = g_build_filename(folder, file->name, NULL);
        if (!output_file_check(one, NULL, replace, error))
            return FALSE;
    }
    for (guint i = files->len; i-- > 0;) {
        if (write_output(files->pdata[i], folder, replace, error))
            continue;
        if (!replace)
            maps_files_remove(files, i + 1, folder);
        return FALSE;
    }
    return TRUE;
}
