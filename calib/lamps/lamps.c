/* Least squares (geometry/fit.h) over all sights. A residual is the predicted minus the measured
 * position, divided by its standard deviation. The parameters are
 *   tilt and centre of the arc's axis  4, if the arc angles cover at least MIN_ARC
 *   position of each lamp              3
 *   position of each mark              2
 *   size of each mark                  1, if the target gives a tolerance above 0
 *   offset of each camera              2, with the prior σ = LAMPS_CAMERA_PX
 *   error of each angle of a drive     1, with σ estimated by drive.h */
#include "lamps.h"

#include "base/residual.h"
#include "geometry/drive.h"

#include <math.h>
#include <string.h>

G_DEFINE_QUARK(lamps_error, lamps_error)

#define REJECT     4.5
#define MIN_SIGHTS 6 /* smallest number of sights that locate a lamp */
/* smallest range of arc angles that determines the axis */
#define MIN_ARC         (60 * G_PI / 180)
#define MAX_LAMP_MM     10.0 /* largest standard error of a lamp's position */
#define HIGHLIGHT_STEPS 50
/* A lamp counts as exchanged with another lamp if the distance from its own place is more than this
 * factor times the distance from the other lamp's place. */
#define EXCHANGED 5.0
/* Constants of the search for other sizes of the marks:
 *   LOOSE      standard deviation of a size, as a share of the largest size
 *   BETTER     factor by which the sights must fit better
 *   EXPLAINED  largest residual afterwards, in standard deviations
 *   CERTAIN    number of standard errors (or tolerances, if these are larger) from which a size
 *              counts as different
 *   ALIKE      range of the ratios of sizes that are all wrong by the same factor */
#define MISFITS   0.03 /* share of sights that do not fit above which a mistake is searched for */
#define LOOSE     0.2
#define BETTER    3.0
#define EXPLAINED 2.0
#define CERTAIN   5.0
#define ALIKE     1.02

/* Columns of the parameters that a sight depends on: arc, lamp, mark and its size, camera,
 * drives. */
enum { ON_ARC, ON_LAMP = 4, ON_MARK = 7, ON_SIZE = 9, ON_CAMERA, ON_TURN = 12, ON_SWING, ON };

struct problem {
    const struct rig *rig; /* nominal */
    const struct lamp_target *target;
    const struct lamp_sight *sights;
    int n;
    gboolean fit_arc;
    int lamp_at[RIG_MAX_LAMPS]; /* first parameter; −1 if the lamp is not seen */
    int mark_at[LAMP_MAX_MARKS];
    int camera_at[RIG_MAX_CAMERAS];
    int size_at[LAMP_MAX_MARKS];
    struct drive turntable, arc;
    int *turn, *swing; /* for each sight, the index of the drive's angle, or −1 */
    double (*tilt)[2]; /* for each sight, the tilt of the turntable because of its wobble */
    /* n × 4: derivatives of the sight's position with respect to the camera's offset in pixels: x
     * by across, x by down, y by across, y by down */
    double *shift;
    int n_parameters;
};

struct vec3 lamp_mark_mm(const struct lamp_target *target, int mark, double turntable_rad) {
    const struct lamp_mark *m = &target->marks[mark];
    double z = target->plane_mm + (target->kind == LAMP_BALLS ? m->size_mm : 0);
    return rig_turn(vec3(m->x_mm, m->y_mm, z), turntable_rad);
}

/* The shadow of a post of height h ends at e = t + (t − l) h / (l_z − t_z), where t is the top and
 * l the lamp. Its radius grows by the factor 1 + h / (l_z − t_z). */
gboolean lamp_shadow_mm(const struct lamp_target *target, int mark, struct vec3 foot_mm,
                        struct vec3 lamp_mm, struct vec3 *ret_end_mm, double *ret_radius_mm) {
    double height = target->marks[mark].size_mm;
    double above = lamp_mm.z - foot_mm.z - height;
    if (!(above > 0))
        return FALSE;
    struct vec3 top = vec3(foot_mm.x, foot_mm.y, foot_mm.z + height);
    *ret_end_mm = vec3_add(top, vec3_scale(vec3_sub(top, lamp_mm), height / above));
    if (ret_radius_mm)
        *ret_radius_mm = target->radius_mm * (1 + height / above);
    return TRUE;
}

