/* Least squares (geometry/fit.h) over all points. The residual of a point is (n·p − d) / σ. p is
 * the point of the plate that the pixel sees. n·x = d is the plane that touches the sheet at p, at
 * the commanded sweep angle. The parameters are
 *   tilt and centre of the arc's axis  4, with a prior
 *   of each laser                      7, see below
 *   offset of each camera              2, with the prior σ = LASER_CAMERA_PX
 *   error of each angle of the arc     1, with σ estimated by drive.h
 * If lines fit badly, the height of each plane in turn is one more parameter. This shows whether
 * the plane has another height than the given one. */
#include "laser.h"

#include "base/residual.h"
#include "base/robust.h"
#include "geometry/drive.h"

#include <math.h>
#include <string.h>

G_DEFINE_QUARK(laser_error, laser_error)

#define POINT_MM    0.02 /* standard deviation of a point across the sheet */
#define REJECT      5.0
#define MIN_POINTS  60  /* smallest number of points of a laser on each of two heights */
#define MIN_HEIGHTS 2.0 /* mm, smallest difference of the heights */
/* Smallest number of points of one step of a sweep on each of the two heights. Steps with fewer
 * points are not reported. */
#define STEP_POINTS 12

/* A laser counts as exchanged with another laser if the distance from its own place is more than
 * this factor times the distance from the other laser's place. */
#define EXCHANGED 5.0

#define MISFIT_MM 0.03 /* RMS from which the heights of the planes are checked */
#define WORST     0.05 /* share of the points that is left out of the RMS */
/* limit of the distance that a point, even a rejected one, contributes */
#define MAX_OFF_MM    0.3
#define HEIGHT_BETTER 3.0  /* factor by which another height must lower the RMS */
#define HEIGHT_ERRORS 5.0  /* smallest difference of the heights, in standard errors */
#define HEIGHT_POINTS 2000 /* number of points of each laser that are used for this check */
/* another height fits as well if its RMS is within this factor of the best */
#define HEIGHT_AS_GOOD 1.5

/* distance from the origin of the points that give the gradients of a sheet */
#define SLOPE_MM 30.0
/* An error counts as coming from the prior if the prior causes more than this share of the
 * variance. */
#define PRIOR_SHARE 0.25
/* distance in px of pixels whose peaks are compared: one period of a colour filter */
#define APART    2
#define PIXELS   200000 /* largest number of pixels of a picture that are compared */
#define BENT     5.0    /* number of standard errors from which a sheet's bend is significant */
#define FLAT_RAD 1e-9   /* prior of the bend of a flat sheet, which keeps it at 0 */

#define ARC 4 /* number of parameters of the arc; they come first */

/* Columns of the parameters that a point depends on: arc, laser, camera, error of the arc's angle,
 * height of its plane. */
enum { ON_ARC, ON_LASER = ARC, ON_CAMERA = ON_LASER + 7, ON_SWING = ON_CAMERA + 2, ON_HEIGHT, ON };

/* Corrections of a laser, in this order:
 *   position across the sheet and along the beam                 mm
 *   direction of the axis towards the beam and across the sheet  rad
 *   zero of the sweep                                            rad
 *   stretch of the sweep angle                                   relative
 *   bend of the sheet                                            rad
 * The bend is adjusted only if it is more than BENT times its standard error. Otherwise it is 0. */
enum { ACROSS, BEAM, AXIS_BEAM, AXIS_ACROSS, ZERO, STRETCH, BEND, PER_LASER };

struct problem {
    const struct rig *rig;
    const struct laser_point *points;
    int n;
    int at[RIG_MAX_LASERS]; /* first parameter; −1 if the laser is not seen */
    int camera_at[RIG_MAX_CAMERAS];
    struct drive swing;
    /* for each point, the index of the arc's angle; −1 for a laser that is not on the arc */
    int *swing_of;
    gboolean flat[RIG_MAX_LASERS]; /* TRUE: the bend is not adjusted */
    /* given height of the plane whose height is adjusted; NAN if no height is adjusted */
    double plane_mm;
    /* index of the parameter that says how much higher that plane is */
    int height_at;
    int n_parameters;
};

/* Applies the corrections: p' = p + a·n + b·beam, axis' = unit(axis + c·beam + d·n). The normal is
 * made perpendicular to axis' and then rotated about axis' by the zero. */
static struct rig_laser laser_of(const struct problem *problem, const double *x, int i) {
    const struct rig_laser *from = &problem->rig->lasers[i];
    const double *p = x + problem->at[i];
    struct rig_laser laser = *from;
    struct vec3 beam = vec3_cross(from->normal, from->axis);
    laser.position_mm = vec3_add(from->position_mm, vec3_add(vec3_scale(from->normal, p[ACROSS]),
                                                             vec3_scale(beam, p[BEAM])));
    laser.axis =
        vec3_unit(vec3_add(from->axis, vec3_add(vec3_scale(beam, p[AXIS_BEAM]),
                                                vec3_scale(from->normal, p[AXIS_ACROSS]))));
    double along = vec3_dot(from->normal, laser.axis);
    struct vec3 normal = vec3_unit(vec3_sub(from->normal, vec3_scale(laser.axis, along)));
    laser.normal = vec3_unit(vec3_add(vec3_scale(normal, cos(p[ZERO])),
                                      vec3_scale(vec3_cross(laser.axis, normal), sin(p[ZERO]))));
    laser.stretch = from->stretch + p[STRETCH];
    laser.bend_rad = problem->flat[i] ? 0 : p[BEND];
    return laser;
}

/* Applies the first four parameters: tilt and centre. */
static struct rig_arc arc_of(const struct problem *problem, const double *x) {
    struct rig_arc arc = problem->rig->arc;
    arc.tilt_rad[0] += x[0];
    arc.tilt_rad[1] += x[1];
    arc.centre_mm[0] += x[2];
    arc.centre_mm[1] += x[3];
    return arc;
}

