#include "mdf_packed.h"

#include <math.h>
#include <string.h>

#include "exr/exr.h"

#define MOST   255
#define MAX_MM 6e4

static gboolean mdf_packed_fail(GError **error, const char *path, const struct exr_part *part,
                                const char *what) {
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT, "%s: part “%s”: %s", path, part->name, what);
    return FALSE;
}

static void copy_attributes(const struct exr_part *from, struct exr_part *to) {
    for (guint i = 0; i < from->attributes->len; i++) {
        const struct exr_attribute *a = from->attributes->pdata[i];
        if (a->kind == EXR_KIND_STRING)
            exr_set_string(to, a->name, a->string);
        else if (a->kind == EXR_KIND_INT)
            exr_set_int(to, a->name, a->integer);
        else if (a->kind == EXR_KIND_DOUBLE)
            exr_set_double(to, a->name, a->v[0]);
        else
            exr_set_v3d(to, a->name, a->v[0], a->v[1], a->v[2]);
    }
}

static void mdf_packed_to_steps(struct exr_part *part, gsize n) {
    float *d = part->planes[0], most = 0;
    for (gsize i = 0; i < n; i++)
        most = MAX(most, d[i]);
    const double scale = most > 0 ? (double)most / MOST : 1;
    for (gsize i = 0; i < n; i++)
        d[i] = d[i] >= 0 ? (float)round(d[i] / scale) : -1;
    exr_set_double(part, "mesorig.scale_mm", scale);
}

static struct exr_part *mdf_packed_pack(const struct exr_part *from, enum mdf_packed kind,
                                        const char *path, GError **error) {
    static const char *const channel[] = {"D", NULL};
    const float *distance = exr_part_plane(from, "D");
    const gsize n = (gsize)from->width * (gsize)from->height;
    double scale;
    const char *what = !distance ? "there is no channel D: it is no MDF"
                       : exr_get_double(from, "mesorig.scale_mm", &scale, NULL)
                           ? "it was packed already"
                           : NULL;
    for (gsize i = 0; !what && i < n; i++)
        if (!(fabsf(distance[i]) <= MAX_MM))
            what = "there is a distance that is not a number of millimetres";
    if (what) {
        mdf_packed_fail(error, path, from, what);
        return NULL;
    }
    struct exr_part *part = exr_part_new(from->name, from->width, from->height, channel, EXR_HALF);
    memcpy(part->planes[0], distance, sizeof(float) * n);
    copy_attributes(from, part);
    if (kind == MDF_PACKED_8BIT)
        mdf_packed_to_steps(part, n);
    return part;
}

gboolean mdf_pack(const char *from, const char *to, enum mdf_packed kind, gint64 *ret_bytes,
                  GError **error) {
    struct exr_file *file = exr_read(from, error), *packed = exr_file_new();
    gboolean ok = file != NULL;
    *ret_bytes = 0;
    for (guint i = 0; ok && i < file->parts->len; i++) {
        const struct exr_part *view = file->parts->pdata[i];
        struct exr_part *part = mdf_packed_pack(view, kind, from, error);
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