/* The normal at the highlight bisects the directions to camera and lamp. The fixed-point iteration
 * p ← c + r · unit(unit(eye − p) + unit(lamp − p)) converges fast if the ball is far from both. */
gboolean lamp_highlight_px(const struct rig_camera *camera, struct vec3 centre_mm, double radius_mm,
                           struct vec3 lamp_mm, double *ret_x, double *ret_y) {
    struct vec3 eye = rig_camera_centre_mm(camera), p = centre_mm;
    for (int i = 0; i < HIGHLIGHT_STEPS; i++) {
        struct vec3 half = vec3_add(vec3_unit(vec3_sub(eye, p)), vec3_unit(vec3_sub(lamp_mm, p)));
        if (!(vec3_length(half) > 1e-6))
            return FALSE;
        struct vec3 next = vec3_add(centre_mm, vec3_scale(vec3_unit(half), radius_mm));
        double step = vec3_length(vec3_sub(next, p));
        p = next;
        if (step < 1e-12 * radius_mm)
            break;
    }
    return rig_project(camera, p, ret_x, ret_y);
}

static struct rig_arc arc_at(const struct problem *problem, const double *x) {
    struct rig_arc arc = problem->rig->arc;
    if (problem->fit_arc) {
        arc.tilt_rad[0] = x[0];
        arc.tilt_rad[1] = x[1];
        arc.centre_mm[0] = x[2];
        arc.centre_mm[1] = x[3];
    }
    return arc;
}

static struct rig_lamp lamp_of(const struct problem *problem, const double *x, int lamp) {
    struct rig_lamp found = problem->rig->lamps[lamp];
    const double *p = x + problem->lamp_at[lamp];
    found.position_mm = vec3(p[0], p[1], p[2]);
    return found;
}

static void target_of(const struct problem *problem, const double *x, struct lamp_target *ret) {
    *ret = *problem->target;
    for (int i = 0; i < ret->n; i++)
        if (problem->mark_at[i] >= 0) {
            ret->marks[i].x_mm = x[problem->mark_at[i]];
            ret->marks[i].y_mm = x[problem->mark_at[i] + 1];
            ret->marks[i].size_mm = problem->target->marks[i].size_mm +
                                    (problem->size_at[i] >= 0 ? x[problem->size_at[i]] : 0);
        }
}

/* Predicts the position of a sight. turntable_rad is the true angle, and tilt_rad the tilt of the
 * turntable's axis. The end of a shadow is given in the sample frame of the commanded angle.
 * Returns FALSE if the shadow or highlight is not visible. */
static gboolean predict(const struct problem *problem, const struct lamp_target *target,
                        const struct lamp_sight *sight, double turntable_rad,
                        const double tilt_rad[2], struct vec3 lamp_mm, double ret[2]) {
    if (target->kind == LAMP_BALLS)
        return lamp_highlight_px(
            &problem->rig->cameras[sight->camera],
            rig_tilt_point(tilt_rad, lamp_mark_mm(target, sight->mark, turntable_rad), 1),
            target->marks[sight->mark].size_mm, lamp_mm, &ret[0], &ret[1]);
    struct vec3 end, lamp = rig_turn(rig_tilt_point(tilt_rad, lamp_mm, -1), -turntable_rad);
    if (!lamp_shadow_mm(target, sight->mark, lamp_mark_mm(target, sight->mark, 0), lamp, &end,
                        NULL))
        return FALSE;
    end = rig_turn(end, turntable_rad - sight->turntable_rad);
    ret[0] = end.x;
    ret[1] = end.y;
    return TRUE;
}

