/* This file measures the lateral colour of the lenses of cameras with a colour filter. Each picture
 * gives the magnification of red and blue relative to green, from the edges at all of its corners
 * with the geometry known. The results of one lens are averaged. */
#include "cameras_private.h"

#include <math.h>
#include <string.h>

#define MIN_CORNERS  6    /* smallest number of corners with which a picture counts */
#define MIN_PICTURES 3    /* smallest number of pictures that give the lateral colour of a lens */
#define ROUNDS       4    /* largest number of Gauss-Newton steps for a picture */
#define SETTLED      1e-7 /* change of the magnifications below which the steps end */
/* smallest deviation of both colours together that is corrected, in standard errors */
#define SIGNIFICANT 4

struct lateral { /* result of one picture, for red [0] and blue [1], as in struct corner_lateral */
    double normal[2][2], larger[2];
};

static gboolean solve2(const double a[2][2], const double b[2], double ret[2]) {
    const double det = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    ret[0] = (a[1][1] * b[0] - a[0][1] * b[1]) / det;
    ret[1] = (a[0][0] * b[1] - a[1][0] * b[0]) / det;
    return det > 1e-12 * a[0][0] * a[1][1];
}

/* Returns dᵀ a d. */
static double form(const double a[2][2], const double d[2]) {
    return a[0][0] * d[0] * d[0] + 2 * a[0][1] * d[0] * d[1] + a[1][1] * d[1] * d[1];
}

/* Measures picture i. work->lateral[i].normal stays 0 if the picture gives no result. Returns
 * FALSE only if the picture cannot be read. */
static gboolean look_at(struct cameras_work *work, int i, double reach_px, GError **error) {
    const struct seen *seen = &work->seen[i];
    const struct bundle *b = &work->bundle;
    const struct board *board = &work->task->board;
    const struct cameras_look at = {b, seen->camera, seen->stop};
    const double *lens = b->cameras[seen->camera].intrinsics;
    g_autofree guint8 *wanted = g_new0(guint8, board_n_corners(board));
    g_autoptr(Picture) picture = work->task->read(i, work->task->data, error);
    struct corner_lateral lateral = {.centre_px = {lens[2], lens[3]}};
    double change[2] = {1, 1};
    if (!picture)
        return FALSE;
    for (int k = 0; k < b->n_observations; k++)
        if (b->observations[k].picture == i && !b->observations[k].rejected)
            wanted[b->observations[k].corner] = 1;
    for (int round = 0; round < ROUNDS && hypot(change[0], change[1]) > SETTLED; round++) {
        memset(lateral.normal, 0, sizeof lateral.normal);
        memset(lateral.right, 0, sizeof lateral.right);
        if (board_lateral(picture, board, cameras_project, &at, wanted, &lateral) < MIN_CORNERS ||
            !solve2(lateral.normal, lateral.right, change))
            return TRUE;
        for (int k = 0; k < 2; k++)
            lateral.larger[k] += change[k];
        if (!(fabs(lateral.larger[0]) < RIG_MAX_LATERAL) ||
            !(fabs(lateral.larger[1]) < RIG_MAX_LATERAL))
            return TRUE;
    }
    memcpy(work->lateral[i].normal, lateral.normal, sizeof lateral.normal);
    memcpy(work->lateral[i].larger, lateral.larger, sizeof lateral.larger);
    return TRUE;
}

/* Averages the pictures i of one lens: c = N⁻¹ Σ N_i c_i with N = Σ N_i, where N_i is `normal` and
 * c_i is `larger` of picture i. The covariance of c is f N⁻¹. The factor f = Σ (c_i − c)ᵀ N_i (c_i
 * − c) / 2 (n − 1), at least 1, says how much more the n pictures scatter than their noise
 * explains.
 *
 * The lens parameters are the mean over all pixels of a filter that has twice as many green pixels
 * as red or blue ones. Relative to this mean, green is larger by −(red + blue) / 4, where red and
 * blue are the two elements of c. A result that is not significant is only noise and is not
 * applied. */
static void average(struct cameras_work *work, int unit) {
    static const double mix[3][2] = {{0.75, -0.25}, {-0.25, -0.25}, {-0.25, 0.75}};
    double normal[2][2] = {{0}}, right[2] = {0}, mean[2], scatter = 0;
    int n = 0;
    for (int i = 0; i < work->task->n_pictures; i++) {
        const struct lateral *one = &work->lateral[i];
        const int camera = work->seen[i].camera;
        if (camera - work->bundle.cameras[camera].stop != unit || !(one->normal[0][0] > 0))
            continue;
        n++;
        for (int k = 0; k < 2; k++)
            for (int l = 0; l < 2; l++) {
                normal[k][l] += one->normal[k][l];
                right[k] += one->normal[k][l] * one->larger[l];
            }
    }
    if (n < MIN_PICTURES || !solve2(normal, right, mean))
        return;
    for (int i = 0; i < work->task->n_pictures; i++) {
        const struct lateral *one = &work->lateral[i];
        const int camera = work->seen[i].camera;
        const double off[2] = {one->larger[0] - mean[0], one->larger[1] - mean[1]};
        if (camera - work->bundle.cameras[camera].stop == unit)
            scatter += form(one->normal, off);
    }
    const double f = MAX(scatter / (2 * (n - 1)), 1);
    const gboolean significant = form(normal, mean) > SIGNIFICANT * SIGNIFICANT * f;
    for (int c = 0; c < work->bundle.n_cameras; c++)
        for (int colour = 0; colour < 3 && c - work->bundle.cameras[c].stop == unit; colour++) {
            double by[2];
            if (!solve2(normal, mix[colour], by))
                return;
            work->lateral_error[c][colour] =
                sqrt(f * (mix[colour][0] * by[0] + mix[colour][1] * by[1]));
            if (significant)
                work->lateral_colour[c][colour] =
                    mix[colour][0] * mean[0] + mix[colour][1] * mean[1];
        }
}

gboolean cameras_find_lateral(struct cameras_work *work, GError **error) {
    const int n = work->task->n_pictures;
    g_autofree double *reach_px = g_new(double, n + 1);
    g_autofree struct lateral *lateral = g_new0(struct lateral, n + 1);
    for (int i = 0; i < n; i++)
        reach_px[i] = work->seen[i].coloured && work->seen[i].corners ? 0 : -1;
    work->lateral = lateral;
    const gboolean ok = cameras_for_each(work, look_at, reach_px, error);
    for (int c = 0; ok && c < work->bundle.n_cameras; c++)
        if (work->bundle.cameras[c].stop == 0)
            average(work, c);
    work->lateral = NULL;
    return ok;
}
