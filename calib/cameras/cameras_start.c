/* This file finds initial values for the bundle adjustment. Cameras begin as in the rig file. The
 * pose of each lay comes from the picture that explains the other pictures best. */
#include "cameras_private.h"

#include "pictures/vision.h"

#include <string.h>

#define MAX_CANDIDATES 40
#define MIN_SIGMA_PX   0.01 /* added in quadrature to a corner's standard deviation */

void cameras_start(struct cameras_work *work) {
    for (int i = 0; i < work->nominal.n_cameras; i++) {
        const struct rig_camera *c = &work->nominal.cameras[i];
        const struct vec3 centre = rig_camera_centre_mm(c), shift = c->translation_mm;
        struct bundle_camera *to = &work->bundle.cameras[i];
        *to = (struct bundle_camera){
            .lens = (enum rig_lens)c->lens,
            .intrinsics = {c->fx_px, c->fy_px, c->cx_px, c->cy_px, c->k1, c->k2, c->k3, c->p1,
                           c->p2, c->k4, c->k5, c->k6},
            /* priors of the lens parameters; see cameras.h */
            .prior_sigma = {0, 0, 0.02 * c->width, 0.02 * c->width, 0.3, 0.3, 0.1, 0.003, 0.003},
            .shift = {shift.x, shift.y, shift.z},
            .nominal_centre = {centre.x, centre.y, centre.z},
            .stop = c->stop,
            .noise = 1};
        memcpy(to->prior, to->intrinsics, sizeof to->prior);
        memcpy(to->rotation, c->rotation.m, sizeof to->rotation);
        cameras_set_lens(to, work->task->lens_given ? work->task->lens : to->lens);
    }
}

/* Computes the pose of the board from one picture whose camera is in its nominal pose (R_c, t_c):
 * R_l = Rz(−τ) R_cᵀ R, t_l = Rz(−τ) R_cᵀ (t − t_c). R, t is the board's pose in the camera's frame.
 * Returns FALSE if the pose is not found, or if the board is nearly parallel to the z axis. */
static gboolean lay_by_picture(const struct cameras_work *work, const struct seen *seen,
                               struct bundle_lay *ret) {
    const struct rig_camera *camera = &work->nominal.cameras[seen->camera];
    struct rig_camera own = *camera;
    /* For each corner: x, y on the board, and x', y' of its viewing ray with z = 1. */
    g_autofree double *points = g_new(double, 4 * seen->corners->len);
    cameras_take_camera(&own, &work->bundle.cameras[seen->camera]);
    own.rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    for (guint i = 0; i < seen->corners->len; i++) {
        const struct corner *corner = &g_array_index(seen->corners, struct corner, i);
        const struct vec3 ray = rig_pixel_ray(&own, corner->x_px, corner->y_px);
        board_corner_mm(&work->task->board, corner->id, points + 4 * i);
        points[4 * i + 2] = ray.x / ray.z;
        points[4 * i + 3] = ray.y / ray.z;
    }
    double r[9], t[3];
    if (!vision_pose(points, (int)seen->corners->len, r, t))
        return FALSE;
    const double angle = work->bundle.stops[seen->stop].commanded_rad;
    struct vec3 columns[3];
    for (int k = 0; k < 3; k++)
        columns[k] = rig_turn(
            mat3_mul_transposed(&camera->rotation, vec3(r[k], r[3 + k], r[6 + k])), -angle);
    const struct vec3 at =
        rig_turn(mat3_mul_transposed(&camera->rotation,
                                     vec3_sub(vec3(t[0], t[1], t[2]), camera->translation_mm)),
                 -angle);
    for (int k = 0; k < 3; k++) {
        ret->rotation[k] = columns[k].x;
        ret->rotation[3 + k] = columns[k].y;
        ret->rotation[6 + k] = columns[k].z;
    }
    const struct vec3 n = columns[2];
    ret->place[0] = at.x;
    ret->place[1] = at.y;
    ret->place[2] = at.z + (n.x * at.x + n.y * at.y) / n.z;
    return fabs(n.z) > 0.05;
}