static void residuals(const double *x, double *ret, gconstpointer data) {
    const struct problem *problem = data;
    struct lamp_target target;
    struct rig_arc arc = arc_at(problem, x);
    struct rig_lamp lamps[RIG_MAX_LAMPS];
    target_of(problem, x, &target);
    for (int i = 0; i < problem->rig->n_lamps; i++)
        if (problem->lamp_at[i] >= 0)
            lamps[i] = lamp_of(problem, x, i);
    for (int i = 0; i < problem->n; i++) {
        const struct lamp_sight *s = &problem->sights[i];
        const double off = problem->swing[i] >= 0 ? x[problem->arc.at + problem->swing[i]] : 0;
        struct vec3 lamp = s->lamp < 0
                               ? rig_camera_centre_mm(&problem->rig->cameras[s->camera])
                               : rig_lamp_position_mm(&arc, &lamps[s->lamp], s->arc_rad + off);
        const double *d = x + problem->camera_at[s->camera], *shift = problem->shift + 4 * i;
        double at[2] = {0, 0};
        gboolean seen = predict(problem, &target, s,
                                s->turntable_rad + x[problem->turntable.at + problem->turn[i]],
                                problem->tilt[i], lamp, at);
        at[0] += shift[0] * d[0] + shift[1] * d[1];
        at[1] += shift[2] * d[0] + shift[3] * d[1];
        ret[2 * i] = seen ? (at[0] - s->x) / s->sigma : FIT_LOST;
        ret[2 * i + 1] = seen ? (at[1] - s->y) / s->sigma : FIT_LOST;
    }
}

/* Computes the derivative of a point on the plate (mm) with respect to the camera's offset (px).
 * This is the inverse of the Jacobian of the camera's projection there. ret is not changed if the
 * point is not visible. */
static void find_shift(const struct problem *problem, const struct lamp_sight *s, double ret[4]) {
    const struct rig_camera *camera = &problem->rig->cameras[s->camera];
    double x[3], y[3];
    for (int k = 0; k < 3; k++) {
        struct vec3 p = vec3(s->x + (k == 1), s->y + (k == 2), problem->target->plane_mm);
        if (!rig_project(camera, rig_sample_point(problem->rig, s->turntable_rad, p), &x[k], &y[k]))
            return; /* not visible */
    }
    double a = x[1] - x[0], b = x[2] - x[0], c = y[1] - y[0], d = y[2] - y[0];
    double det = a * d - b * c;
    if (!(fabs(det) > 1e-9))
        return;
    ret[0] = d / det, ret[1] = -b / det, ret[2] = -c / det, ret[3] = a / det;
}

/* Returns whether a sight depends on the arc. A sight of a post itself, or of a fixed lamp, does
 * not. */
static gboolean is_on_arc(const struct problem *problem, const struct lamp_sight *sight) {
    return sight->lamp >= 0 && !problem->rig->lamps[sight->lamp].fixed;
}

/* Returns the range of the arc angles of the sights that depend on the arc: 2π minus the largest
 * gap between neighbours. Returns 0 if no lamp is on the arc. */
static double spread_rad(const struct problem *problem) {
    g_autofree double *turns = g_new(double, problem->n + 1);
    int n = 0;
    for (int i = 0; i < problem->n; i++) {
        const struct lamp_sight *s = &problem->sights[i];
        if (is_on_arc(problem, s))
            turns[n++] = s->arc_rad - 2 * G_PI * floor(s->arc_rad / (2 * G_PI));
    }
    if (n == 0)
        return 0;
    qsort(turns, (gsize)n, sizeof *turns, fit_compare);
    double gap = turns[0] + 2 * G_PI - turns[n - 1];
    for (int i = 1; i < n; i++)
        gap = MAX(gap, turns[i] - turns[i - 1]);
    return 2 * G_PI - gap;
}

static gboolean refuse_few(const char *what, const char *name, int n, GError **error) {
    g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_DEGENERATE,
                "%s %s: %d usable shadow(s) or highlight(s) were found, and at least %d are needed "
                "to locate it; take more pictures with this lamp",
                what, name, n, MIN_SIGHTS);
    return FALSE;
}

/* Collects the different angles of the drives, and the effect of a camera's offset on each
 * sight. */
