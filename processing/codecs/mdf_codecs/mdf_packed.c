#include "mdf_packed.h"

#include <math.h>
#include <string.h>

#include "exr/exr.h"

#define MOST   255
#define MAX_MM 6e4

/* Packs one view as halves, or as n = round (d / s) of distances d with the scale s = max d /
 * 255. */
static struct exr_part *pack(const struct exr_part *from, enum mdf_packed kind, const char *path,
                             GError **error) {
    static const char *const channel[] = {"D", NULL};
    const float *distance = exr_part_plane(from, "D");
    const gsize n = (gsize)from->width * (gsize)from->height;
    double scale;
    float most = 0;
    const char *what =
        !distance
            ? "it has no channel D, and is not a view of an MDF; give products/mdf.exr of a session"
        : exr_get_double(from, "mesorig.scale_mm", &scale, NULL)
            ? "it is already packed; give products/mdf.exr of a session"
            : NULL;
    for (gsize i = 0; !what && i < n; i++) {
        most = MAX(most, distance[i]);
        if (!(fabsf(distance[i]) <= MAX_MM))
            what = "a distance is not a number from −60000 to 60000 mm; process the session again";
    }
    if (what) {
        g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT, "%s: part “%s”: %s", path, from->name,
                    what);
        return NULL;
    }
    struct exr_part *part = exr_part_new(from->name, from->width, from->height, channel, EXR_HALF);
    for (guint i = 0; i < from->attributes->len; i++) {
        const struct exr_attribute *a = from->attributes->pdata[i];
        if (a->kind == EXR_KIND_STRING)
            exr_set_string(part, a->name, a->string);
        else if (a->kind == EXR_KIND_INT)
            exr_set_int(part, a->name, a->integer);
        else if (a->kind == EXR_KIND_DOUBLE)
            exr_set_double(part, a->name, a->v[0]);
        else
            exr_set_v3d(part, a->name, a->v[0], a->v[1], a->v[2]);
    }
    memcpy(part->planes[0], distance, sizeof(float) * n);
    if (kind == MDF_PACKED_HALF)
        return part;
    scale = most > 0 ? (double)most / MOST : 1;
    for (gsize i = 0; i < n; i++)
        part->planes[0][i] = distance[i] >= 0 ? (float)round(distance[i] / scale) : -1;
    exr_set_double(part, "mesorig.scale_mm", scale);
    return part;
}

/* With MDF_PACKED_HALF, *ret_bytes counts two bytes for each texel. With MDF_PACKED_8BIT, it counts
 * one byte for each texel, and four bytes for the scale of each view. */
gboolean mdf_pack(const char *from, const char *to, enum mdf_packed kind, gint64 *ret_bytes,
                  GError **error) {
    struct exr_file *file = exr_read(from, error), *packed = exr_file_new();
    gboolean ok = file != NULL;
    *ret_bytes = 0;
    for (guint i = 0; ok && i < file->parts->len; i++) {
        const struct exr_part *view = file->parts->pdata[i];
        struct exr_part *part = pack(view, kind, from, error);
        ok = part != NULL;
        if (ok)
            exr_file_add(packed, part);
        *ret_bytes += (gint64)view->width * view->height * (kind == MDF_PACKED_HALF ? 2 : 1) +
                      (kind == MDF_PACKED_HALF ? 0 : (gint64)sizeof(float));
    }
    ok = ok && exr_write(to, packed, EXR_ZIP, TRUE, error);
    exr_file_free(file);
    exr_file_free(packed);
    return ok;
}