/* Returns the index in `stands` and `poses` of residuals(), for a laser at one angle of the arc.
 * swing is −1 for a laser that is not on the arc. */
static int stand_of(const struct problem *problem, int laser, int swing) {
    return laser * (problem->swing.n + 1) + 1 + swing;
}

static void residuals(const double *x, double *ret, gconstpointer data) {
    const struct problem *problem = data;
    const int n_lasers = problem->rig->n_lasers, n_swings = problem->swing.n;
    const struct rig_arc arc = arc_of(problem, x);
    g_autofree struct rig_laser *stands = g_new(struct rig_laser, n_lasers * (n_swings + 1));
    g_autofree struct rig_laser_pose *poses =
        g_new(struct rig_laser_pose, n_lasers * (n_swings + 1));
    struct vec3 eyes[RIG_MAX_CAMERAS];
    for (int i = 0; i < problem->rig->n_cameras; i++)
        eyes[i] = rig_camera_centre_mm(&problem->rig->cameras[i]);
    for (int i = 0; i < n_lasers; i++) {
        if (problem->at[i] < 0)
            continue;
        const struct rig_laser laser = laser_of(problem, x, i);
        stands[stand_of(problem, i, -1)] = laser;
        for (int k = 0; k < n_swings; k++)
            stands[stand_of(problem, i, k)] = rig_laser_placed(
                &arc, &laser, problem->swing.angles_rad[k] + x[problem->swing.at + k]);
        for (int k = -1; k < n_swings; k++) {
            const int at = stand_of(problem, i, k);
            poses[at] = rig_laser_pose(&arc, &stands[at], 0);
        }
    }
    for (int i = 0; i < problem->n; i++) {
        const struct laser_point *point = &problem->points[i];
        const double *d = x + problem->camera_at[point->camera]; /* the camera's offset in px */
        const float *a = point->shift;
        const struct rig_laser_pose *pose =
            &poses[stand_of(problem, point->laser, problem->swing_of[i])];
        struct vec3 p = point->point_mm;
        /* Moves the point along the line of sight to the unknown plane. */
        if (p.z == problem->plane_mm) {
            const struct vec3 way = vec3_sub(p, eyes[point->camera]);
            p = vec3_add(p, vec3_scale(way, x[problem->height_at] / way.z));
        }
        p.x -= (double)a[0] * d[0] + (double)a[1] * d[1];
        p.y -= (double)a[2] * d[0] + (double)a[3] * d[1];
        const struct rig_plane sheet =
            rig_laser_pose_sheet(pose, point->sweep_rad + rig_laser_pose_bent_rad(pose, p));
        ret[i] = (vec3_dot(sheet.normal, p) - sheet.offset_mm) / point->sigma_mm;
    }
}

struct levels { /* range of the heights of a laser's points */
    double low_mm, high_mm;
    int n, n_low, n_high;
    int sweep; /* number of one of the laser's sweeps */
};

/* Returns the range of heights of a laser's points, and the numbers of points below and above the
 * middle of this range. */
static struct levels levels_of(const struct problem *problem, int laser) {
    struct levels l = {G_MAXDOUBLE, -G_MAXDOUBLE, 0, 0, 0, -1};
    for (int i = 0; i < problem->n; i++) {
        const struct laser_point *p = &problem->points[i];
        if (p->laser != laser)
            continue;
        l.low_mm = MIN(l.low_mm, p->point_mm.z);
        l.high_mm = MAX(l.high_mm, p->point_mm.z);
        l.sweep = p->sweep;
        l.n++;
    }
    double middle = (l.low_mm + l.high_mm) / 2;
    for (int i = 0; i < problem->n; i++)
        if (problem->points[i].laser == laser) {
            l.n_low += problem->points[i].point_mm.z < middle;
            l.n_high += problem->points[i].point_mm.z >= middle;
        }
    return l;
}

static gboolean lay_out(struct problem *problem, const char *const *sweep_names, GError **error) {
    problem->n_parameters = ARC;
    gboolean any = FALSE;
    for (int i = 0; i < problem->rig->n_lasers; i++) {
        const char *name = problem->rig->lasers[i].name;
        struct levels l = levels_of(problem, i);
        problem->at[i] = l.n ? problem->n_parameters : -1;
        problem->n_parameters += l.n ? PER_LASER : 0;
        any |= l.n > 0;
        if (l.n == 0)
            continue;
        if (l.high_mm - l.low_mm < MIN_HEIGHTS)
            g_set_error(error, LASER_ERROR, LASER_ERROR_DEGENERATE,
                        "%s: the planes on which laser %s is seen have heights from %.3f to %.3f "
                        "mm, which differ too little to determine the angle of its sheet; sweep a "
                        "second plane, at least %g mm higher or lower; heights are in millimetres",
                        sweep_names[l.sweep], name, l.low_mm, l.high_mm, MIN_HEIGHTS);
        else if (MIN(l.n_low, l.n_high) < MIN_POINTS)
            g_set_error(error, LASER_ERROR, LASER_ERROR_PICTURES,
                        "%s: laser %s is seen in %d pixel(s) of the plane at a height of %.3f mm "
                        "and in %d of the plane at %.3f mm, and at least %d are needed on each "
                        "plane; expose longer, make the laser brighter, or put the plane in the "
                        "cameras' view",
                        sweep_names[l.sweep], name, l.n_low, l.low_mm, l.n_high, l.high_mm,
                        MIN_POINTS);
        else
            continue;
        return FALSE;
    }
    gboolean cameras[RIG_MAX_CAMERAS] = {FALSE};
    for (int i = 0; i < problem->n; i++)
        cameras[problem->points[i].camera] = TRUE;
    for (int i = 0; i < RIG_MAX_CAMERAS; i++) {
        problem->camera_at[i] = cameras[i] ? problem->n_parameters : -1;
        problem->n_parameters += cameras[i] ? 2 : 0;
    }
    problem->swing.at = problem->n_parameters;
    problem->n_parameters += problem->swing.n;
    problem->height_at = problem->n_parameters;
    problem->n_parameters += !isnan(problem->plane_mm);
    if (!any)
        g_set_error(error, LASER_ERROR, LASER_ERROR_PICTURES,
                    "no laser's line is seen in any sweep; check that the lasers are lit, the "
                    "exposure, and that the planes are in the cameras' view");
    return any;
}