static void find_angles(struct problem *problem) {
    drive_init(&problem->turntable, problem->n);
    drive_init(&problem->arc, problem->n);
    for (int i = 0; i < problem->n; i++) {
        const struct lamp_sight *s = &problem->sights[i];
        double *shift = problem->shift + 4 * (gsize)i;
        problem->turn[i] = drive_angle(&problem->turntable, s->turntable_rad);
        problem->swing[i] = is_on_arc(problem, s) ? drive_angle(&problem->arc, s->arc_rad) : -1;
        if (problem->target->kind == LAMP_BALLS)
            shift[0] = shift[3] = 1;
        else
            find_shift(problem, s, shift);
    }
}

static int *new_depends(const struct problem *problem) {
    int *depends = g_new(int, (gsize)problem->n *ON);
    for (int i = 0; i < problem->n; i++) {
        const struct lamp_sight *s = &problem->sights[i];
        int *of = depends + (gsize)i * ON;
        for (int k = 0; k < 4; k++)
            of[ON_ARC + k] = problem->fit_arc && is_on_arc(problem, s) ? k : -1;
        for (int k = 0; k < 3; k++)
            of[ON_LAMP + k] = s->lamp >= 0 ? problem->lamp_at[s->lamp] + k : -1;
        for (int k = 0; k < 2; k++) {
            of[ON_MARK + k] = problem->mark_at[s->mark] + k;
            of[ON_CAMERA + k] = problem->camera_at[s->camera] + k;
        }
        of[ON_SIZE] = problem->size_at[s->mark];
        of[ON_TURN] = problem->turntable.at + problem->turn[i];
        of[ON_SWING] = problem->swing[i] >= 0 ? problem->arc.at + problem->swing[i] : -1;
    }
    return depends;
}

/* Assigns the indices of the parameters. Returns FALSE with an error if no sight is of a lamp, or
 * if a lamp has too few sights. */
static gboolean lay_out(struct problem *problem, GError **error) {
    int lamps[RIG_MAX_LAMPS] = {0}, marks[LAMP_MAX_MARKS] = {0}, seen = 0;
    gboolean cameras[RIG_MAX_CAMERAS] = {FALSE};
    for (int i = 0; i < problem->n; i++) {
        if (problem->sights[i].lamp >= 0) {
            lamps[problem->sights[i].lamp]++;
            seen++;
        }
        marks[problem->sights[i].mark]++;
        cameras[problem->sights[i].camera] = TRUE;
    }
    if (seen == 0) {
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "no picture shows a post or ball lit by a lamp; check the target's "
                    "description, the target's place on the turntable, and the exposure");
        return FALSE;
    }
    problem->fit_arc = spread_rad(problem) >= MIN_ARC;
    problem->n_parameters = problem->fit_arc ? 4 : 0;
    for (int i = 0; i < RIG_MAX_LAMPS; i++) {
        problem->lamp_at[i] = lamps[i] ? problem->n_parameters : -1;
        if (lamps[i] > 0 && lamps[i] < MIN_SIGHTS)
            return refuse_few("lamp", problem->rig->lamps[i].name, lamps[i], error);
        problem->n_parameters += lamps[i] ? 3 : 0;
    }
    for (int i = 0; i < LAMP_MAX_MARKS; i++) {
        problem->mark_at[i] = marks[i] ? problem->n_parameters : -1;
        problem->n_parameters += marks[i] ? 2 : 0;
        problem->size_at[i] =
            marks[i] && problem->target->tolerance_mm > 0 ? problem->n_parameters++ : -1;
    }
    for (int i = 0; i < RIG_MAX_CAMERAS; i++) {
        problem->camera_at[i] = cameras[i] ? problem->n_parameters : -1;
        problem->n_parameters += cameras[i] ? 2 : 0;
    }
    problem->turntable.at = problem->n_parameters;
    problem->arc.at = problem->turntable.at + problem->turntable.n;
    problem->n_parameters = problem->arc.at + problem->arc.n;
    return TRUE;
}

/* Sets the initial parameters x, and the standard deviations of their priors. drive_fit() completes
 * these. */
