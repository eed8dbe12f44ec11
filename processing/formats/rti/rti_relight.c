#include "rti.h"

#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <stdio.h>
#include <string.h>

#include "base/data_error.h"
#include "base/output_file.h"
#include "base/png_bytes.h"

#define TERMS RTI_PTM_TERMS

/* order[j] is the index, in .ptm files, of term j of Relight's order 1, lx, ly, lx², lx ly, ly². */
static const gsize order[TERMS] = {5, 3, 4, 0, 2, 1};

/* Returns the index, in .ptm files, of the term that channel k contains. Returns −1 if channel k
 * contains the texel's colour. Channels are counted over all planes. */
static int rti_term(const struct rti *rti, int k) {
    if (!rti->lrgb)
        return (int)order[k / 3];
    return k < 3 ? -1 : (int)order[k - 3];
}

static gboolean write_plane(const char *folder, const struct rti *rti, int plane, GError **error) {
    const gsize texels = (gsize)rti->width * (gsize)rti->height;
    g_autofree guint8 *rgb = g_malloc(3 * texels);
    g_autofree char *name = g_strdup_printf("plane_%d.png", plane);
    g_autofree char *path = g_build_filename(folder, name, NULL);
    for (gsize i = 0; i < texels; i++)
        for (gsize c = 0; c < 3; c++) {
            const int term = rti_term(rti, 3 * plane + (int)c);
            if (term < 0)
                rgb[3 * i + c] = rti->colours[3 * i + c];
            else
                rgb[3 * i + c] = rti->bytes[(rti->lrgb ? i : 3 * i + c) * TERMS + (gsize)term];
        }
    g_autoptr(GBytes) png = png_bytes(rgb, rti->width, rti->height, error);
    return png &&
           output_file_write(path, g_bytes_get_data(png, NULL), g_bytes_get_size(png), error);
}

static void append(GString *text, gboolean first, double value) {
    char number[G_ASCII_DTOSTR_BUF_SIZE];
    g_string_append_printf(text, "%s%s", first ? "" : ", ",
                           g_ascii_formatd(number, sizeof number, "%.9g", value));
}

/* Writes info.json. OpenLIME computes c = (byte / 255 − bias) · scale. The scale in the file is
 * therefore 255 times that of struct rti, and the bias in the file is that of struct rti divided by
 * 255. */
static gboolean write_info(const char *folder, const struct rti *rti, const float *lights, int n,
                           double texel_mm, GError **error) {
    const int channels = rti->lrgb ? 9 : 18;
    g_autoptr(GString) text = g_string_new(NULL);
    g_autofree char *path = g_build_filename(folder, "info.json", NULL);
    g_string_printf(text,
                    "{\n\"width\": %d, \"height\": %d,\n\"format\": \"png\",\n\"type\": \"ptm\",\n"
                    "\"colorspace\": \"%s\",\n\"nplanes\": %d,\n\"pixelSizeInMM\": ",
                    rti->width, rti->height, rti->lrgb ? "lrgb" : "rgb", channels);
    append(text, TRUE, texel_mm);
    g_string_append(text, ",\n\"lights\": [");
    for (int i = 0; i < 3 * n; i++)
        append(text, i == 0, (double)lights[i]);
    g_string_append(text, "],\n\"materials\": [{\n\"scale\": [");
    for (int k = 0; k < channels; k++) {
        const int term = rti_term(rti, k);
        append(text, k == 0, term < 0 ? 1 : 255 * rti->scale[term]);
    }
    g_string_append(text, "],\n\"bias\": [");
    for (int k = 0; k < channels; k++) {
        const int term = rti_term(rti, k);
        append(text, k == 0, term < 0 ? 0 : rti->bias[term] / 255);
    }
    g_string_append(text, "]\n}]\n}\n");
    return output_file_write(path, text->str, text->len, error);
}

static gboolean write_files(const char *folder, const struct rti *rti, const float *lights, int n,
                            double texel_mm, GError **error) {
    gboolean ok = write_info(folder, rti, lights, n, texel_mm, error);
    for (int plane = 0; ok && plane < (rti->lrgb ? 3 : TERMS); plane++)
        ok = write_plane(folder, rti, plane, error);
    return ok;
}

static gboolean fail_folder(const char *folder, GError **error) {
    const int saved = errno;
    const gboolean exists = saved == EEXIST || saved == ENOTEMPTY;
    if (exists)
        g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS, "%s: exists already; take another name",
                    folder);
    else
        g_set_error(error, DATA_ERROR, DATA_ERROR_IO,
                    "%s: the folder cannot be made: %s; give a path in a folder with free space in "
                    "which you may write",
                    folder, g_strerror(saved));
    return FALSE;
}

/* Removes a folder with its files. It must be a folder that this process has made. */
static void remove_folder(const char *folder) {
    g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *path = g_build_filename(folder, name, NULL);
        g_unlink(path);
    }
    g_rmdir(folder);
}

gboolean rti_write_relight(const char *folder, gboolean replace, const struct rti *rti,
                           const float *lights, int n, double texel_mm, GError **error) {
    g_autofree char *absolute = g_canonicalize_filename(folder, NULL);
    g_autofree char *parent = g_path_get_dirname(absolute), *base = g_path_get_basename(absolute);
    g_autofree char *beside = g_strdup_printf("%s/.%s.XXXXXX", parent, base);
    if (replace && g_file_test(absolute, G_FILE_TEST_IS_DIR))
        return write_files(absolute, rti, lights, n, texel_mm, error);
    if (g_file_test(absolute, G_FILE_TEST_EXISTS)) {
        errno = EEXIST;
        return fail_folder(folder, error);
    }
    if (!g_mkdtemp_full(beside, 0777))
        return fail_folder(folder, error);
    GError *failed = NULL;
    const gboolean ok = write_files(beside, rti, lights, n, texel_mm, &failed);
    if (failed) { /* the temporary folder is removed, and the error must name the final folder */
        g_auto(GStrv) parts = g_strsplit(failed->message, beside, -1);
        g_autofree char *message = g_strjoinv(folder, parts);
        g_set_error_literal(error, failed->domain, failed->code, message);
        g_error_free(failed);
    }
    if (ok)
        return output_file_move_folder(beside, absolute, error);
    remove_folder(beside);
    return FALSE;
}