static int *new_depends(const struct problem *problem) {
    int *depends = g_new(int, (gsize)problem->n *ON);
    for (int i = 0; i < problem->n; i++) {
        const struct laser_point *p = &problem->points[i];
        int *of = depends + (gsize)i * ON;
        for (int k = 0; k < ARC; k++)
            of[ON_ARC + k] = k;
        for (int k = 0; k < PER_LASER; k++)
            of[ON_LASER + k] = problem->at[p->laser] + k;
        for (int k = 0; k < 2; k++)
            of[ON_CAMERA + k] = problem->camera_at[p->camera] + k;
        of[ON_SWING] = problem->swing_of[i] >= 0 ? problem->swing.at + problem->swing_of[i] : -1;
        of[ON_HEIGHT] = p->point_mm.z == problem->plane_mm ? problem->height_at : -1;
    }
    return depends;
}

/* Residuals of one step's points, summed over each of the two heights. */
struct tally {
    double sum[2];
    int n[2];
};

/* Appends to ret->steps each step of a laser at one angle of the arc that has at least STEP_POINTS
 * used points on each of the two heights. With the mean residuals m₀ and m₁ on the two heights,
 * tilt = (m₁ − m₀) / distance of the lines, and offset = (m₀ + m₁) / 2. */
static void add_steps(const struct problem *problem, const struct fit_result *fit,
                      struct laser_result *ret, int laser, double arc_rad, const struct levels *l) {
    g_autoptr(GHashTable) steps =
        g_hash_table_new_full(g_int64_hash, g_int64_equal, g_free, g_free);
    double middle = (l->low_mm + l->high_mm) / 2;
    for (int i = 0; i < problem->n; i++) {
        const struct laser_point *p = &problem->points[i];
        if (p->laser != laser || p->arc_rad != arc_rad || fit->rejected[i])
            continue;
        /* A step is identified by its sweep angle in tenths of a degree. */
        gint64 key = llround(p->sweep_rad * 180 / G_PI * 10);
        struct tally *tally = g_hash_table_lookup(steps, &key);
        if (!tally) {
            tally = g_new0(struct tally, 1);
            g_hash_table_insert(steps, g_memdup2(&key, sizeof key), tally);
        }
        int high = p->point_mm.z >= middle;
        tally->sum[high] += fit->residuals[i] * p->sigma_mm;
        tally->n[high]++;
    }
    GHashTableIter iter;
    gpointer key, value;
    g_hash_table_iter_init(&iter, steps);
    while (g_hash_table_iter_next(&iter, &key, &value)) {
        const struct tally *t = value;
        if (MIN(t->n[0], t->n[1]) < STEP_POINTS)
            continue;
        double low = t->sum[0] / t->n[0], high = t->sum[1] / t->n[1];
        double sweep = (double)*(gint64 *)key / 10 * G_PI / 180;
        struct rig_plane sheet =
            rig_laser_sheet(&ret->rig.arc, &ret->rig.lasers[laser], arc_rad, sweep);
        /* Distance of the two lines within the sheet. */
        double apart = (l->high_mm - l->low_mm) / MAX(hypot(sheet.normal.x, sheet.normal.y), 1e-3);
        struct laser_step step = {
            laser, arc_rad, sweep, (high - low) / apart, (low + high) / 2, t->n[0] + t->n[1]};
        g_array_append_val(ret->steps, step);
    }
}

/* Returns the arc's angles at which a laser was swept. */
static GArray *laser_arcs(const struct problem *problem, int laser) {
    GArray *arcs = g_array_new(FALSE, FALSE, sizeof(double));
    for (int i = 0; i < problem->n; i++) {
        double arc = problem->points[i].arc_rad;
        gboolean known = problem->points[i].laser != laser;
        for (guint k = 0; k < arcs->len && !known; k++)
            known = g_array_index(arcs, double, k) == arc;
        if (!known)
            g_array_append_val(arcs, arc);
    }
    return arcs;
}

/* Returns the median line_rad of a laser's points, or 0 if none is known. */
static double laser_line_rad(const struct problem *problem, int laser) {
    g_autofree double *line_rad = g_new(double, problem->n + 1);
    int n = 0;
    for (int i = 0; i < problem->n; i++)
        if (problem->points[i].laser == laser && problem->points[i].line_rad > 0)
            line_rad[n++] = (double)problem->points[i].line_rad;
    return n > 0 ? robust_median(line_rad, n) : 0;
}

/* The state of a laser and its arc, before or after a parameter has changed. */
struct change {
    struct rig_arc arc;
    struct rig_laser laser;
    double arc_rad;
};

/* Returns the displacement of the sheet along its normal at a point p when its parameters change.
 * Let s be the sweep angle at which the sheet contains p, and n'·x = d' the changed sheet at s. The
 * displacement is d' − n'·p. */
static double displacement_mm(const struct change *is, const struct change *changed,
                              struct vec3 point_mm) {
    const double sweep_rad =
        rig_laser_sweep_rad(&is->arc, &is->laser, is->arc_rad, point_mm) +
        rig_laser_bent_rad(&changed->arc, &changed->laser, changed->arc_rad, point_mm);
    const struct rig_plane sheet =
        rig_laser_sheet(&changed->arc, &changed->laser, changed->arc_rad, sweep_rad);
    return sheet.offset_mm - vec3_dot(sheet.normal, point_mm);
}