static void start(const struct problem *problem, double *x, double *sigma) {
    const struct rig_arc *arc = &problem->rig->arc;
    if (problem->fit_arc) {
        x[0] = arc->tilt_rad[0], x[1] = arc->tilt_rad[1];
        x[2] = arc->centre_mm[0], x[3] = arc->centre_mm[1];
    }
    for (int i = 0; i < problem->rig->n_lamps; i++)
        if (problem->lamp_at[i] >= 0) {
            double *p = x + problem->lamp_at[i];
            struct vec3 at = problem->rig->lamps[i].position_mm;
            p[0] = at.x, p[1] = at.y, p[2] = at.z;
        }
    for (int i = 0; i < problem->target->n; i++)
        if (problem->mark_at[i] >= 0) {
            x[problem->mark_at[i]] = problem->target->marks[i].x_mm;
            x[problem->mark_at[i] + 1] = problem->target->marks[i].y_mm;
        }
    for (int i = 0; i < LAMP_MAX_MARKS; i++)
        if (problem->size_at[i] >= 0)
            sigma[problem->size_at[i]] = problem->target->tolerance_mm;
    for (int i = 0; i < RIG_MAX_CAMERAS; i++)
        for (int k = 0; problem->camera_at[i] >= 0 && k < 2; k++)
            sigma[problem->camera_at[i] + k] = LAMPS_CAMERA_PX;
}

static double covariance_at(const struct problem *problem, const struct fit_result *fit, int i,
                            int j) {
    return fit->covariance[i * problem->n_parameters + j];
}

/* Sets the zero of the arc's angle. Rotates all lamps on the arc by −φ so that their positions p
 * are closest to the nominal ones n: tan φ = Σ (n × p)_z / Σ n·p in the xy plane. The arc's zero
 * compensates for the rotation. Each lamp's aim is rotated with its position. */
static void set_zero(const struct problem *problem, const struct fit_result *fit,
                     struct lamps_result *ret) {
    double cross = 0, dot = 0, variance = 0;
    g_autofree double *slope = g_new0(double, problem->n_parameters);
    for (int i = 0; i < problem->rig->n_lamps; i++) {
        struct vec3 from = problem->rig->lamps[i].position_mm, to = ret->rig.lamps[i].position_mm;
        if (problem->lamp_at[i] < 0 || problem->rig->lamps[i].fixed)
            continue;
        cross += from.x * to.y - from.y * to.x;
        dot += from.x * to.x + from.y * to.y;
        slope[problem->lamp_at[i]] = -from.y;
        slope[problem->lamp_at[i] + 1] = from.x;
    }
    double turn = dot > 0 ? atan2(cross, dot) : 0;
    for (int i = 0; i < problem->n_parameters; i++)
        for (int j = 0; j < problem->n_parameters; j++)
            variance += slope[i] * slope[j] * covariance_at(problem, fit, i, j);
    ret->zero_error_rad = dot > 0 ? sqrt(MAX(variance, 0)) / dot : 0;
    ret->rig.arc.zero_rad = remainder(ret->rig.arc.zero_rad + turn, 2 * G_PI);
    for (int i = 0; i < problem->rig->n_lamps; i++)
        if (problem->lamp_at[i] >= 0) {
            struct rig_lamp *lamp = &ret->rig.lamps[i];
            if (!lamp->fixed)
                lamp->position_mm = rig_turn(lamp->position_mm, -turn);
            /* Rotates the aim together with the position (Rodrigues' formula), so that its angle to
             * the origin stays the same. */
            struct vec3 from = vec3_unit(problem->rig->lamps[i].position_mm);
            struct vec3 to = vec3_unit(lamp->position_mm), axis = vec3_cross(from, to);
            double s = vec3_length(axis), c = vec3_dot(from, to);
            struct vec3 k = vec3_scale(axis, 1 / s), v = problem->rig->lamps[i].aim;
            if (s > 1e-15)
                lamp->aim =
                    vec3_unit(vec3_add(vec3_add(vec3_scale(v, c), vec3_scale(vec3_cross(k, v), s)),
                                       vec3_scale(k, vec3_dot(k, v) * (1 - c))));
        }
}

/* Computes the covariance G C Gᵀ of a lamp's position with the arc at 0. G has the numerical
 * derivatives of the position with respect to the arc's axis and the lamp's parameters. C is the
 * covariance of these parameters. */
