/* The causes are found by a greedy search. Each hypothesis has one or three angles a. They are
 * fitted to the displacements d_i (with weights w_i) by least squares,
 *   (Σ w JᵀJ + 1/σ²) a = Σ w Jᵀ d,
 * where J has the derivatives of d with respect to a, and σ is PRIOR_RAD. The prior keeps angles
 * small that the displacements hardly determine.
 *
 * A hypothesis decreases χ² by aᵀ Σ w Jᵀ d. The hypothesis with the largest decrease is accepted,
 * and the displacements that it explains are subtracted from d. This is repeated until no
 * hypothesis is significant. */
#include "fiducials.h"

#include <lapacke.h>
#include <stdlib.h>
#include <string.h>

#define STEP_RAD  1e-5
#define CERTAIN   4.0 /* an angle that exceeds this number of standard errors is certain */
#define MAX_TURNS (RIG_MAX_CAMERAS + 1)
#define PRIOR_RAD 0.02 /* standard deviation of the Gaussian prior of each angle; its mean is 0 */

/* A hypothesis: the turntable slipped, or one camera rotated. */
struct cause {
    int camera; /* −1 for the turntable */
    int n;      /* number of unknowns: one angle, or three angles about the camera's axes */
};

struct checking {
    const struct rig *rig;
    const struct fiducial_seen *seen;
    int n;
    /* n × 2 × 3 derivatives of x and y with respect to up to three angles, in pixels per radian. */
    double *slope;
    /* Three arrays of n numbers: the part of the displacements in x and in y that is not explained
     * yet, in pixels, and the weights 1 / variance. */
    double *off_x, *off_y, *weight;
};

static struct vec3 rotated(struct vec3 v, int axis, double angle) {
    double c = cos(angle), s = sin(angle);
    if (axis == 0)
        return vec3(v.x, c * v.y - s * v.z, s * v.y + c * v.z);
    if (axis == 1)
        return vec3(c * v.x + s * v.z, v.y, c * v.z - s * v.x);
    return vec3(c * v.x - s * v.y, s * v.x + c * v.y, v.z);
}

/* Computes the derivatives of sighting i's x and y with respect to an unknown of a hypothesis, in
 * pixels per radian, with central differences. The derivatives are 0 if the hypothesis is about
 * another camera. */
static void slope_of(const struct checking *check, int i, const struct cause *cause, int unknown,
                     double ret[2]) {
    const struct fiducial_seen *seen = &check->seen[i];
    const struct rig_camera *camera = &check->rig->cameras[seen->camera];
    double x[2] = {0}, y[2] = {0};
    ret[0] = ret[1] = 0;
    if (cause->camera >= 0 && cause->camera != seen->camera)
        return;
    for (int side = 0; side < 2; side++) {
        double angle = side ? STEP_RAD : -STEP_RAD, turn = seen->turntable_rad;
        struct rig_camera now = *camera;
        if (cause->camera >= 0) {
            /* The camera rotated about one of its axes, while its centre stayed in place. In the
             * camera's frame, points therefore rotate in the opposite direction. */
            struct vec3 eye = rig_camera_centre_mm(camera);
            for (int column = 0; column < 3; column++) {
                struct vec3 v = vec3(camera->rotation.m[0][column], camera->rotation.m[1][column],
                                     camera->rotation.m[2][column]);
                v = rotated(v, unknown, -angle);
                now.rotation.m[0][column] = v.x;
                now.rotation.m[1][column] = v.y;
                now.rotation.m[2][column] = v.z;
            }
            now.translation_mm = vec3_scale(mat3_mul_vec(&now.rotation, eye), -1);
        } else {
            turn += angle;
        }
        struct vec3 p =
            rig_sample_point(check->rig, turn, check->rig->fiducials[seen->fiducial].centre_mm);
        if (!rig_project(&now, p, &x[side], &y[side]))
            return;
    }
    ret[0] = (x[1] - x[0]) / (2 * STEP_RAD);
    ret[1] = (y[1] - y[0]) / (2 * STEP_RAD);
}

struct explained {
    /* Angles in radians and their variances. `gain` is the decrease of χ². */
    double angle[3], variance[3], gain;
};

