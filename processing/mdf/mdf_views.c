#include "mdf_views.h"

#include <math.h>

#include "base/data_error.h"
#include "exr/exr.h"
#include "mdf_views_private.h"

#define AGAIN "; process the session again"

/* Computes p = x + (x − c) · distance / |x − c|, where x is the texel's centre on the reference
 * plane and c the position of the camera. */
struct vec3 mdf_views_point(const struct mdf_eye *eye, const struct mdf_plane *plane, int i,
                            double distance_mm) {
    int column = i % plane->width, row = i / plane->width;
    double x = (column + 0.5 - 0.5 * plane->width) * plane->texel_mm;
    double y = (0.5 * plane->height - row - 0.5) * plane->texel_mm;
    const double *c = eye->centre_mm;
    double dx = x - c[0], dy = y - c[1], dz = plane->reference_mm - c[2];
    double along = distance_mm / sqrt(dx * dx + dy * dy + dz * dz);
    return (struct vec3){x + along * dx, y + along * dy, plane->reference_mm + along * dz};
}

/* The ray c + t (p − c) from the camera c to the point p meets the plane at t = (z_ref − c_z) /
 * (p_z − c_z). The distance from that intersection to p is (1 − t) |p − c|. */
gboolean mdf_views_look_up(const struct mdf_eye *eye, const struct mdf_plane *plane, struct vec3 p,
                           double *ret_column, double *ret_row, double *ret_mm) {
    const double *c = eye->centre_mm;
    double t = (plane->reference_mm - c[2]) / (p.z - c[2]);
    double x = c[0] + t * (p.x - c[0]), y = c[1] + t * (p.y - c[1]);
    *ret_column = x / plane->texel_mm + 0.5 * plane->width - 0.5;
    *ret_row = 0.5 * plane->height - y / plane->texel_mm - 0.5;
    double length = sqrt((p.x - c[0]) * (p.x - c[0]) + (p.y - c[1]) * (p.y - c[1]) +
                         (p.z - c[2]) * (p.z - c[2]));
    *ret_mm = length * (1 - t);
    return *ret_column >= 0 && *ret_row >= 0 && *ret_column <= plane->width - 1 &&
           *ret_row <= plane->height - 1;
}

/* Compares the distance of p with the range low … high of the four texels around its ray. If p is
 * nearer to the camera than that range, the view sees through p. */
enum mdf_answer mdf_views_ask(const struct mdf_eye *other, const struct mdf_plane *plane,
                              struct vec3 p) {
    double column, row, mm, low = INFINITY, high = -INFINITY;
    if (!mdf_views_look_up(other, plane, p, &column, &row, &mm))
        return MDF_NO_ANSWER;
    for (int k = 0; k < 4; k++) {
        int i = MIN((int)column + (k & 1), plane->width - 1);
        int j = MIN((int)row + (k >> 1), plane->height - 1);
        double there = other->distance[j * plane->width + i];
        if (!(there >= 0))
            return MDF_NO_ANSWER;
        low = MIN(low, there);
        high = MAX(high, there);
    }
    double tolerance = MDF_TOLERANCE * plane->texel_mm;
    if (mm < low - tolerance)
        return MDF_DENIED;
    return mm <= high + tolerance ? MDF_CONFIRMED : MDF_NO_ANSWER;
}

int mdf_views_asked(int n) {
    return MIN(n - 1, MDF_MAX_ASKED);
}

int mdf_views_other(int n, int view, int k) {
    return (view + 1 + (int)((gint64)k * (n - 1) / mdf_views_asked(n))) % n;
}

void mdf_views_poll(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                    struct vec3 p, guint16 *ret_confirmed, guint16 *ret_denied) {
    *ret_confirmed = *ret_denied = 0;
    for (int k = 0; k < mdf_views_asked(n); k++) {
        enum mdf_answer answer = mdf_views_ask(&views[mdf_views_other(n, view, k)], plane, p);
        *ret_confirmed += answer == MDF_CONFIRMED;
        *ret_denied += answer == MDF_DENIED;
    }
}

void mdf_views_compare(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                       guint16 *ret_confirmed, guint16 *ret_denied) {
    for (int i = 0; i < plane->width * plane->height; i++) {
        const float mm = views[view].distance[i];
        ret_confirmed[i] = ret_denied[i] = 0;
        if (mm >= 0)
            mdf_views_poll(views, n, view, plane, mdf_views_point(&views[view], plane, i, mm),
                           &ret_confirmed[i], &ret_denied[i]);
    }
}