static void place_covariance(const struct problem *problem, const double *x,
                             const struct fit_result *fit, int lamp, double ret[3][3]) {
    const int n = problem->n_parameters, at = problem->lamp_at[lamp];
    int of[7], count = 0;
    struct vec3 by[7];
    g_autofree double *moved = g_memdup2(x, sizeof(double) * (gsize)n);
    for (int k = 0; problem->fit_arc && k < 4; k++)
        of[count++] = k;
    for (int k = 0; k < 3; k++)
        of[count++] = at + k;
    for (int i = 0; i < count; i++) {
        const double step = of[i] < 2 && problem->fit_arc ? 1e-5 : 1e-2;
        struct vec3 place[2];
        for (int side = 0; side < 2; side++) {
            moved[of[i]] = x[of[i]] + (side ? step : -step);
            const struct rig_arc arc = arc_at(problem, moved);
            const struct rig_lamp found = lamp_of(problem, moved, lamp);
            place[side] = rig_lamp_position_mm(&arc, &found, 0);
        }
        moved[of[i]] = x[of[i]];
        by[i] = vec3_scale(vec3_sub(place[1], place[0]), 0.5 / step);
    }
    memset(ret, 0, sizeof(double) * 9);
    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++) {
            const double c = covariance_at(problem, fit, of[i], of[j]);
            const double a[3] = {by[i].x, by[i].y, by[i].z}, b[3] = {by[j].x, by[j].y, by[j].z};
            for (int k = 0; k < 9; k++)
                ret[k / 3][k % 3] += c * a[k / 3] * b[k % 3];
        }
}

static void take(const struct problem *problem, const double *x, struct fit_result *fit,
                 struct lamps_result *ret) {
    ret->rig = *problem->rig;
    ret->rig.arc = arc_at(problem, x);
    ret->arc_known = problem->fit_arc;
    target_of(problem, x, &ret->target);
    /* Keep the given sizes, because another round must not use measured ones as its prior. */
    for (int i = 0; i < ret->target.n; i++)
        ret->target.marks[i].size_mm = problem->target->marks[i].size_mm;
    for (int i = 0; i < ret->target.n; i++) {
        const int at = problem->size_at[i];
        ret->size_mm[i] = problem->target->marks[i].size_mm + (at >= 0 ? x[at] : 0);
        ret->size_error_mm[i] = at >= 0 ? sqrt(MAX(covariance_at(problem, fit, at, at), 0)) : 0;
    }
    for (int k = 0; problem->fit_arc && k < 2; k++) {
        ret->tilt_error_rad[k] = sqrt(covariance_at(problem, fit, k, k));
        ret->centre_error_mm[k] = sqrt(covariance_at(problem, fit, k + 2, k + 2));
    }
    for (int i = 0; i < problem->rig->n_lamps; i++) {
        int at = problem->lamp_at[i];
        ret->seen[i] = at >= 0;
        if (at < 0)
            continue;
        ret->rig.lamps[i].position_mm = lamp_of(problem, x, i).position_mm;
        place_covariance(problem, x, fit, i, ret->covariance_mm2[i]);
    }
    set_zero(problem, fit, ret);
    double sum = 0;
    for (int i = 0; i < problem->n; i++) {
        const struct lamp_sight *s = &problem->sights[i];
        if (fit->rejected[i])
            continue;
        ret->n_used++;
        if (s->lamp >= 0)
            ret->sights[s->lamp]++;
        sum += s->sigma * s->sigma *
               (pow(fit->residuals[2 * i], 2) + pow(fit->residuals[2 * i + 1], 2));
    }
    ret->rms = sqrt(sum / MAX(2 * ret->n_used, 1));
    ret->sigma = fit->sigma;
    ret->turntable_rad = problem->turntable.sigma_rad;
    ret->drive_rad = problem->arc.sigma_rad;
    ret->degrees_of_freedom = fit->degrees_of_freedom;
    ret->rejected = g_steal_pointer(&fit->rejected);
}

/* Returns whether the sights disagree by more than noise. */
static gboolean is_misfit(const struct lamps_result *result, int n) {
    return result->sigma > RESIDUAL_LIMIT || n - result->n_used > MISFITS * n;
}

