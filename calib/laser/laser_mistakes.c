/* Finds the reason why sweeps may contradict the rig. Each possible mistake is undone, and the
 * points are compared with the rig as it is known before the fit. For each laser, the sweep angle
 * s_i at which its sheet contains point i depends linearly on the commanded angle c_i: s_i ≈ a + b
 * c_i. Here a is a wrong zero and b − 1 a stretch. The evidence is the spread about this line, the
 * median of |s_i − a − b c_i|. If only the adjustment is wrong, the spread is some hundredths of a
 * degree. */
#include "laser.h"

#include "geometry/fit.h"

#include <math.h>
#include <string.h>

#define MIN_RAD    (0.05 * G_PI / 180) /* a smaller spread does not indicate a mistake */
#define BETTER     5.0                 /* factor by which undoing a mistake must lower the spread */
#define MAX_PLANES 16
#define DEG        (180 / G_PI)

enum kind { NONE, ARC_REVERSED, ARC_RADIANS, LASERS_SWAPPED, PLANES_SWAPPED };

struct mistake {
    enum kind kind;
    int a, b; /* lasers or planes that are swapped */
};

struct planes {
    double z_mm[MAX_PLANES];
    int sweep[MAX_PLANES]; /* number of one sweep on each plane */
    int n;
};

static void find_planes(const struct laser_point *points, int n, struct planes *ret) {
    *ret = (struct planes){.n = 0};
    for (int i = 0; i < n; i++) {
        int k = 0;
        while (k < ret->n && ret->z_mm[k] != points[i].point_mm.z)
            k++;
        if (k == ret->n && k < MAX_PLANES) {
            ret->z_mm[k] = points[i].point_mm.z;
            ret->sweep[ret->n++] = points[i].sweep;
        }
    }
}

/* Returns the point as it would be without the mistake. If a pixel saw another plane than the noted
 * one, it saw the point where its ray meets that other plane: p' = eye + (p − eye) (z' − eye_z) /
 * (z − eye_z). */
static struct laser_point undo(const struct rig *rig, const struct planes *planes,
                               const struct mistake *mistake, const struct laser_point *point) {
    struct laser_point p = *point;
    if (mistake->kind == ARC_REVERSED)
        p.arc_rad = -p.arc_rad;
    else if (mistake->kind == ARC_RADIANS)
        p.arc_rad *= DEG;
    else if (mistake->kind == LASERS_SWAPPED && (p.laser == mistake->a || p.laser == mistake->b))
        p.laser = mistake->a + mistake->b - p.laser;
    else if (mistake->kind == PLANES_SWAPPED) {
        const double a_mm = planes->z_mm[mistake->a], b_mm = planes->z_mm[mistake->b];
        const double z_mm = p.point_mm.z;
        if (z_mm != a_mm && z_mm != b_mm)
            return p;
        const struct vec3 eye = rig_camera_centre_mm(&rig->cameras[p.camera]);
        const double other_mm = z_mm == a_mm ? b_mm : a_mm;
        p.point_mm = vec3_add(
            eye, vec3_scale(vec3_sub(p.point_mm, eye), (other_mm - eye.z) / (z_mm - eye.z)));
    }
    return p;
}

/* Returns the spread of the sweep angles after a mistake was undone. Returns INFINITY if a laser
 * would then turn in the wrong direction, or by an angle far from the commanded one. This limit
 * does not apply to the kind NONE. */
static double spread_rad(const struct rig *rig, const struct laser_point *points, int n,
                         const struct planes *planes, const struct mistake *mistake) {
    struct line {
        double n, c, s, cc, cs, a, b;
    } lines[RIG_MAX_LASERS] = {{0}};
    g_autofree double *sweep = g_new(double, n), *off = g_new(double, n);
    g_autofree int *laser = g_new(int, n);
    for (int i = 0; i < n; i++) {
        const struct laser_point p = undo(rig, planes, mistake, &points[i]);
        struct line *line = &lines[laser[i] = p.laser];
        const double c = p.sweep_rad;
        sweep[i] = rig_laser_sweep_rad(&rig->arc, &rig->lasers[p.laser], p.arc_rad, p.point_mm);
        line->n++;
        line->c += c, line->cc += c * c;
        line->s += sweep[i], line->cs += c * sweep[i];
    }
    for (int l = 0; l < rig->n_lasers; l++) {
        struct line *line = &lines[l];
        const double det = line->n * line->cc - line->c * line->c;
        line->b = det > 0 ? (line->n * line->cs - line->c * line->s) / det : 1;
        line->a = line->n > 0 ? (line->s - line->b * line->c) / line->n : 0;
        if (mistake->kind != NONE && fabs(line->b - 1) > RIG_MAX_STRETCH)
            return INFINITY;
    }
    for (int i = 0; i < n; i++)
        off[i] = fabs(sweep[i] - lines[laser[i]].a - lines[laser[i]].b * points[i].sweep_rad);
    qsort(off, (gsize)n, sizeof *off, fit_compare);
    return off[n / 2];
}

