/* A texel's point is c + (x − c)(1 + d / |x − c|), where c is the camera, x the texel on the
 * reference plane, and d the MDF value. The normal of the point is the cross product of the
 * tangents to its neighbours on the same surface. */
#include "surface_points.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "exr/exr.h"
#include "frames/rectify.h"
#include "mdf/mdf_views.h"

#define CONNECTED 3.0 /* in texels: largest distance between neighbours on one surface */
/* in texels: minimum standard error of a point, because an error from few sweeps may be too
 * small */
#define MIN_ERROR 0.02
#define UNKNOWN   0.5 /* in texels: standard error of a point that a single sweep has measured */
/* minimum of the cosine between normal and camera in the weight of a point */
#define MIN_FACE 0.05

void surface_clear(struct surface *surface) {
    g_clear_pointer(&surface->points, g_array_unref);
}

/* The points of one view. */
struct view {
    const struct surface *surface;
    struct vec3 eye_mm;
    struct vec3 *at_mm;                     /* point of each texel: n_texels */
    const float *distance, *error, *source; /* channels of the MDF; source may be NULL */
    int index;
};

/* Computes the tangent at texel i, from the neighbour `before` to the neighbour `after`. A
 * neighbour is −1 at the border of the map. If a neighbour is not on the same surface, the texel
 * itself takes its place. Returns FALSE if neither neighbour is on the same surface. */
static gboolean along(const struct view *view, int i, int before, int after, struct vec3 *ret) {
    const double most = CONNECTED * view->surface->texel_mm;
    int from = before >= 0 && view->distance[before] >= 0 ? before : i;
    int to = after >= 0 && view->distance[after] >= 0 ? after : i;
    if (from != i && vec3_length(vec3_sub(view->at_mm[i], view->at_mm[from])) > most)
        from = i;
    if (to != i && vec3_length(vec3_sub(view->at_mm[to], view->at_mm[i])) > most)
        to = i;
    *ret = vec3_sub(view->at_mm[to], view->at_mm[from]);
    return from != to;
}

/* Computes the normal: the cross product of the tangents along columns and rows. The normal points
 * towards the camera. Returns FALSE if a tangent is missing. */
static gboolean normal_at(const struct view *view, int column, int row, struct vec3 *ret) {
    const int width = view->surface->grid.width, height = view->surface->grid.height;
    const int i = row * width + column;
    struct vec3 x, y;
    if (!along(view, i, column > 0 ? i - 1 : -1, column < width - 1 ? i + 1 : -1, &x) ||
        !along(view, i, row < height - 1 ? i + width : -1, row > 0 ? i - width : -1, &y))
        return FALSE;
    const struct vec3 cross = vec3_cross(x, y);
    if (!(vec3_length(cross) > 0))
        return FALSE;
    *ret = vec3_unit(cross);
    if (vec3_dot(*ret, vec3_sub(view->eye_mm, view->at_mm[i])) < 0)
        *ret = vec3_scale(*ret, -1);
    return TRUE;
}

static void add_points(const struct view *view) {
    const struct surface *surface = view->surface;
    for (int i = 0; i < surface->grid.width * surface->grid.height; i++) {
        struct surface_point point = {.view = view->index};
        /* Predicted values are left out, because they were computed from the points of other
         * views. */
        if (!(view->distance[i] >= 0) || (view->source && view->source[i] >= MDF_PREDICTED) ||
            !normal_at(view, i % surface->grid.width, i / surface->grid.width, &point.normal))
            continue;
        const double own =
            view->error[i] >= 0 ? (double)view->error[i] / surface->texel_mm : UNKNOWN;
        const struct vec3 to_eye = vec3_unit(vec3_sub(view->eye_mm, view->at_mm[i]));
        const double error = hypot(own, MIN_ERROR);
        point.at_mm = view->at_mm[i];
        point.weight = (float)(MAX(vec3_dot(point.normal, to_eye), MIN_FACE) / (error * error));
        g_array_append_val(surface->points, point);
    }
}

static gboolean add_view(struct surface *surface, const struct exr_part *part, int index,
                         const char *path, GError **error) {
    const float *distance = exr_part_plane(part, "D"), *own = exr_part_plane(part, "S");
    double eye[3];
    if (!distance || !own)
        return data_error_fail(path, 0, error,
                               "part %s lacks channel %s; process the session again", part->name,
                               distance ? "S" : "D");
    if (part->width != surface->grid.width || part->height != surface->grid.height)
        return data_error_fail(path, 0, error,
                               "part %s has %d × %d texels, but the session's grid has %d × %d; "
                               "process the session again",
                               part->name, part->width, part->height, surface->grid.width,
                               surface->grid.height);
    if (!exr_get_v3d(part, "view.centre_mm", eye, NULL) || !isfinite(eye[0] + eye[1] + eye[2]))
        return data_error_fail(path, 0, error,
                               "in part %s the attribute view.centre_mm, the position of the "
                               "camera, is missing or not finite; process the session again",
                               part->name);
    g_autofree struct vec3 *at_mm = g_new0(struct vec3, part->width * part->height);
    struct view view = {.surface = surface,
                        .eye_mm = vec3(eye[0], eye[1], eye[2]),
                        .at_mm = at_mm,
                        .distance = distance,
                        .error = own,
                        .source = exr_part_plane(part, "P"),
                        .index = index};
    for (int row = 0; row < part->height; row++)
        for (int column = 0; column < part->width; column++) {
            const int i = row * part->width + column;
            const struct vec3 from = rectify_point_mm(&surface->grid, column + 0.5, row + 0.5);
            const struct vec3 ray = vec3_unit(vec3_sub(from, view.eye_mm));
            at_mm[i] = vec3_add(from, vec3_scale(ray, (double)distance[i]));
        }
    add_points(&view);
    return TRUE;
}

gboolean surface_points_read(const char *session, const struct work *work, struct surface *ret,
                             GError **error) {
    *ret = (struct surface){.points = g_array_new(FALSE, FALSE, sizeof(struct surface_point))};
    g_autoptr(Session) from = session_open(session, SESSION_READ, error);
    if (!from || !session_grid(from, &ret->grid, error))
        return FALSE;
    g_autofree char *path = session_file(from, "products/mdf.exr");
    ret->texel_mm = ret->grid.width_mm / ret->grid.width;
    if (!g_file_test(path, G_FILE_TEST_EXISTS)) {
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
            "%s: there is no MDF; process the session if it has laser positions. Without laser "
            "positions, a PTM gives heights and normals: mesorig compress %s --method ptm",
            path, session);
        return FALSE;
    }
    if (!session_check_products(from, "products/mdf.exr", NULL, error))
        return FALSE;
    const gint64 begun_us = g_get_monotonic_time();
    g_autoptr(ExrFile) file = exr_read(path, error);
    ret->n_views = file ? (int)file->parts->len : 0;
    for (int i = 0; i < ret->n_views; i++)
        if (!add_view(ret, file->parts->pdata[i], i, path, error) ||
            !work_tell(work, "points", i + 1, ret->n_views, begun_us, error))
            return FALSE;
    return file != NULL;
}