/* Computes the derivatives of the parameters of rig_laser_sheet_lever() with respect to one
 * parameter, from points around the origin. */
static void sheet_slopes(const struct change *is, const struct change *changed, double step,
                         double ret[RIG_SHEET_PARAMETERS]) {
    const struct rig_laser *laser = &is->laser;
    const struct vec3 axis = rig_laser_axis(&is->arc, laser, is->arc_rad);
    const struct vec3 normal =
        laser->fixed ? laser->normal : rig_arc_direction(&is->arc, is->arc_rad, laser->normal);
    const struct vec3 ways[] = {axis, normal, vec3_cross(normal, axis)};
    ret[RIG_SHEET_OFFSET] = displacement_mm(is, changed, vec3(0, 0, 0)) / step;
    for (int k = 0; k < 3; k++) {
        const double ahead = displacement_mm(is, changed, vec3_scale(ways[k], SLOPE_MM));
        const double behind = displacement_mm(is, changed, vec3_scale(ways[k], -SLOPE_MM));
        ret[RIG_SHEET_ALONG + k] = (ahead - behind) / (2 * SLOPE_MM * step);
    }
    ret[RIG_SHEET_BEND] = (changed->laser.bend_rad - is->laser.bend_rad) / step;
}

/* Adds the covariance D C Dᵀ of one laser's sheets with the arc at an angle. D has the derivatives
 * with respect to the parameters of arc and laser, and to the error of the arc's angle, whose
 * standard deviation is swing_rad. The covariance is multiplied by share. */
static void add_sheet_errors(const struct problem *problem, const struct fit_result *fitted,
                             const double *x, int laser, double arc_rad, double share,
                             struct rig_sheet_errors *ret) {
    enum { N = ARC + PER_LASER, S = RIG_SHEET_PARAMETERS };
    g_autofree double *at = g_memdup2(x, sizeof(double) * (gsize)problem->n_parameters);
    const struct change is = {arc_of(problem, x), laser_of(problem, x, laser), arc_rad};
    double slopes[N][S], swing[S];
    int of[N];
    for (int k = 0; k < N; k++) {
        of[k] = k < ARC ? k : problem->at[laser] + k - ARC;
        const double step =
            (k == ARC + ACROSS || k == ARC + BEAM || k == 2 || k == 3) ? 1e-3 : 1e-6;
        if (k == ARC + BEND && problem->flat[laser]) {
            memset(slopes[k], 0, sizeof slopes[k]);
            continue;
        }
        at[of[k]] += step;
        const struct change changed = {arc_of(problem, at), laser_of(problem, at, laser), arc_rad};
        sheet_slopes(&is, &changed, step, slopes[k]);
        at[of[k]] = x[of[k]];
    }
    const struct change turned = {is.arc, is.laser, arc_rad + 1e-6};
    sheet_slopes(&is, &turned, 1e-6, swing);
    const double swing_rad = is.laser.fixed ? 0 : problem->swing.sigma_rad;
    for (int a = 0; a < S; a++)
        for (int b = 0; b < S; b++) {
            double sum = swing[a] * swing[b] * swing_rad * swing_rad;
            for (int i = 0; i < N; i++)
                for (int k = 0; k < N; k++)
                    sum += slopes[i][a] *
                           fitted->covariance[of[i] * problem->n_parameters + of[k]] * slopes[k][b];
            ret->covariance[a][b] += share * sum;
        }
}

/* Computes the covariance of the sheets of a laser near the sample, as the mean over the angles of
 * the arc. It includes the error of the bend, even if the bend is not significant. The part of the
 * residuals that noise does not explain is added as an offset of the whole sheet. */
static void take_sheet(const struct problem *problem, const struct fit_result *fitted,
                       const double *x, const double *bend_error_rad, int laser,
                       struct laser_result *ret) {
    g_autoptr(GArray) arcs = laser_arcs(problem, laser);
    struct rig_sheet_errors *errors = &ret->sheet[laser];
    const struct residual residual = {.value = ret->rms_mm[laser],
                                      .expected = ret->expected_mm[laser]};
    double sum = 0;
    for (guint k = 0; k < arcs->len; k++)
        add_sheet_errors(problem, fitted, x, laser, g_array_index(arcs, double, k), 1.0 / arcs->len,
                         errors);
    if (problem->flat[laser] && isfinite(bend_error_rad[laser]))
        errors->covariance[RIG_SHEET_BEND][RIG_SHEET_BEND] = pow(bend_error_rad[laser], 2);
    errors->covariance[RIG_SHEET_OFFSET][RIG_SHEET_OFFSET] += pow(residual_excess(&residual), 2);
    for (int i = 0; i < problem->n; i++) {
        const struct laser_point *p = &problem->points[i];
        if (p->laser == laser && !fitted->rejected[i])
            sum += pow(rig_laser_sheet_error_mm(&ret->rig.arc, &ret->rig.lasers[laser], p->arc_rad,
                                                errors, p->point_mm),
                       2);
    }
    ret->sheet_error_mm[laser] = sqrt(sum / MAX(ret->points[laser], 1));
}

/* Determines which errors come from the priors. This is so if more than the share PRIOR_SHARE of
 * the variance comes from one parameter of the arc that the lines hardly determine. The standard
 * error of such a parameter is more than half of its prior. A laser that is not on the arc has no
 * such errors. */