static int by_size(gconstpointer a, gconstpointer b) {
    const double *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

double cameras_median(GArray *values) {
    g_array_sort(values, by_size);
    return g_array_index(values, double, values->len / 2);
}

/* Returns the median reprojection error in pixels over every fifth corner of a lay. Returns
 * G_MAXDOUBLE if the lay has no corners. */
static double median_error(const struct cameras_work *work, int lay) {
    g_autoptr(GArray) errors = g_array_new(FALSE, FALSE, sizeof(double));
    for (int i = 0; i < work->task->n_pictures; i++) {
        const struct seen *seen = &work->seen[i];
        for (guint k = 0; seen->lay == lay && seen->corners && k < seen->corners->len; k += 5) {
            const struct corner *corner = &g_array_index(seen->corners, struct corner, k);
            double mm[2], px[2], error = G_MAXDOUBLE;
            board_corner_mm(&work->task->board, corner->id, mm);
            if (bundle_project(&work->bundle, seen->camera, seen->stop, FALSE, mm, px))
                error = hypot(px[0] - corner->x_px, px[1] - corner->y_px);
            g_array_append_val(errors, error);
        }
    }
    return errors->len ? cameras_median(errors) : G_MAXDOUBLE;
}

/* Tries the pose from each of several pictures, and keeps the pose with the smallest median error
 * over all pictures of the lay. Returns FALSE if no picture gives a pose. */
gboolean cameras_start_lay(struct cameras_work *work, int lay) {
    struct bundle_lay best = {0}, *to = &work->bundle.lays[lay];
    double least = G_MAXDOUBLE;
    int tried = 0;
    for (int i = 0; i < work->task->n_pictures && tried < MAX_CANDIDATES; i++) {
        const struct seen *seen = &work->seen[i];
        if (seen->lay != lay || !seen->corners || seen->corners->len < 6 ||
            !lay_by_picture(work, seen, to))
            continue;
        const double error = median_error(work, lay);
        tried++;
        if (error >= least)
            continue;
        least = error;
        best = *to;
    }
    *to = best;
    return least < G_MAXDOUBLE;
}

static gboolean refuse_lay(const struct cameras_work *work, int lay, GError **error) {
    const char *why = NULL;
    int all = 0, found = 0;
    for (int i = 0; i < work->task->n_pictures; i++) {
        if (work->seen[i].lay != lay)
            continue;
        all++;
        found += work->seen[i].corners != NULL;
        why = why ? why : work->seen[i].why;
    }
    return cameras_refuse(
        error, CAMERAS_ERROR_PICTURES,
        "the board of session %d, in the given order, must be captured again: no "
        "picture shows it well enough (the board was found in %d of %d pictures)%s%s",
        lay + 1, found, all, why ? "; for example, " : "", why ? why : "");
}

gboolean cameras_start_lays(struct cameras_work *work, GError **error) {
    for (int lay = 0; lay < work->bundle.n_lays; lay++) {
        if (cameras_start_lay(work, lay))
            continue;
        if (!work->free_boards)
            return refuse_lay(work, lay, error);
        /* Leaves out a photograph that shows too little of the board. */
        for (int i = 0; i < work->task->n_pictures; i++) {
            struct seen *seen = &work->seen[i];
            if (seen->lay != lay || !seen->corners)
                continue;
            g_clear_pointer(&seen->corners, g_array_unref);
            cameras_set_why(
                seen, "the clear corners of the board are too few to find the pose of the board; "
                      "show more of the board, and keep it sharp");
        }
    }
    return TRUE;
}

/* The size of the camera's pictures is the size that most photographs have. Photographs of another
 * size are left out, because they were cropped or scaled, or were taken by another camera. */
static void take_common_size(struct cameras_work *work) {
    struct rig_camera *camera = &work->nominal.cameras[0];
    int most = 0;
    for (int i = 0; i < work->task->n_pictures; i++) {
        const int width = work->seen[i].width, height = work->seen[i].height;
        int same = 0;
        for (int k = 0; k < work->task->n_pictures; k++)
            same += work->seen[k].width == width && work->seen[k].height == height;
        if (same <= most)
            continue;
        most = same;
        camera->width = width;
        camera->height = height;
    }
    for (int i = 0; i < work->task->n_pictures; i++) {
        struct seen *seen = &work->seen[i];
        if (seen->width == camera->width && seen->height == camera->height)
            continue;
        g_autofree char *why = g_strdup_printf(
            "the photograph has %d × %d pixels, but %d of the %d photographs have %d × %d: use "
            "photographs of one camera that are neither cropped nor scaled",
            seen->width, seen->height, most, work->task->n_pictures, camera->width, camera->height);
        cameras_set_why(seen, why);
        g_clear_pointer(&seen->corners, g_array_unref);
    }
}

/* Computes the initial focal length from the homographies of at least three pictures, and from the
 * guess of the task. The principal point is at the centre. */
gboolean cameras_start_lens(struct cameras_work *work, GError **error) {
    const int n = work->task->n_pictures;
    take_common_size(work);
    g_autoptr(GPtrArray) views = g_ptr_array_new_with_free_func(g_free);
    g_autofree int *counts = g_new0(int, n);
    struct rig_camera *camera = &work->nominal.cameras[0];
    double focal[2];
    for (int i = 0; i < n; i++) {
        const struct seen *seen = &work->seen[i];
        if (!seen->corners || seen->corners->len < 8)
            continue;
        double *points = g_new(double, 4 * seen->corners->len);
        for (guint k = 0; k < seen->corners->len; k++) {
            const struct corner *corner = &g_array_index(seen->corners, struct corner, k);
            board_corner_mm(&work->task->board, corner->id, points + 4 * k);
            points[4 * k + 2] = corner->x_px;
            points[4 * k + 3] = corner->y_px;
        }
        counts[views->len] = (int)seen->corners->len;
        g_ptr_array_add(views, points);
    }
    if (views->len < 3) {
        return cameras_refuse(error, CAMERAS_ERROR_PICTURES,
                              "the board was found with at least 8 corners in %u of %d "
                              "photographs, and at least 3 such photographs are needed%s%s",
                              views->len, n,
                              n > 0 && work->seen[0].why ? "; for example, not in " : "",
                              n > 0 && work->seen[0].why ? work->seen[0].why : "");
    }
    const struct cameras_task *task = work->task;
    const double guess_px =
        task->guess ? task->guess(camera->width, camera->height, task->data) : 0;
    if (!vision_start_camera((const double *const *)views->pdata, counts, (int)views->len, guess_px,
                             camera->width, camera->height, focal, error))
        return FALSE;
    camera->fx_px = focal[0];
    camera->fy_px = focal[1];
    camera->cx_px = (camera->width - 1) / 2.0;
    camera->cy_px = (camera->height - 1) / 2.0;
    cameras_start(work);
    work->bundle.cameras[0].prior_sigma[2] = work->bundle.cameras[0].prior_sigma[3] =
        0.1 * camera->width;
    work->bundle.cameras[0].fixed_pose = TRUE;
    return TRUE;
}

/* Computes W = L⁻¹ from the Cholesky factor of the covariance L Lᵀ. MIN_SIGMA_PX² is first added to
 * both variances. */
static void whiten(const struct corner *corner, double ret[2][2]) {
    const double a = corner->covariance_px2[0][0] + MIN_SIGMA_PX * MIN_SIGMA_PX;
    const double b = corner->covariance_px2[0][1];
    const double c = corner->covariance_px2[1][1] + MIN_SIGMA_PX * MIN_SIGMA_PX;
    const double l = sqrt(a), m = b / l, n = sqrt(MAX(c - m * m, 1e-12));
    ret[0][0] = 1 / l;
    ret[0][1] = 0;
    ret[1][0] = -m / (l * n);
    ret[1][1] = 1 / n;
}

void cameras_set_observations(struct cameras_work *work) {
    g_array_set_size(work->observations, 0);
    for (int i = 0; i < work->task->n_pictures; i++) {
        const struct seen *seen = &work->seen[i];
        for (guint k = 0; seen->corners && k < seen->corners->len; k++) {
            const struct corner *corner = &g_array_index(seen->corners, struct corner, k);
            struct bundle_observation o = {.camera = seen->camera,
                                           .stop = seen->stop,
                                           .picture = i,
                                           .corner = corner->id,
                                           .noise = 1,
                                           .seen_px = {corner->x_px, corner->y_px}};
            board_corner_mm(&work->task->board, corner->id, o.board_mm);
            whiten(corner, o.whiten);
            g_array_append_val(work->observations, o);
        }
    }
    work->bundle.observations = (struct bundle_observation *)(gpointer)work->observations->data;
    work->bundle.n_observations = (int)work->observations->len;
}