static gboolean check_result(const struct problem *problem, const struct fit_result *fit,
                             const struct lamps_result *ret, GError **error) {
    for (int i = 0; i < problem->rig->n_lamps; i++) {
        const double(*c)[3] = ret->covariance_mm2[i];
        if (!ret->seen[i])
            continue;
        const char *name = problem->rig->lamps[i].name;
        if (ret->sights[i] < MIN_SIGHTS)
            return refuse_few("lamp", name, ret->sights[i], error);
        double spread = sqrt(c[0][0] + c[1][1] + c[2][2]);
        if (spread > 0 && spread < MAX_LAMP_MM && fit->undetermined < 0)
            continue;
        /* The errors grow with the residuals, and with the number of sights that are left out
         * because they do not fit. If sights that contradict each other cause the large error,
         * another arrangement of the target does not help. */
        if (fit->undetermined < 0 && is_misfit(ret, problem->n))
            g_set_error(
                error, LAMPS_ERROR, LAMPS_ERROR_DEGENERATE,
                "lamp %s: its position has a standard error of %.3g mm, because the measured "
                "shadows or highlights contradict each other: %d of %d do not fit, and the others "
                "are %.2g %s (RMS) from their predicted places, %.1f times what noise explains. "
                "Check the target's description, that the target lies on the turntable without "
                "moving, that the cameras have not moved since they were calibrated, and whether "
                "the turntable's bearing wobbles (“mesorig calibrate cameras” measures the wobble)",
                name, spread, problem->n - ret->n_used, problem->n, ret->rms,
                problem->target->kind == LAMP_POLES ? "mm" : "px", ret->sigma);
        else {
            g_autofree char *known = fit->undetermined < 0 && spread > 0
                                         ? g_strdup_printf(" (standard error %.3g mm)", spread)
                                         : g_strdup("");
            g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_DEGENERATE,
                        "lamp %s: the pictures do not determine the lamp's position%s; use posts "
                        "or balls farther apart, or more angles of arc and turntable",
                        name, known);
        }
        return FALSE;
    }
    return TRUE;
}

/* Refuses a lamp that is found at the nominal place of another lamp, because their names are then
 * exchanged. */
static gboolean check_places(const struct rig *rig, const struct lamps_result *ret,
                             GError **error) {
    for (int i = 0; i < rig->n_lamps; i++) {
        const struct vec3 at = ret->rig.lamps[i].position_mm;
        const double own_mm = vec3_length(vec3_sub(at, rig->lamps[i].position_mm));
        for (int k = 0; ret->seen[i] && k < rig->n_lamps; k++) {
            const double other_mm = vec3_length(vec3_sub(at, rig->lamps[k].position_mm));
            if (k == i || other_mm > own_mm / EXCHANGED)
                continue;
            g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_MISTAKE,
                        "lamp %s stands %.1f mm from its expected place, but only %.1f mm from the "
                        "place of lamp %s: the two lamps are exchanged; " LAMPS_EXCHANGE_THEM,
                        rig->lamps[i].name, own_mm, other_mm, rig->lamps[k].name,
                        rig->lamps[i].name, rig->lamps[k].name);
            return FALSE;
        }
    }
    return TRUE;
}

gboolean lamps_fit(const struct rig *rig, const struct lamp_target *target,
                   const struct lamp_sight *sights, int n, struct lamps_result *ret,
                   GError **error) {
    struct problem problem = {.rig = rig, .target = target, .sights = sights, .n = n};
    struct drive *const drives[] = {&problem.turntable, &problem.arc};
    struct fit_result fitted;
    g_autofree double *shift = problem.shift = g_new0(double, 4 * (gsize)n);
    g_autofree int *turn = g_new(int, n), *swing = g_new(int, n);
    g_autofree double *tilt = g_new(double, 2 * (gsize)n + 1);
    problem.tilt = (double(*)[2])tilt;
    for (int i = 0; i < n; i++)
        rig_wobble_tilt(&rig->wobble, sights[i].turntable_rad, problem.tilt[i]);
    problem.turn = turn;
    problem.swing = swing;
    memset(ret, 0, sizeof *ret);
    find_angles(&problem);
    gboolean ok = lay_out(&problem, error);
    if (ok) {
        g_autofree int *depends = new_depends(&problem);
        g_autofree double *x = g_new0(double, problem.n_parameters);
        g_autofree double *sigma = g_new0(double, problem.n_parameters);
        const struct fit fit = {.n_parameters = problem.n_parameters,
                                .n_observations = n,
                                .dimension = 2,
                                .residuals = residuals,
                                .data = &problem,
                                .reject = REJECT,
                                .depends = depends,
                                .n_depends = ON};
        start(&problem, x, sigma);
        ok = drive_fit(&fit, sigma, drives, G_N_ELEMENTS(drives), x, &fitted);
        if (ok) {
            take(&problem, x, &fitted, ret);
            ok = check_places(rig, ret, error) && check_result(&problem, &fitted, ret, error);
            fit_result_clear(&fitted);
        } else {
            g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_DEGENERATE,
                        "%d usable shadows or highlights are too few to determine %d unknown "
                        "values; take more pictures",
                        n, problem.n_parameters);
        }
    }
    if (!ok)
        lamps_result_clear(ret);
    drive_clear(&problem.turntable);
    drive_clear(&problem.arc);
    return ok;
}