gboolean mdf_views_refuted(guint16 confirmed, guint16 denied) {
    return denied > confirmed;
}

static gboolean read_plane(const char *path, const struct exr_file *file, struct mdf_plane *ret,
                           GError **error) {
    if (file->parts->len == 0) {
        return data_error_fail(path, 0, error, "the file has no views" AGAIN);
    }
    const struct exr_part *first = g_ptr_array_index(file->parts, 0);
    ret->width = first->width;
    ret->height = first->height;
    if (exr_get_double(first, "texel_mm", &ret->texel_mm, error) &&
        exr_get_double(first, "reference_mm", &ret->reference_mm, error) && ret->texel_mm > 0)
        return TRUE;
    if (error && !*error)
        data_error_set(path, 0, error, "texel_mm is %g, but must be above 0" AGAIN, ret->texel_mm);
    else
        g_prefix_error(error, "%s: ", path);
    return FALSE;
}

static gboolean read_view(const char *path, const struct exr_part *part,
                          const struct mdf_plane *plane, struct mdf_eye *ret, GError **error) {
    /* Channel M has the view's own measurements. Values from other views would not be
     * independent evidence. */
    ret->distance = exr_part_plane(part, "M");
    if (!ret->distance)
        ret->distance = exr_part_plane(part, "D");
    if (!exr_get_v3d(part, "view.centre_mm", ret->centre_mm, error)) {
        g_prefix_error(error, "%s: part %s: ", path, part->name);
        return FALSE;
    }
    const gsize n = (gsize)plane->width * (gsize)plane->height;
    if (!ret->distance)
        return data_error_fail(path, 0, error, "part %s lacks channel D with the distances" AGAIN,
                               part->name);
    if (part->width != plane->width || part->height != plane->height)
        return data_error_fail(path, 0, error,
                               "part %s has %d × %d texels, but the first view has %d × %d" AGAIN,
                               part->name, part->width, part->height, plane->width, plane->height);
    if (!exr_all_finite(ret->distance, n))
        return data_error_fail(path, 0, error, "part %s has distances that are not finite" AGAIN,
                               part->name);
    if (!(ret->centre_mm[2] > plane->reference_mm))
        return data_error_fail(path, 0, error,
                               "part %s has its camera at z = %g mm, but the camera must be above "
                               "the reference plane at z = %g mm" AGAIN,
                               part->name, ret->centre_mm[2], plane->reference_mm);
    return TRUE;
}

gboolean mdf_views_check(const char *path, struct mdf_views_sums *ret, GError **error) {
    *ret = (struct mdf_views_sums){.lines = {.worst_position = -1}};
    struct exr_file *file = exr_read(path, error);
    if (!file)
        return FALSE;
    struct mdf_plane plane = {0};
    const int n = (int)file->parts->len;
    g_autofree struct mdf_eye *views = g_new0(struct mdf_eye, n + 1);
    gboolean ok = read_plane(path, file, &plane, error);
    for (int i = 0; ok && i < n; i++)
        ok = read_view(path, g_ptr_array_index(file->parts, i), &plane, &views[i], error);
    const int n_texels = plane.width * plane.height;
    g_autofree guint16 *confirmed = g_new(guint16, n_texels), *denied = g_new(guint16, n_texels);
    gint64 answers = 0; /* number of answers that confirm or deny */
    for (int view = 0; ok && view < n; view++) {
        struct mdf_lines lines;
        mdf_views_compare(views, n, view, &plane, confirmed, denied);
        for (int i = 0; i < n_texels; i++) {
            const gboolean seen = views[view].distance[i] >= 0;
            const gboolean refuted = mdf_views_refuted(confirmed[i], denied[i]);
            ret->seen += seen;
            ret->refuted += refuted;
            ret->confirmed += !refuted && confirmed[i] > 0;
            ret->unknown += seen && confirmed[i] == 0 && denied[i] == 0;
            ret->denied_share += denied[i];
            answers += confirmed[i] + denied[i];
        }
        int above = 0;
        exr_get_int(g_ptr_array_index(file->parts, view), "mesorig.above", &above, NULL);
        ret->above += CLAMP(above, 0, n_texels);
        ret->texels += n_texels;
        if (mdf_lines_read(g_ptr_array_index(file->parts, view), &lines))
            mdf_lines_add(&ret->lines, &lines);
    }
    ret->n_views = n;
    ret->denied_share /= (double)MAX(answers, 1);
    exr_file_free(file);
    return ok;
}
