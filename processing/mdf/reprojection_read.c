/* Reads the MDF of a session for predictions along its surface. */
#include "reprojection.h"

#include "base/data_error.h"
#include "base/direction.h"
#include "exr/exr.h"

#include <math.h>

/* cosine of a quarter of a degree; a part belongs to a direction if the angle between them is
 * less */
#define SAME_COSINE 0.99999
#define AGAIN       "; delete the file and process the session again"

/* Returns the first part whose view is within a quarter of a degree of the direction, or NULL if
 * there is none. */
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
    if (!ret->distance)
        return data_error_fail(path, 0, error, "part %s lacks channel D with the distances" AGAIN,
                               part->name);
    if (part->width != plane->width || part->height != plane->height)
        return data_error_fail(path, 0, error,
                               "part %s has %d × %d texels, but the first view has %d × %d" AGAIN,
                               part->name, part->width, part->height, plane->width, plane->height);
    if (!exr_all_finite(ret->distance, n) || (ret->error_mm && !exr_all_finite(ret->error_mm, n)))
        return data_error_fail(path, 0, error,
                               "part %s has values in channel D or S that are not finite" AGAIN,
                               part->name);
    if (!exr_get_v3d(part, "view.centre_mm", ret->centre_mm, NULL))
        return data_error_fail(path, 0, error,
                               "part %s lacks view.centre_mm, the position of the camera" AGAIN,
                               part->name);
    return TRUE;
}

Reprojection *reprojection_read(const char *path, const float *theta_deg, const float *phi_deg,
                                int n, gboolean tiled, GError **error) {
    g_autoptr(ExrFile) file = exr_read(path, error);
    if (!file)
        return NULL;
    const struct exr_part *first = file->parts->len ? g_ptr_array_index(file->parts, 0) : NULL;
    struct mdf_plane plane = {first ? first->width : 0, first ? first->height : 0, 0, 0};
    if (!first) {
        data_error_set(path, 0, error, "the file has no views" AGAIN);
        return NULL;
    }
    if (!exr_get_double(first, "texel_mm", &plane.texel_mm, NULL) || !(plane.texel_mm > 0)) {
        data_error_set(path, 0, error, "texel_mm is missing or not above 0" AGAIN);
        return NULL;
    }
    if (!exr_get_double(first, "reference_mm", &plane.reference_mm, NULL)) {
        data_error_set(path, 0, error, "reference_mm is missing" AGAIN);
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