static void take_priors(const struct problem *problem, const struct fit_result *fitted,
                        const struct laser_arc *arc, int laser, struct laser_result *ret) {
    const int n = problem->n_parameters, at = problem->at[laser];
    static const int values[][2] = {
        {ACROSS, BEAM}, {AXIS_BEAM, AXIS_ACROSS}, {ZERO, ZERO}, {STRETCH, STRETCH}};
    for (gsize v = 0; v < G_N_ELEMENTS(values); v++)
        for (int i = 0; i < 2 && !problem->rig->lasers[laser].fixed; i++) {
            const double *row = fitted->covariance + (gsize)(at + values[v][i]) * (gsize)n;
            const double own = row[at + values[v][i]];
            double shared = 0;
            for (int k = 0; k < ARC; k++) {
                const double variance = fitted->covariance[k * (n + 1)];
                const double prior = k < 2 ? arc->tilt_rad : arc->centre_mm;
                if (variance > PRIOR_SHARE * prior * prior)
                    shared = MAX(shared, row[k] * row[k] / variance);
            }
            ret->from_prior[laser][v] |= own > 0 && shared > PRIOR_SHARE * own;
        }
}

static void take(const struct problem *problem, struct fit_result *fitted, const double *x,
                 const struct laser_arc *arc, const double *bend_error_rad,
                 struct laser_result *ret) {
    const struct fit *const fit = &(struct fit){.n_parameters = problem->n_parameters};
    double sum[RIG_MAX_LASERS] = {0}, all = 0, noise[RIG_MAX_LASERS] = {0};
    gboolean quiet[RIG_MAX_LASERS] = {FALSE}; /* the noise of some point is not known */
    ret->rig = *problem->rig;
    ret->rig.arc = arc_of(problem, x);
    for (int k = 0; k < 2; k++) {
        ret->tilt_error_rad[k] = fit_error(fit, fitted, k);
        ret->centre_error_mm[k] = fit_error(fit, fitted, 2 + k);
    }
    for (int i = 0; i < problem->rig->n_lasers; i++)
        if (problem->at[i] >= 0) {
            int at = problem->at[i];
            ret->seen[i] = TRUE;
            ret->rig.lasers[i] = laser_of(problem, x, i);
            ret->source_error_mm[i] =
                hypot(fit_error(fit, fitted, at + ACROSS), fit_error(fit, fitted, at + BEAM));
            ret->axis_error_rad[i] = hypot(fit_error(fit, fitted, at + AXIS_BEAM),
                                           fit_error(fit, fitted, at + AXIS_ACROSS));
            ret->zero_error_rad[i] = fit_error(fit, fitted, at + ZERO);
            ret->stretch_error[i] = fit_error(fit, fitted, at + STRETCH);
            ret->bend_error_rad[i] = bend_error_rad[i];
        }
    for (int i = 0; i < problem->n; i++) {
        const struct laser_point *p = &problem->points[i];
        double d = fitted->residuals[i] * p->sigma_mm;
        if (fitted->rejected[i])
            continue;
        ret->points[p->laser]++;
        sum[p->laser] += d * d;
        noise[p->laser] += pow((double)p->noise_mm, 2);
        quiet[p->laser] |= !(p->noise_mm > 0);
        all += d * d;
    }
    for (int i = 0; i < RIG_MAX_LASERS; i++) {
        ret->rms_mm[i] = ret->points[i] ? sqrt(sum[i] / ret->points[i]) : 0;
        ret->expected_mm[i] = ret->points[i] && !quiet[i] ? sqrt(noise[i] / ret->points[i]) : 0;
    }
    for (int i = 0; i < problem->rig->n_lasers; i++)
        if (problem->at[i] >= 0) {
            ret->line_rad[i] = laser_line_rad(problem, i);
            take_sheet(problem, fitted, x, bend_error_rad, i, ret);
            take_priors(problem, fitted, arc, i, ret);
        }
    ret->rms_all_mm = sqrt(all / MAX(fitted->n_used, 1));
    ret->sigma = fitted->sigma;
    ret->n_used = fitted->n_used;
    ret->degrees_of_freedom = fitted->degrees_of_freedom;
    ret->steps = g_array_new(FALSE, FALSE, sizeof(struct laser_step));
    for (int laser = 0; laser < problem->rig->n_lasers; laser++) {
        if (problem->at[laser] < 0)
            continue;
        struct levels l = levels_of(problem, laser);
        g_autoptr(GArray) arcs = laser_arcs(problem, laser);
        for (guint k = 0; k < arcs->len; k++)
            add_steps(problem, fitted, ret, laser, g_array_index(arcs, double, k), &l);
    }
    ret->rejected = g_steal_pointer(&fitted->rejected);
}

static gboolean check_determined(const struct problem *problem, const struct fit_result *fitted,
                                 GError **error) {
    if (fitted->undetermined < 0)
        return TRUE;
    g_autofree char *what = g_strdup("the arc's position");
    const int at = fitted->undetermined;
    for (int i = 0; i < problem->rig->n_lasers; i++)
        if (problem->at[i] >= 0 && at >= problem->at[i]) {
            g_free(what);
            what = g_strdup_printf("the position of laser %s", problem->rig->lasers[i].name);
        }
    for (int i = 0; i < problem->rig->n_cameras; i++)
        if (problem->camera_at[i] >= 0 && at >= problem->camera_at[i]) {
            g_free(what);
            what = g_strdup_printf("the offset of camera %s", problem->rig->cameras[i].name);
        }
    if (at >= problem->swing.at) {
        g_free(what);
        what = g_strdup(at >= problem->height_at ? "the height of the plane"
                                                 : "the angles of the arc");
    }
    g_set_error(error, LASER_ERROR, LASER_ERROR_DEGENERATE,
                "the sweeps do not determine %s; sweep a larger part of both planes", what);
    return FALSE;
}

/* Refuses a sweep whose direction is reversed, or whose range differs much from the commanded one.
 * The cause is an error in the rig file, or in the table of imported pictures. Calibration must not
 * hide this error. Also, a file with such a stretch could not be read back. */