/* Fits one hypothesis by weighted least squares. Returns FALSE if it cannot be solved. */
static gboolean explain(struct checking *check, const struct cause *cause, struct explained *ret) {
    double matrix[9] = {0}, right[3] = {0};
    int n = cause->n;
    for (int i = 0; i < check->n; i++) {
        double *rows = check->slope + 6 * i, slope[2];
        for (int u = 0; u < n; u++) {
            slope_of(check, i, cause, u, slope);
            rows[u] = slope[0];
            rows[3 + u] = slope[1];
        }
        for (int u = 0; u < n; u++) {
            right[u] +=
                check->weight[i] * (rows[u] * check->off_x[i] + rows[3 + u] * check->off_y[i]);
            for (int v = 0; v <= u; v++)
                matrix[u * n + v] +=
                    check->weight[i] * (rows[u] * rows[v] + rows[3 + u] * rows[3 + v]);
        }
    }
    for (int u = 0; u < n; u++)
        matrix[u * n + u] += 1 / (PRIOR_RAD * PRIOR_RAD);
    memset(ret, 0, sizeof *ret);
    memcpy(ret->angle, right, sizeof right);
    if (LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', n, matrix, n) != 0)
        return FALSE;
    LAPACKE_dpotrs(LAPACK_ROW_MAJOR, 'L', n, 1, matrix, n, ret->angle, 1);
    for (int u = 0; u < n; u++)
        ret->gain += right[u] * ret->angle[u];
    LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'L', n, matrix, n);
    for (int u = 0; u < n; u++)
        ret->variance[u] = matrix[u * n + u];
    return TRUE;
}

/* Returns the length |a| of the rotation vector, and its standard error √(Σ (a_u / |a|)² σ_u²) in
 * ret_error. a_u is the angle about axis u, with the variance σ_u². */
static double length_of(const struct explained *by, double *ret_error) {
    double squares = 0, variance = 0;
    for (int u = 0; u < 3; u++)
        squares += by->angle[u] * by->angle[u];
    for (int u = 0; u < 3; u++)
        variance +=
            squares > 0 ? by->angle[u] * by->angle[u] / squares * by->variance[u] : by->variance[u];
    *ret_error = sqrt(variance);
    return sqrt(squares);
}

/* Accepts one hypothesis after the other, beginning with the largest gain. If the turntable has
 * slipped, the slip explains the displacements in all cameras, so it has the largest gain. */
static void find_causes(struct checking *check, double least_deg, struct fiducials_check *ret) {
    gboolean taken[MAX_TURNS] = {FALSE};
    double error;
    for (int round = 0; round < check->rig->n_cameras + 1; round++) {
        struct explained best = {.gain = 0};
        struct cause by = {-1, 0};
        for (int camera = -1; camera < check->rig->n_cameras; camera++) {
            struct cause cause = {camera, camera < 0 ? 1 : 3};
            struct explained found;
            if (taken[camera + 1] || !explain(check, &cause, &found))
                continue;
            const double length = length_of(&found, &error);
            const gboolean significant = found.gain > CERTAIN * CERTAIN &&
                                         length > CERTAIN * error &&
                                         length * 180 / G_PI >= least_deg;
            if (significant && found.gain > best.gain) {
                best = found;
                by = cause;
            }
        }
        if (by.n == 0)
            return;
        taken[by.camera + 1] = TRUE;
        for (int i = 0; i < check->n; i++)
            for (int u = 0; u < by.n; u++) {
                double slope[2];
                slope_of(check, i, &by, u, slope);
                check->off_x[i] -= slope[0] * best.angle[u];
                check->off_y[i] -= slope[1] * best.angle[u];
            }
        const double length = length_of(&best, &error);
        if (by.camera < 0) {
            ret->slipped = TRUE;
            ret->slip_deg += best.angle[0] * 180 / G_PI;
            ret->slip_error_deg = error * 180 / G_PI;
        } else {
            ret->cameras[by.camera].moved = TRUE;
            ret->cameras[by.camera].turn_deg = length * 180 / G_PI;
            ret->cameras[by.camera].turn_error_deg = error * 180 / G_PI;
        }
    }
}

/* Orders pointers to sightings by camera, fiducial and angle of the turntable. */
static int by_picture(const void *a, const void *b) {
    const struct fiducial_seen *p = *(const struct fiducial_seen *const *)a;
    const struct fiducial_seen *q = *(const struct fiducial_seen *const *)b;
    if (p->camera != q->camera)
        return p->camera < q->camera ? -1 : 1;
    if (p->fiducial != q->fiducial)
        return p->fiducial < q->fiducial ? -1 : 1;
    return (p->turntable_rad > q->turntable_rad) - (p->turntable_rad < q->turntable_rad);
}

