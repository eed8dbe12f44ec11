#include "marks.h"

#include <lapacke.h>
#include <string.h>

#define STEP_MM       0.01
#define STEPS         4
#define PRIOR_MM      1.0   /* what the rig says of a mark's place is within */
#define SYSTEMATIC_PX 0.02  /* of cameras and turntable */
#define UNEVEN_WHITE  0.003 /* of one sighting to the next, beside noise */
#define FEW_SEEN      4

struct place {
    const struct rig *rig;
    const struct mark_seen **seen;
    int n;
    struct vec3 start, now;
    double matrix[9], right[3];
};

static struct vec3 marks_fit_moved(struct vec3 p, int axis, double by) {
    return vec3(p.x + (axis == 0) * by, p.y + (axis == 1) * by, p.z + (axis == 2) * by);
}

/* As marks_measure() expects a mark there; the centroid of its disc lies as far off its middle's
 * picture as it did where it was expected. */
static gboolean marks_fit_project(const struct place *place, const struct mark_seen *seen,
                                  struct vec3 p, double *x, double *y) {
    return rig_project(&place->rig->cameras[seen->camera], rig_turn(p, seen->turntable_rad), x, y);
}

/* How a mark lies on the pixels makes an error that is the same in all pictures of a pose. */
static int marks_fit_same_pose(const struct place *place, const struct mark_seen *seen) {
    int n = 0;
    for (int i = 0; i < place->n; i++)
        n += place->seen[i]->camera == seen->camera &&
             place->seen[i]->turntable_rad == seen->turntable_rad;
    return n;
}

static void marks_fit_add_seen(struct place *place, const struct mark_seen *seen) {
    double x, y, x0, y0, slope[2][3];
    if (!marks_fit_project(place, seen, place->now, &x, &y) ||
        !marks_fit_project(place, seen, place->start, &x0, &y0))
        return;
    for (int a = 0; a < 3; a++) {
        double high_x, high_y, low_x, low_y;
        if (!marks_fit_project(place, seen, marks_fit_moved(place->now, a, STEP_MM), &high_x,
                               &high_y) ||
            !marks_fit_project(place, seen, marks_fit_moved(place->now, a, -STEP_MM), &low_x,
                               &low_y))
            return;
        slope[0][a] = (high_x - low_x) / (2 * STEP_MM);
        slope[1][a] = (high_y - low_y) / (2 * STEP_MM);
    }
    double off[2] = {seen->x_px - seen->expected_x_px - (x - x0),
                     seen->y_px - seen->expected_y_px - (y - y0)};
    double weight = 1 / (seen->error_px * seen->error_px + SYSTEMATIC_PX * SYSTEMATIC_PX) /
                    marks_fit_same_pose(place, seen);
    for (int k = 0; k < 2; k++) {
        for (int a = 0; a < 3; a++) {
            place->right[a] += weight * slope[k][a] * off[k];
            for (int b = 0; b <= a; b++)
                place->matrix[3 * a + b] += weight * slope[k][a] * slope[k][b];
        }
    }
}

static gboolean fit_step(struct place *place) {
    const double prior = 1 / (PRIOR_MM * PRIOR_MM);
    struct vec3 off = vec3_sub(place->start, place->now);
    memset(place->matrix, 0, sizeof place->matrix);
    memset(place->right, 0, sizeof place->right);
    for (int i = 0; i < place->n; i++)
        marks_fit_add_seen(place, place->seen[i]);
    for (int a = 0; a < 3; a++) {
        place->matrix[4 * a] += prior;
        place->right[a] += prior * (a == 0 ? off.x : a == 1 ? off.y : off.z);
    }
    if (LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', 3, place->matrix, 3) != 0)
        return FALSE;
    LAPACKE_dpotrs(LAPACK_ROW_MAJOR, 'L', 3, 1, place->matrix, 3, place->right, 1);
    place->now = vec3_add(place->now, vec3(place->right[0], place->right[1], place->right[2]));
    return TRUE;
}

static gboolean fit_place(struct place *place, struct mark_fit *ret) {
    for (int i = 0; i < STEPS; i++)
        if (!fit_step(place))
            return FALSE;
    LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'L', 3, place->matrix, 3);
    ret->centre_mm = place->now;
    for (int a = 0; a < 3; a++)
        ret->centre_error_mm[a] = sqrt(place->matrix[4 * a]);
    return TRUE;
}

struct white {
    double sum, weight;
};

static double white_of(const struct white *white) {
    return white->sum / white->weight;
}

/* Noise is one thing; another is how well each camera's flat field is known where the mark is seen,
 * which the cameras tell by how they differ. */
static gboolean fit_white(const struct place *place, struct mark_fit *ret) {
    struct white all = {0}, of[RIG_MAX_CAMERAS] = {{0}};
    double spread = 0, apart = 0;
    int n = 0, cameras = 0;
    for (int i = 0; i < place->n; i++) {
        const struct mark_seen *s = place->seen[i];
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
    ret->white = white_of(&all);
    for (int c = 0; c < RIG_MAX_CAMERAS; c++) {
        double share = of[c].weight / all.weight;
        if (!(share > 0))
            continue;
        double off = white_of(&of[c]) - ret->white;
        spread += share * share / of[c].weight;
        apart += share * off * off;
        cameras++;
    }
    ret->white_error = sqrt(spread + apart / MAX(cameras - 1, 1));
    return TRUE;
}

gboolean marks_fit(const struct rig *rig, const struct mark_seen *seen, int n, int mark,
                   gboolean place, struct mark_fit *ret) {
    struct place p = {.rig = rig, .seen = g_new(const struct mark_seen *, n + 1)};
    p.start = p.now = rig->marks[mark].centre_mm;
    memset(ret, 0, sizeof *ret);
    ret->centre_mm = p.start;
    for (int i = 0; i < n; i++)
        if (seen[i].mark == mark)
            p.seen[p.n++] = &seen[i];
    ret->n_seen = p.n;
    gboolean ok = p.n >= FEW_SEEN && fit_white(&p, ret) && (!place || fit_place(&p, ret));
    g_free(p.seen);
    return ok;
}