/* Returns a text that names the marks whose sizes are not those of the target, or NULL. */
static char *other_sizes(const struct lamp_target *target, const struct lamps_result *found) {
    g_autoptr(GString) text = g_string_new(NULL);
    const char *what = target->kind == LAMP_POLES ? "post" : "ball";
    int n = 0, all = 0;
    double least = G_MAXDOUBLE, most = 0, sum = 0;
    for (int i = 0; i < target->n; i++) {
        const double said_mm = target->marks[i].size_mm, ratio = found->size_mm[i] / said_mm;
        const double error_mm = found->size_error_mm[i];
        if (!(error_mm > 0))
            continue;
        all++;
        if (fabs(found->size_mm[i] - said_mm) < CERTAIN * MAX(error_mm, target->tolerance_mm))
            continue;
        least = MIN(least, ratio);
        most = MAX(most, ratio);
        sum += ratio;
        g_string_append_printf(text, "%s%s %d %.2f ± %.2f mm, not %g mm", n++ > 0 ? ", " : "", what,
                               i + 1, found->size_mm[i], error_mm, said_mm);
    }
    if (n == 0)
        return NULL;
    if (n == all && n > 2 && most < ALIKE * least)
        return g_strdup_printf("all %ss %.4g times what the target's description says", what,
                               sum / n);
    return g_string_free(g_steal_pointer(&text), FALSE);
}

gboolean lamps_check_sizes(const struct rig *rig, const struct lamp_target *target,
                           const struct lamp_sight *sights, int n,
                           const struct lamps_result *as_said, GError **error) {
    struct lamp_target loose = *target;
    struct lamps_result found;
    double largest_mm = 0;
    if (!is_misfit(as_said, n))
        return TRUE;
    for (int i = 0; i < target->n; i++)
        largest_mm = MAX(largest_mm, target->marks[i].size_mm);
    loose.tolerance_mm = MAX(LOOSE * largest_mm, 3 * target->tolerance_mm);
    if (!lamps_fit(rig, &loose, sights, n, &found, NULL))
        return TRUE;
    g_autofree char *sizes = other_sizes(target, &found);
    const gboolean better = found.sigma < EXPLAINED && !is_misfit(&found, n) &&
                            (BETTER * found.sigma < as_said->sigma ||
                             BETTER * (n - found.n_used) < n - as_said->n_used);
    const char *unit = target->kind == LAMP_POLES ? "mm" : "px";
    if (sizes && better)
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_MISTAKE,
                    "the %s differ from the target's description: with %s, %d of %d measured "
                    "shadows or highlights fit (RMS %.2g %s); as described, %d fit (RMS %.2g %s); "
                    "measure the sizes again, and correct places_mm",
                    target->kind == LAMP_POLES ? "heights of the posts" : "radii of the balls",
                    sizes, found.n_used, n, found.rms, unit, as_said->n_used, as_said->rms, unit);
    lamps_result_clear(&found);
    return !(sizes && better);
}

void lamps_result_clear(struct lamps_result *result) {
    g_clear_pointer(&result->rejected, g_free);
}