static gboolean check_stretch(const struct problem *problem, const double *x, GError **error) {
    for (int i = 0; i < problem->rig->n_lasers; i++) {
        const struct rig_laser *laser = &problem->rig->lasers[i];
        if (problem->at[i] < 0)
            continue;
        const double turn = 1 + laser->stretch + x[problem->at[i] + STRETCH];
        if (fabs(turn - 1) <= RIG_MAX_STRETCH)
            continue;
        if (turn < 0)
            g_set_error(
                error, LASER_ERROR, LASER_ERROR_SWEEP,
                "laser %s: the direction of its sweep is reversed (a step of 1° turns the sheet by "
                "%.3f°); change the sign of steps_per_deg or units_per_deg of its sweep axis in "
                "the rig file, or the motor's direction in its controller, or for imported "
                "pictures the sign of sweep_deg in the table, and capture or import again",
                laser->name, turn);
        else
            g_set_error(error, LASER_ERROR, LASER_ERROR_SWEEP,
                        "laser %s: a step of 1° of its sweep turns the sheet by %.3f°, and at most "
                        "%g° too much or too little can be calibrated; correct steps_per_deg or "
                        "units_per_deg of its sweep axis in the rig file, or for imported pictures "
                        "sweep_deg in the table, and capture or import again",
                        laser->name, turn, RIG_MAX_STRETCH);
        return FALSE;
    }
    return TRUE;
}

/* Refuses a laser that is found at the nominal place of another laser, because their names are then
 * exchanged. */
static gboolean check_places(const struct problem *problem, const double *x, GError **error) {
    const struct rig *rig = problem->rig;
    for (int i = 0; i < rig->n_lasers; i++) {
        if (problem->at[i] < 0)
            continue;
        const struct vec3 at = laser_of(problem, x, i).position_mm;
        const double own_mm = vec3_length(vec3_sub(at, rig->lasers[i].position_mm));
        for (int k = 0; k < rig->n_lasers; k++) {
            const double other_mm = vec3_length(vec3_sub(at, rig->lasers[k].position_mm));
            if (k == i || other_mm > own_mm / EXCHANGED)
                continue;
            g_set_error(
                error, LASER_ERROR, LASER_ERROR_MISTAKE,
                "laser %s stands %.1f mm from its expected place, but only %.1f mm from the "
                "place of laser %s: the two lasers are exchanged; exchange theta_deg and "
                "distance_mm of [laser %s] and [laser %s] in the rig file, or their wiring, or for "
                "imported pictures their names in the table, and capture or import again",
                rig->lasers[i].name, own_mm, other_mm, rig->lasers[k].name, rig->lasers[i].name,
                rig->lasers[k].name);
            return FALSE;
        }
    }
    return TRUE;
}

/* Adjusts the parameters x in place. *ret_mm is the RMS distance of the points from their sheets.
 * For this figure, the share WORST of the points with the largest distances is left out, and each
 * distance counts as at most MAX_OFF_MM. *ret_height_error_mm is the standard error of the plane's
 * height, or 0 if no height is adjusted. Returns FALSE if the fit fails. */
static gboolean solve(struct problem *problem, const struct laser_arc *arc, double *x,
                      struct fit_result *ret, double *ret_mm, double *ret_height_error_mm) {
    struct drive *const drive = &problem->swing;
    g_autofree int *depends = new_depends(problem);
    g_autofree double *sigma = g_new0(double, problem->n_parameters);
    const struct fit fit = {.n_parameters = problem->n_parameters,
                            .n_observations = problem->n,
                            .dimension = 1,
                            .residuals = residuals,
                            .data = problem,
                            .reject = REJECT,
                            .depends = depends,
                            .n_depends = ON};
    double sum = 0;
    for (int k = 0; k < ARC; k++)
        sigma[k] = k < 2 ? arc->tilt_rad : arc->centre_mm;
    for (int c = 0; c < problem->rig->n_cameras; c++)
        for (int k = 0; problem->camera_at[c] >= 0 && k < 2; k++)
            sigma[problem->camera_at[c] + k] = LASER_CAMERA_PX;
    for (int i = 0; i < problem->rig->n_lasers; i++)
        if (problem->at[i] >= 0 && problem->flat[i])
            sigma[problem->at[i] + BEND] = FLAT_RAD;
    if (!drive_fit(&fit, sigma, &drive, 1, x, ret))
        return FALSE;
    g_autofree double *off_mm = g_new(double, problem->n);
    const int n = (int)((1 - WORST) * problem->n);
    for (int i = 0; i < problem->n; i++)
        off_mm[i] = fabs(ret->residuals[i]) * problem->points[i].sigma_mm;
    qsort(off_mm, (gsize)problem->n, sizeof *off_mm, fit_compare);
    for (int i = 0; i < n; i++)
        sum += pow(MIN(off_mm[i], MAX_OFF_MM), 2);
    *ret_mm = sqrt(sum / MAX(n, 1));
    *ret_height_error_mm = isnan(problem->plane_mm) ? 0 : fit_error(&fit, ret, problem->height_at);
    return TRUE;
}

/* Adjusts all parameters with solve(). Then adjusts once more without the bends that are not
 * significant or not determined. ret_bend_error_rad gets the standard error of each bend from the
 * first adjustment. Returns FALSE if an adjustment fails. */
static gboolean solve_bends(struct problem *problem, const struct laser_arc *arc, double *x,
                            struct fit_result *ret, double *ret_mm, double *ret_bend_error_rad) {
    const struct fit fit = {.n_parameters = problem->n_parameters};
    double unused;
    gboolean again = FALSE;
    if (!solve(problem, arc, x, ret, ret_mm, &unused))
        return FALSE;
    for (int i = 0; i < problem->rig->n_lasers; i++) {
        const int bend = problem->at[i] + BEND;
        if (problem->at[i] < 0)
            continue;
        ret_bend_error_rad[i] = fit_error(&fit, ret, bend);
        if (fabs(x[bend]) > BENT * ret_bend_error_rad[i])
            continue;
        problem->flat[i] = again = TRUE;
        x[bend] = 0;
    }
    if (!again)
        return TRUE;
    fit_result_clear(ret);
    return solve(problem, arc, x, ret, ret_mm, &unused);
}

