#include "fiducials.h"

#include <lapacke.h>
#include <string.h>

#define STEP_MM       0.01
#define STEPS         4
#define PRIOR_MM      1.0  /* prior standard deviation of a position */
#define SYSTEMATIC_PX 0.02 /* error of cameras and turntable */
/* relative standard deviation of white between sightings, without noise */
#define UNEVEN_WHITE 0.003
#define FEW_SEEN     4

/* The position of one fiducial is found by Gauss-Newton steps on its reprojection error. The prior
 * is the position in the rig file. */
struct position {
    const struct rig *rig;
    const struct fiducial_seen **seen;
    int n;
    struct vec3 start, now;
    double matrix[9], right[3];
};

/* Projects the centre p of the disc (sample frame) to the picture of a sighting. Returns FALSE if
 * the camera does not see p.
 *
 * The centroid of the disc in the picture differs a little from its projected centre. add_seen()
 * uses only differences of two projections, and thus takes this offset as equal at both places. */
static gboolean project(const struct position *position, const struct fiducial_seen *seen,
                        struct vec3 p, double ret[2]) {
    return rig_project(&position->rig->cameras[seen->camera],
                       rig_sample_point(position->rig, seen->turntable_rad, p), &ret[0], &ret[1]);
}

static void add_seen(struct position *position, const struct fiducial_seen *seen) {
    double now[2], start[2], slope[2][3];
    if (!project(position, seen, position->now, now) ||
        !project(position, seen, position->start, start))
        return;
    for (int a = 0; a < 3; a++) {
        struct vec3 step = vec3(a == 0 ? STEP_MM : 0, a == 1 ? STEP_MM : 0, a == 2 ? STEP_MM : 0);
        double high[2], low[2];
        if (!project(position, seen, vec3_add(position->now, step), high) ||
            !project(position, seen, vec3_sub(position->now, step), low))
            return;
        for (int k = 0; k < 2; k++)
            slope[k][a] = (high[k] - low[k]) / (2 * STEP_MM);
    }
    double off[2] = {seen->x_px - seen->expected_x_px - (now[0] - start[0]),
                     seen->y_px - seen->expected_y_px - (now[1] - start[1])};
    /* The pixel grid causes an error that all pictures of a pose have in common. All pictures of a
     * pose together therefore count as one picture. */
    int n = 0;
    for (int i = 0; i < position->n; i++)
        n += position->seen[i]->camera == seen->camera &&
             position->seen[i]->turntable_rad == seen->turntable_rad;
    double weight = 1 / (seen->error_px * seen->error_px + SYSTEMATIC_PX * SYSTEMATIC_PX) / n;
    for (int k = 0; k < 2; k++) {
        for (int a = 0; a < 3; a++) {
            position->right[a] += weight * slope[k][a] * off[k];
            for (int b = 0; b <= a; b++)
                position->matrix[3 * a + b] += weight * slope[k][a] * slope[k][b];
        }
    }
}

static gboolean fit_place(struct position *position, struct fiducial_fit *ret) {
    for (int i = 0; i < STEPS; i++) {
        /* Make one Gauss-Newton step dx, with the displacements d, their derivatives J and weights
         * w, and the prior's standard deviation σ: (Σ w JᵀJ + I/σ²) dx = Σ w Jᵀ d + (start −
         * now)/σ². */
        const double prior = 1 / (PRIOR_MM * PRIOR_MM);
        struct vec3 off = vec3_sub(position->start, position->now);
        memset(position->matrix, 0, sizeof position->matrix);
        memset(position->right, 0, sizeof position->right);
        for (int k = 0; k < position->n; k++)
            add_seen(position, position->seen[k]);
        for (int a = 0; a < 3; a++) {
            position->matrix[4 * a] += prior;
            position->right[a] += prior * (a == 0 ? off.x : a == 1 ? off.y : off.z);
        }
        if (LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', 3, position->matrix, 3) != 0)
            return FALSE;
        LAPACKE_dpotrs(LAPACK_ROW_MAJOR, 'L', 3, 1, position->matrix, 3, position->right, 1);
        position->now = vec3_add(position->now,
                                 vec3(position->right[0], position->right[1], position->right[2]));
    }
    LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'L', 3, position->matrix, 3);
    ret->centre_mm = position->now;
    for (int a = 0; a < 3; a++)
        ret->centre_error_mm[a] = sqrt(position->matrix[4 * a]);
    return TRUE;
}

struct white {
    double sum, weight;
};

/* Computes white and its standard error. The error contains the noise and the spread between the
 * cameras. The cameras differ because each has a different error of its flat field at the
 * fiducial's place in its pictures. Returns FALSE if fewer than FEW_SEEN sightings have an
 * output. */
static gboolean fit_white(const struct position *position, struct fiducial_fit *ret) {
    struct white all = {0}, of[RIG_MAX_CAMERAS] = {{0}};
    double spread = 0, apart = 0;
    int n = 0, cameras = 0;
    for (int i = 0; i < position->n; i++) {
        const struct fiducial_seen *s = position->seen[i];
        if (!isfinite(s->output_error))
            continue;
        double w = 1 / (s->output_error * s->output_error + UNEVEN_WHITE * UNEVEN_WHITE);
        all.sum += w * s->output;
        all.weight += w;
        of[s->camera].sum += w * s->output;
        of[s->camera].weight += w;
        n++;
    }
    if (n < FEW_SEEN)
        return FALSE;
    ret->white = all.sum / all.weight;
    for (int c = 0; c < RIG_MAX_CAMERAS; c++) {
        double share = of[c].weight / all.weight;
        if (!(share > 0))
            continue;
        double off = of[c].sum / of[c].weight - ret->white;
        spread += share * share / of[c].weight;
        apart += share * off * off;
        cameras++;
    }
    ret->white_error = sqrt(spread + apart / MAX(cameras - 1, 1));
    return TRUE;
}

gboolean fiducials_fit(const struct rig *rig, const struct fiducial_seen *seen, int n, int fiducial,
                       gboolean place, struct fiducial_fit *ret) {
    struct position p = {.rig = rig, .seen = g_new(const struct fiducial_seen *, n + 1)};
    p.start = p.now = rig->fiducials[fiducial].centre_mm;
    memset(ret, 0, sizeof *ret);
    ret->centre_mm = p.start;
    for (int i = 0; i < n; i++)
        if (seen[i].fiducial == fiducial)
            p.seen[p.n++] = &seen[i];
    ret->n_seen = p.n;
    gboolean ok = p.n >= FEW_SEEN && fit_white(&p, ret) && (!place || fit_place(&p, ret));
    g_free(p.seen);
    return ok;
}