/* Sets ret[i] to the number of sightings of the same fiducial by the same camera in the same pose
 * as sighting i. Sighting i is counted too. */
static void count_same(const struct fiducial_seen *seen, int n, int *ret) {
    g_autofree const struct fiducial_seen **order = g_new(const struct fiducial_seen *, n + 1);
    for (int i = 0; i < n; i++)
        order[i] = &seen[i];
    qsort(order, (gsize)n, sizeof(gpointer), by_picture);
    for (int i = 0, k; i < n; i += k) {
        for (k = 1; i + k < n && by_picture(&order[i], &order[i + k]) == 0; k++)
            ;
        for (int j = i; j < i + k; j++)
            ret[order[j] - seen] = k;
    }
}

void fiducials_check(const struct rig *rig, const struct fiducial_seen *seen, int n,
                     double systematic_px, double least_deg, struct fiducials_check *ret) {
    struct checking check = {.rig = rig, .seen = seen, .n = n};
    check.slope = g_new0(double, 6 * n + 1);
    check.off_x = g_new0(double, 3 * n + 1);
    check.off_y = check.off_x + n;
    check.weight = check.off_y + n;
    memset(ret, 0, sizeof *ret);
    ret->n_seen = n;
    /* The pixel grid causes an error that all pictures of a pose have in common. All pictures of a
     * pose together therefore count as one picture. */
    g_autofree int *same = g_new(int, n + 1);
    count_same(seen, n, same);
    for (int i = 0; i < n; i++) {
        check.off_x[i] = seen[i].x_px - seen[i].expected_x_px;
        check.off_y[i] = seen[i].y_px - seen[i].expected_y_px;
        check.weight[i] =
            1 / (seen[i].error_px * seen[i].error_px + systematic_px * systematic_px) / same[i];
        ret->rms_px += (check.off_x[i] * check.off_x[i] + check.off_y[i] * check.off_y[i]) / n;
        ret->cameras[seen[i].camera].n_seen++;
    }
    ret->rms_px = sqrt(ret->rms_px);
    if (n > 0)
        find_causes(&check, least_deg, ret);
    g_free(check.slope);
    g_free(check.off_x);
}

struct fiducials_moved fiducials_moved(const struct rig *rig, const struct fiducials_check *check) {
    struct fiducials_moved moved = {.turntable = check->slipped};
    for (int c = 0; c < rig->n_cameras; c++)
        if (check->cameras[c].moved)
            camera_set_add(&moved.cameras, c);
    return moved;
}

struct fiducials_moved fiducials_moved_both(struct fiducials_moved a, struct fiducials_moved b) {
    return (struct fiducials_moved){camera_set_both(a.cameras, b.cameras),
                                    a.turntable && b.turntable};
}

struct fiducials_moved fiducials_moved_without(struct fiducials_moved a, struct fiducials_moved b) {
    return (struct fiducials_moved){camera_set_without(a.cameras, b.cameras),
                                    a.turntable && !b.turntable};
}

struct fiducials_moved fiducials_moved_union(struct fiducials_moved a, struct fiducials_moved b) {
    return (struct fiducials_moved){camera_set_union(a.cameras, b.cameras),
                                    a.turntable || b.turntable};
}

gboolean fiducials_moved_any(struct fiducials_moved moved) {
    return moved.turntable || !camera_set_is_empty(moved.cameras);
}

char *fiducials_describe(const struct rig *rig, const struct fiducials_check *check) {
    g_autoptr(GString) text = g_string_new(NULL);
    if (check->slipped)
        g_string_append_printf(text, "the turntable has slipped by %+.3f° ± %.3f°", check->slip_deg,
                               check->slip_error_deg);
    for (int c = 0; c < rig->n_cameras; c++)
        if (check->cameras[c].moved)
            g_string_append_printf(text, "%scamera %s is turned by %.3f° ± %.3f°",
                                   text->len ? "; " : "", rig->cameras[c].name,
                                   check->cameras[c].turn_deg, check->cameras[c].turn_error_deg);
    return text->len ? g_strdup(text->str) : NULL;
}