/* Adjusts with the height of the plane at plane_mm as a further parameter, and returns the RMS.
 * *ret_by_mm is how much higher the plane is found. Returns INFINITY if the fit fails, if the
 * height does not change significantly, or if the plane would coincide with another plane. */
static double with_height(struct problem *problem, const struct laser_arc *arc,
                          const char *const *sweep_names, double plane_mm, double *ret_by_mm,
                          double *ret_error_mm) {
    struct fit_result fitted;
    double rms_mm;
    problem->plane_mm = plane_mm;
    if (!lay_out(problem, sweep_names, NULL))
        return INFINITY;
    g_autofree double *x = g_new0(double, problem->n_parameters);
    if (!solve(problem, arc, x, &fitted, &rms_mm, ret_error_mm))
        return INFINITY;
    *ret_by_mm = x[problem->height_at];
    gboolean tells = fabs(*ret_by_mm) > HEIGHT_ERRORS * *ret_error_mm;
    /* every height fits if two planes coincide, so such a height tells nothing */
    for (int i = 0; i < problem->n && tells; i++)
        tells = problem->points[i].point_mm.z == plane_mm ||
                fabs(plane_mm + *ret_by_mm - problem->points[i].point_mm.z) >= MIN_HEIGHTS;
    fit_result_clear(&fitted);
    return tells ? rms_mm : INFINITY;
}

/* Checks whether another height of one plane explains the lines much better. If so, returns FALSE
 * with LASER_ERROR_MISTAKE. is_mm is the RMS of the lines with the given heights.
 *
 * Several cameras see the same line where a sheet cuts a plane, and so determine the height of each
 * plane. A single camera that sees a sheet from several sides determines only the ratio of the
 * planes' distances from the camera. Either of two heights may then be wrong, and the error names
 * both. In all other cases the standard error of a height is large, and nothing is reported. */
static gboolean check_heights(const struct problem *problem, const struct laser_arc *arc,
                              const char *const *sweep_names, double is_mm, GError **error) {
    struct height {
        const struct laser_point *of; /* a point of the plane */
        double rms_mm, by_mm, error_mm;
    } best = {NULL, is_mm / HEIGHT_BETTER, 0, 0}, second = {NULL, INFINITY, 0, 0};
    const int step = 1 + problem->n / (HEIGHT_POINTS * problem->rig->n_lasers);
    if (is_mm < MISFIT_MM)
        return TRUE;
    g_autofree struct laser_point *some = g_new(struct laser_point, problem->n);
    g_autofree int *swing_of = g_new(int, problem->n);
    g_autoptr(GArray) tried = g_array_new(FALSE, FALSE, sizeof(double));
    struct problem other = *problem;
    other.points = some;
    other.swing_of = swing_of;
    other.n = 0;
    for (int i = 0; i < problem->n; i += step) {
        some[other.n] = problem->points[i];
        swing_of[other.n++] = problem->swing_of[i];
    }
    for (int i = 0; i < other.n; i++) {
        const double plane_mm = some[i].point_mm.z;
        struct height height = {&some[i], 0, 0, 0};
        gboolean known = FALSE;
        for (guint k = 0; k < tried->len && !known; k++)
            known = g_array_index(tried, double, k) == plane_mm;
        if (known)
            continue;
        g_array_append_val(tried, plane_mm);
        height.rms_mm =
            with_height(&other, arc, sweep_names, plane_mm, &height.by_mm, &height.error_mm);
        if (height.rms_mm < best.rms_mm) {
            second = best;
            best = height;
        } else if (height.rms_mm < second.rms_mm) {
            second = height;
        }
    }
    if (!best.of)
        return TRUE;
    const double plane_mm = best.of->point_mm.z;
    g_autofree char * or
        = second.of && second.rms_mm < HEIGHT_AS_GOOD * best.rms_mm
              ? g_strdup_printf(
                    ", or else the height of the plate of %s is not %g mm, but %.3f ± %.3f mm",
                    sweep_names[second.of->sweep], second.of->point_mm.z,
                    second.of->point_mm.z + second.by_mm, second.error_mm)
              : g_strdup("");
    g_set_error(error, LASER_ERROR, LASER_ERROR_MISTAKE,
                "%s: the height of the plate is given as %g mm, but the lines show %.3f ± %.3f "
                "mm%s (the RMS distance of the lines from the sheets is %.3g mm as given, and %.3g "
                "mm with the corrected height); measure the plate, and correct its height in "
                "--planes, or reference_mm in [sample] of the session file",
                sweep_names[best.of->sweep], plane_mm, plane_mm + best.by_mm, best.error_mm, or,
                is_mm, best.rms_mm);
    return FALSE;
}

gboolean laser_fit(const struct rig *rig, const struct laser_point *points, int n,
                   const struct laser_arc *arc, const char *const *sweep_names,
                   struct laser_result *ret, GError **error) {
    struct problem problem = {.rig = rig, .points = points, .n = n, .plane_mm = NAN};
    struct drive *const drive = &problem.swing;
    g_autofree int *swing_of = problem.swing_of = g_new(int, n + 1);
    memset(ret, 0, sizeof *ret);
    drive_init(drive, n);
    for (int i = 0; i < n; i++)
        swing_of[i] =
            rig->lasers[points[i].laser].fixed ? -1 : drive_angle(drive, points[i].arc_rad);
    gboolean ok = lay_out(&problem, sweep_names, error) &&
                  laser_check_mistakes(rig, points, n, sweep_names, error);
    if (ok) {
        struct fit_result fitted;
        double rms_mm;
        g_autofree double *x = g_new0(double, problem.n_parameters);
        double bend_error_rad[RIG_MAX_LASERS] = {0};
        ok = solve_bends(&problem, arc, x, &fitted, &rms_mm, bend_error_rad);
        if (ok) {
            ok = check_determined(&problem, &fitted, error) && check_stretch(&problem, x, error) &&
                 check_places(&problem, x, error) &&
                 check_heights(&problem, arc, sweep_names, rms_mm, error);
            if (ok)
                take(&problem, &fitted, x, arc, bend_error_rad, ret);
            fit_result_clear(&fitted);
        } else {
            g_set_error(error, LASER_ERROR, LASER_ERROR_PICTURES,
                        "%d points of the lines are too few to determine %d unknown values; sweep "
                        "a larger part of the planes",
                        n, problem.n_parameters);
        }
    }
    drive_clear(drive);
    return ok;
}