static void tell(const struct rig *rig, const struct planes *planes, const struct mistake *mistake,
                 const char *const *sweep_names, double is_rad, double would_be_rad,
                 GError **error) {
    const int a = mistake->a, b = mistake->b;
    g_autofree char *fit = g_strdup_printf(
        "the lines deviate by %.3g° from the sheets, and by %.3g° with this corrected",
        is_rad * DEG, would_be_rad * DEG);
    if (mistake->kind == ARC_REVERSED)
        g_set_error(error, LASER_ERROR, LASER_ERROR_MISTAKE,
                    "the arc turns the wrong way, clockwise seen from above (%s); change the sign "
                    "of steps_per_deg or units_per_deg of [axis arc] in the rig file, or the "
                    "motor's direction in its controller, or for imported pictures the sign of "
                    "arc_deg in the table, and capture or import again",
                    fit);
    else if (mistake->kind == ARC_RADIANS)
        g_set_error(error, LASER_ERROR, LASER_ERROR_MISTAKE,
                    "the angles of the arc are in radians (%s); give arc_deg in degrees in the "
                    "table of the pictures, or steps_per_deg or units_per_deg of [axis arc] in the "
                    "rig file in steps per degree, and import or capture again",
                    fit);
    else if (mistake->kind == LASERS_SWAPPED)
        g_set_error(error, LASER_ERROR, LASER_ERROR_MISTAKE,
                    "lasers %s and %s are exchanged (%s); exchange theta_deg and distance_mm of "
                    "[laser %s] and [laser %s] in the rig file, or their wiring, or for imported "
                    "pictures their names in the table, and capture or import again",
                    rig->lasers[a].name, rig->lasers[b].name, fit, rig->lasers[a].name,
                    rig->lasers[b].name);
    else
        g_set_error(error, LASER_ERROR, LASER_ERROR_MISTAKE,
                    "%s and %s: the heights of their planes, %g and %g mm, are exchanged (%s); "
                    "exchange the heights in --planes, or the order of the sessions, or correct "
                    "reference_mm in [sample] of the session files",
                    sweep_names[planes->sweep[a]], sweep_names[planes->sweep[b]], planes->z_mm[a],
                    planes->z_mm[b], fit);
}

gboolean laser_check_mistakes(const struct rig *rig, const struct laser_point *points, int n,
                              const char *const *sweep_names, GError **error) {
    struct mistake none = {NONE, 0, 0}, best = none;
    struct planes planes;
    double least;
    find_planes(points, n, &planes);
    const double is = n > 0 ? spread_rad(rig, points, n, &planes, &none) : 0;
    if (!(is > MIN_RAD))
        return TRUE;
    g_autoptr(GArray) mistakes = g_array_new(FALSE, FALSE, sizeof(struct mistake));
    for (enum kind kind = ARC_REVERSED; kind <= PLANES_SWAPPED; kind++) {
        const int of = kind == LASERS_SWAPPED   ? rig->n_lasers
                       : kind == PLANES_SWAPPED ? planes.n
                                                : 2;
        for (int a = 0; a < of; a++)
            for (int b = a + 1; b < of; b++) {
                const struct mistake mistake = {kind, a, b};
                g_array_append_val(mistakes, mistake);
            }
    }
    least = is / BETTER;
    for (guint i = 0; i < mistakes->len; i++) {
        const struct mistake *one = &g_array_index(mistakes, struct mistake, i);
        const double would_be = spread_rad(rig, points, n, &planes, one);
        if (would_be < least) {
            least = would_be;
            best = *one;
        }
    }
    if (best.kind == NONE)
        return TRUE;
    tell(rig, &planes, &best, sweep_names, is, least, error);
    return FALSE;
}
