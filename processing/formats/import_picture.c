#include "import_private.h"

#include <glib/gstdio.h>
#include <string.h>

#include "base/data_error.h"
#include "base/input_file.h"
#include "exr/exr.h"
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

static gboolean is_exr(const char *name) {
    static const char *const ends[] = {".exr", NULL};
    return has_end(name, ends);
}

gboolean import_is_picture(const char *name) {
    static const char *const ends[] = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr", NULL};
    return has_end(name, ends);
}

static struct import_picture *import_picture_from_part(const struct exr_part *part) {
    const float *planes[3] = {exr_part_plane(part, "R"), exr_part_plane(part, "G"),
                              exr_part_plane(part, "B")};
    const float *grey = exr_part_plane(part, "Y");
    if (!grey && (!planes[0] || !planes[1] || !planes[2]))
        return NULL;
    struct import_picture *picture = g_new0(struct import_picture, 1);
    const gsize n = (gsize)part->width * (gsize)part->height;
    picture->width = part->width;
    picture->height = part->height;
    picture->grey = grey != NULL;
    picture->rgb = g_new(float, 3 * n);
    for (gsize i = 0; i < n; i++)
        for (int c = 0; c < 3; c++)
            picture->rgb[3 * i + (gsize)c] = grey ? grey[i] : planes[c][i];
    return picture;
}

/* The pixels need memory twice here: once as planes, once interleaved. */
static gboolean import_picture_check_size(const char *path, const struct exr_part *part,
                                          GError **error) {
    GStatBuf status;
    return input_file_check_pixels(path, (guint64)part->width, (guint64)part->height,
                                   g_stat(path, &status) == 0 ? (guint64)status.st_size : 0, error);
}

static struct import_picture *import_picture_read_exr(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    if (!file)
        return NULL;
    struct import_picture *picture = NULL;
    const struct exr_part *part = file->parts->len ? file->parts->pdata[0] : NULL;
    const gboolean fits = !part || import_picture_check_size(path, part, error);
    if (part && fits)
        picture = import_picture_from_part(part);
    if (fits && !picture)
        data_error_set(path, 0, error, "there are neither R, G and B in it nor Y");
    exr_file_free(file);
    return picture;
}

struct import_picture *import_picture_read(const char *path, GError **error) {
    g_autoptr(GError) found = NULL;
    struct import_picture *picture = NULL;
    if (is_exr(path)) {
        picture = import_picture_read_exr(path, &found);
    } else {
        picture = g_new0(struct import_picture, 1);
        if (!vision_read_colour(path, &picture->width, &picture->height, &picture->grey,
                                &picture->rgb, &found))
            g_clear_pointer(&picture, import_picture_free);
    }
    if (!picture)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID, "%s",
                    found ? found->message : "it cannot be read");
    return picture;
}