void laser_result_clear(struct laser_result *result) {
    g_clear_pointer(&result->rejected, g_free);
    g_clear_pointer(&result->steps, g_array_unref);
}

/* Computes the point of the plane that a pixel sees: p = eye + t·ray with t = (z_plane − eye_z) /
 * ray_z. Returns FALSE if the ray does not go down, or if the point is outside the used part of the
 * plane. */
static gboolean plane_point(const struct rig_camera *camera, const struct laser_plate_sweep *sweep,
                            int x, int y, struct vec3 *ret) {
    struct vec3 eye = rig_camera_centre_mm(camera), ray = rig_pixel_ray(camera, x, y);
    if (!(ray.z < -1e-6))
        return FALSE;
    *ret = vec3_add(eye, vec3_scale(ray, (sweep->plane_mm - eye.z) / ray.z));
    ret->z = sweep->plane_mm;
    return hypot(ret->x, ret->y) <= sweep->radius_mm;
}

/* Returns the standard deviation of a peak's time that is caused by noise, in frames: the spread of
 * t(−h) − 2 t(0) + t(h), divided by √6, for pixels h apart in rows and columns. On a flat plate,
 * times change evenly from pixel to pixel, so that only noise is left. Returns NAN if there are too
 * few pixels. */
static double laser_noise_frames(const struct laser_plate_sweep *sweep, int width, int height) {
    g_autoptr(GArray) off = g_array_new(FALSE, FALSE, sizeof(double));
    const int step = 1 + width * height / PIXELS;
    for (int i = 0; i < width * height; i += step)
        for (int axis = 0; axis < 2; axis++) {
            const int x = i % width, y = i / width, by = axis ? APART * width : APART;
            if (x < APART || y < APART || x + APART >= width || y + APART >= height ||
                !(sweep->peak[i] >= 0) || !(sweep->peak[i - by] >= 0) ||
                !(sweep->peak[i + by] >= 0))
                continue;
            const double bend = (double)sweep->peak[i - by] - 2 * (double)sweep->peak[i] +
                                (double)sweep->peak[i + by];
            g_array_append_val(off, bend);
        }
    if (off->len < MIN_POINTS)
        return NAN;
    return robust_spread((const double *)(gpointer)off->data, (int)off->len, 0) / sqrt(6);
}

int laser_points(const struct rig *rig, const struct laser_plate_sweep *sweep, GArray *points) {
    const struct rig_camera *camera = &rig->cameras[sweep->camera];
    gsize n = (gsize)camera->width * (gsize)camera->height, seen = 0, taken = 0;
    for (gsize i = 0; i < n; i++)
        seen += sweep->peak[i] >= 0;
    if (seen == 0)
        return 0;
    const double noise_frames = laser_noise_frames(sweep, camera->width, camera->height);
    const struct rig_laser *laser = &rig->lasers[sweep->laser];
    const struct vec3 source = rig_laser_position_mm(&rig->arc, laser, sweep->arc_rad);
    const struct vec3 axis = rig_laser_axis(&rig->arc, laser, sweep->arc_rad);
    /* Takes an even fraction of the pixels with a peak, counted row by row. This order is oblique
     * to the lines. */
    double every = MAX(1, (double)seen / (double)MAX(sweep->most, 1)), next = 0;
    gsize number = 0;
    for (gsize i = 0; i < n; i++) {
        if (!(sweep->peak[i] >= 0) || (double)number++ < next)
            continue;
        next += every;
        struct laser_point point = {.sweep = sweep->sweep,
                                    .laser = sweep->laser,
                                    .camera = sweep->camera,
                                    .arc_rad = sweep->arc_rad,
                                    .sweep_rad =
                                        sweep->from_rad + (double)sweep->peak[i] * sweep->step_rad,
                                    .sigma_mm = POINT_MM};
        int x = (int)(i % (gsize)camera->width), y = (int)(i / (gsize)camera->width);
        if (!plane_point(camera, sweep, x, y, &point.point_mm))
            continue;
        /* Derivative of the point with respect to the camera's offset, from the differences to the
         * neighbouring pixels. A pixel at the border of the plane has no neighbour; its derivative
         * is 0. */
        struct vec3 right, down;
        if (plane_point(camera, sweep, x + 1, y, &right) &&
            plane_point(camera, sweep, x, y + 1, &down)) {
            point.shift[0] = (float)(right.x - point.point_mm.x);
            point.shift[1] = (float)(down.x - point.point_mm.x);
            point.shift[2] = (float)(right.y - point.point_mm.y);
            point.shift[3] = (float)(down.y - point.point_mm.y);
        }
        const double range_mm = vec3_length(vec3_cross(vec3_sub(point.point_mm, source), axis));
        if (noise_frames > 0)
            point.noise_mm = (float)(noise_frames * fabs(sweep->step_rad) * range_mm);
        if (sweep->width && sweep->width[i] > 0)
            point.line_rad = sweep->width[i] * (float)fabs(sweep->step_rad);
        g_array_append_val(points, point);
        taken++;
    }
    return (int)taken;
}
