#include "import_private.h"

#include <glib/gstdio.h>
#include <string.h>

#include "base/data_error.h"
#include "base/input_file.h"
#include "exr/exr.h"
#include "pictures/picture_read.h"
#include "pictures/raw.h"
#include "pictures/vision.h"

void import_picture_free(struct import_picture *picture) {
    if (!picture)
        return;
    g_free(picture->rgb);
    g_free(picture);
}

static gboolean has_end(const char *name, const char *const *ends) {
    g_autofree char *lower = g_ascii_strdown(name, -1);
    for (; *ends; ends++)
        if (g_str_has_suffix(lower, *ends))
            return TRUE;
    return FALSE;
}

gboolean import_is_picture(const char *name) {
    static const char *const ends[] = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr", NULL};
    return has_end(name, ends) || raw_is(name);
}

/* A mosaic as it is: grey. */
static void take_mosaic(struct import_picture *to, const struct picture *from, const char *cfa) {
    const gsize n = (gsize)from->width * (gsize)from->height;
    to->width = from->width;
    to->height = from->height;
    to->grey = TRUE;
    g_strlcpy(to->cfa, cfa, sizeof to->cfa);
    to->rgb = g_new(float, 3 * n);
    for (gsize i = 0; i < 3 * n; i++)
        to->rgb[i] = from->values[i / 3];
}

/* A pixel for each cell of a mosaic. */
static void take_cells(struct import_picture *to, const struct picture *from, const char *cfa) {
    to->width = from->width / 2;
    to->height = from->height / 2;
    to->rgb = g_new0(float, 3 * (gsize)to->width * (gsize)to->height);
    for (int y = 0; y < 2 * to->height; y++)
        for (int x = 0; x < 2 * to->width; x++) {
            const char colour = cfa[2 * (y & 1) + (x & 1)];
            const int c = colour == 'r' ? 0 : colour == 'g' ? 1 : 2;
            to->rgb[3 * ((gsize)(y / 2) * (gsize)to->width + (gsize)(x / 2)) + (gsize)c] +=
                (c == 1 ? 0.5F : 1) * from->values[(gsize)y * (gsize)from->width + (gsize)x];
        }
}

static struct import_picture *import_picture_read_raw(const char *path, gboolean mosaic,
                                                      GError **error) {
    char cfa[RAW_CFA];
    g_autoptr(Picture) raw = raw_read(path, cfa, error);
    if (!raw)
        return NULL;
    struct import_picture *picture = g_new0(struct import_picture, 1);
    if (mosaic || strcmp(cfa, "mono") == 0)
        take_mosaic(picture, raw, cfa);
    else
        take_cells(picture, raw, cfa);
    return picture;
}

static struct import_picture *import_picture_read_exr(const char *path, GError **error) {
    g_autoptr(ExrFile) file = exr_read(path, error);
    if (!file)
        return NULL;
    const struct exr_part *part = file->parts->len ? file->parts->pdata[0] : NULL;
    /* The pixels need memory twice here: once as planes, once interleaved. */
    GStatBuf status;
    if (part &&
        !input_file_check_pixels(path, (guint64)part->width, (guint64)part->height,
                                 g_stat(path, &status) == 0 ? (guint64)status.st_size : 0, error))
        return NULL;
    const float *grey = part ? exr_part_plane(part, "Y") : NULL;
    const float *planes[3] = {grey, grey, grey};
    for (int c = 0; part && !grey && c < 3; c++)
        planes[c] = exr_part_plane(part, (const char *const[]){"R", "G", "B"}[c]);
    if (!planes[0] || !planes[1] || !planes[2]) {
        data_error_set(path, 0, error, "there are neither R, G and B in it nor Y");
        return NULL;
    }
    struct import_picture *picture = g_new0(struct import_picture, 1);
    const gsize n = (gsize)part->width * (gsize)part->height;
    picture->width = part->width;
    picture->height = part->height;
    picture->grey = grey != NULL;
    picture->rgb = g_new(float, 3 * n);
    for (gsize i = 0; i < n; i++)
        for (int c = 0; c < 3; c++)
            picture->rgb[3 * i + (gsize)c] = planes[c][i];
    return picture;
}

/* ret_bits: NULL for linear values. */
static struct import_picture *import_picture_read_any(const char *path, int *ret_bits,
                                                      GError **error) {
    g_autoptr(GError) found = NULL;
    struct import_picture *picture = NULL;
    if (has_end(path, (const char *const[]){".exr", NULL})) {
        picture = import_picture_read_exr(path, &found);
        if (ret_bits)
            *ret_bits = 0;
    } else if (raw_is(path)) {
        picture = import_picture_read_raw(path, ret_bits != NULL, &found);
        if (ret_bits)
            *ret_bits = 0;
    } else {
        picture = g_new0(struct import_picture, 1);
        if (!(ret_bits ? picture_read_codes(path, &picture->width, &picture->height, &picture->grey,
                                            ret_bits, &picture->rgb, &found)
                       : picture_read_colour(path, &picture->width, &picture->height,
                                             &picture->grey, &picture->rgb, &found)))
            g_clear_pointer(&picture, import_picture_free);
    }
    if (!picture)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID, "%s",
                    found ? found->message : "it cannot be read");
    return picture;
}

struct import_picture *import_picture_read(const char *path, GError **error) {
    return import_picture_read_any(path, NULL, error);
}

struct import_picture *import_picture_read_codes(const char *path, int *ret_bits, GError **error) {
    return import_picture_read_any(path, ret_bits, error);
}
