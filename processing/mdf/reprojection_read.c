/* Reads the MDF of a session for predictions along its surface. */
#include "reprojection.h"

#include "base/data_error.h"
#include "base/direction.h"
#include "exr/exr.h"

#include <math.h>

#define SAME_COSINE                                                                                \
    0.99999 /* cosine of the angle between directions of the same view: a quarter of a degree */

/* Returns the part whose view has the direction, or NULL if there is none. */
static const struct exr_part *reprojection_part(const struct exr_file *file, float theta_deg,
                                                float phi_deg) {
    float to[3], of[3];
    direction_from_deg((double)theta_deg, (double)phi_deg, to);
    for (guint k = 0; k < file->parts->len; k++) {
        const struct exr_part *part = g_ptr_array_index(file->parts, k);
        double theta, phi;
        if (!exr_get_double(part, "view.theta_deg", &theta, NULL) ||
            !exr_get_double(part, "view.phi_deg", &phi, NULL))
            continue;
        direction_from_deg(theta, phi, of);
        if (of[0] * to[0] + of[1] * to[1] + of[2] * to[2] > (float)SAME_COSINE)
            return part;
    }
    return NULL;
}

static gboolean take_view(const char *path, const struct exr_part *part,
                          const struct mdf_plane *plane, struct reprojection_view *ret,
                          GError **error) {
    const gsize n = (gsize)plane->width * (gsize)plane->height;
    ret->distance = exr_part_plane(part, "D");
    ret->error_mm = exr_part_plane(part, "S");
    if (ret->distance && part->width == plane->width && part->height == plane->height &&
        exr_all_finite(ret->distance, n) && (!ret->error_mm || exr_all_finite(ret->error_mm, n)) &&
        exr_get_v3d(part, "view.centre_mm", ret->centre_mm, NULL))
        return TRUE;
    return data_error_fail(path, 0, error,
                           "part %s is not a view of this MDF: its camera, its channel D or finite "
                           "distances are missing, or it has another size; delete it and process "
                           "again",
                           part->name);
}

Reprojection *reprojection_read(const char *path, const float *theta_deg, const float *phi_deg,
                                int n, gboolean tiled, GError **error) {
    g_autoptr(ExrFile) file = exr_read(path, error);
    if (!file)
        return NULL;
    const struct exr_part *first = file->parts->len ? g_ptr_array_index(file->parts, 0) : NULL;
    struct mdf_plane plane = {first ? first->width : 0, first ? first->height : 0, 0, 0};
    if (!first || !exr_get_double(first, "texel_mm", &plane.texel_mm, NULL) ||
        !exr_get_double(first, "reference_mm", &plane.reference_mm, NULL) ||
        !(plane.texel_mm > 0)) {
        data_error_set(path, 0, error,
                       "it has no views, or no texel_mm and reference_mm; delete it and process "
                       "again");
        return NULL;
    }
    const gsize texels = (gsize)plane.width * (gsize)plane.height;
    g_autofree struct reprojection_view *views = g_new0(struct reprojection_view, MAX(n, 1));
    g_autofree float *unknown = g_new(float, texels);
    for (gsize i = 0; i < texels; i++)
        unknown[i] = -1;
    for (int k = 0; k < n; k++) {
        const struct exr_part *part = reprojection_part(file, theta_deg[k], phi_deg[k]);
        if (part) {
            if (!take_view(path, part, &plane, &views[k], error))
                return NULL;
            continue;
        }
        float v[3];
        direction_from_deg((double)theta_deg[k], (double)phi_deg[k], v);
        views[k].distance = unknown;
        for (int c = 0; c < 3; c++)
            views[k].centre_mm[c] = 1000.0 * (double)v[c] + (c == 2 ? plane.reference_mm : 0);
    }
    Reprojection *ret = reprojection_new(&plane, views, n, tiled, error);
    if (!ret)
        g_prefix_error(error, "%s: ", path);
    return ret;
}
