/* Finds mistakes in the notes on the pictures: the turntable turns the other way, its angles are in
 * radians, or cameras are exchanged. Each mistake is tried on the corners of the boards that were
 * found. A mistake is named only if the boards fit when it is corrected, and fit much better than
 * without the correction. */
#include "cameras_private.h"

#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
#define DEGREES  (180 / G_PI)
/* mistakes are tried if the first fit failed, or if its typical residual is at least this */
#define SUSPICIOUS_PX 2.0
#define EXPLAINED_PX  1.0 /* a mistake explains the boards if the residual is below this */
#define BETTER        5.0 /* factor by which the correction must also reduce the residual */
/* Largest number of cameras for which all pairs are tried. With more cameras, only pairs of cameras
 * that follow each other in the rig file are tried. */
#define MAX_PAIRED 8
#define REFINED    3 /* number of mistakes that are refined, those with the best start */
/* a camera counts as exchanged if it is nearer to another camera's place than to its own by at
 * least this factor */
#define EXCHANGED 5.0

struct mistake {
    /* factor by which the noted angles are multiplied */
    double turntable;
    /* number of the camera that took the pictures noted for each camera */
    int cameras[RIG_MAX_CAMERAS];
    /* result of start_px() */
    double start_px;
};

static struct mistake mistake_of(double turntable) {
    struct mistake ret = {.turntable = turntable};
    for (int i = 0; i < RIG_MAX_CAMERAS; i++)
        ret.cameras[i] = i;
    return ret;
}

/* Returns whether one camera may have taken the pictures of the other. */
static gboolean alike(const struct rig *rig, int a, int b) {
    const struct rig_camera *p = &rig->cameras[a], *q = &rig->cameras[b];
    return p->width == q->width && p->height == q->height && !p->on_arm && !q->on_arm;
}

static gboolean all_alike(const struct rig *rig) {
    for (int i = 1; i < rig->n_cameras; i++)
        if (!alike(rig, 0, i))
            return FALSE;
    return rig->n_cameras > 2;
}

static GArray *all_mistakes(const struct cameras_work *work) {
    static const double factors[] = {-1, DEGREES, -DEGREES};
    const struct rig *rig = &work->nominal;
    const int n = rig->n_cameras;
    GArray *all = g_array_new(FALSE, FALSE, sizeof(struct mistake));
    for (gsize i = 0; !work->task->no_turntable && i < G_N_ELEMENTS(factors); i++) {
        const struct mistake mistake = mistake_of(factors[i]);
        g_array_append_val(all, mistake);
    }
    for (int a = 0; a < n; a++)
        for (int b = a + 1; b < (n > MAX_PAIRED ? MIN(a + 2, n) : n); b++) {
            struct mistake mistake = mistake_of(1);
            mistake.cameras[a] = b;
            mistake.cameras[b] = a;
            if (alike(rig, a, b))
                g_array_append_val(all, mistake);
        }
    struct mistake order[3] = {mistake_of(1), mistake_of(1), mistake_of(1)};
    for (int i = 0; i < n; i++) {
        order[0].cameras[i] = n - 1 - i;
        order[1].cameras[i] = (i + 1) % n;
        order[2].cameras[i] = (i + n - 1) % n;
    }
    if (all_alike(rig))
        g_array_append_vals(all, order + (n == 3), n == 3 ? 2 : 3);
    return all;
}

/* Sets the pictures' cameras and angles to what they are in truth if the mistake was made, and
 * starts the fit anew. */
static void set_mistake(struct cameras_work *work, const struct mistake *mistake) {
    const struct cameras_task *task = work->task;
    for (int i = 0; i < task->n_pictures; i++) {
        struct seen *seen = &work->seen[i];
        const double rad = RAD(task->pictures[i].turntable_deg * mistake->turntable);
        seen->camera = mistake->cameras[task->pictures[i].camera];
        work->bundle.stops[seen->stop].commanded_rad = rad;
        work->bundle.stops[seen->stop].angle_rad = rad;
    }
    for (int l = 0; l < work->bundle.n_lays; l++)
        work->bundle.lays[l] = (struct bundle_lay){0};
    cameras_start(work);
}

/* Returns the median residual of all corners in pixels. Corners behind their camera count as 1e6,
 * which is also returned if there are no corners. */
static double typical_px(const struct cameras_work *work) {
    g_autoptr(GArray) all = g_array_new(FALSE, FALSE, sizeof(double));
    for (int i = 0; i < work->bundle.n_observations; i++) {
        double d[2];
        const double whitened = cameras_residual(&work->bundle, &work->bundle.observations[i], d);
        const double px = whitened < G_MAXDOUBLE ? hypot(d[0], d[1]) : 1e6;
        g_array_append_val(all, px);
    }
    return all->len > 0 ? cameras_median(all) : 1e6;
}

/* Returns the median residual in pixels if this mistake was made, before the cameras are adjusted.
 * Returns G_MAXDOUBLE if the fit cannot begin. */
static double start_px(struct cameras_work *work, const struct mistake *mistake) {
    set_mistake(work, mistake);
    if (!cameras_check_motion(work, NULL) || !cameras_start_lays(work, NULL) ||
        (work->task->no_turntable && !cameras_level(work, NULL)))
        return G_MAXDOUBLE;
    cameras_set_observations(work);
    return typical_px(work);
}

/* Returns the median residual in pixels if this mistake was made, after the cameras were adjusted.
 * If the adjustment fails, returns start_px(). */
static double refined_px(struct cameras_work *work, const struct mistake *mistake) {
    const double start = start_px(work, mistake);
    return start < G_MAXDOUBLE && cameras_solve(work, NULL) ? typical_px(work) : start;
}

static void tell_cameras(const struct rig *rig, const struct mistake *mistake, const char *fit,
                         GError **error) {
    int a = 0, changed = 0;
    for (int i = rig->n_cameras - 1; i >= 0; i--)
        if (mistake->cameras[i] != i) {
            a = i;
            changed++;
        }
    const char *one = rig->cameras[a].name, *other = rig->cameras[mistake->cameras[a]].name;
    if (changed == 2)
        cameras_refuse(
            error, CAMERAS_ERROR_FIT,
            "cameras %s and %s are exchanged: in the right order %s; " CAMERAS_EXCHANGE_THEM, one,
            other, fit, one, other);
    else
        cameras_refuse(error, CAMERAS_ERROR_FIT,
                       "the cameras are in another order than noted: for example, the pictures "
                       "noted for %s were taken by %s; in the right order %s; correct the device "
                       "of every [camera …] in the rig file, or for imported pictures the names in "
                       "the table, and capture or import again",
                       one, other, fit);
}

static void tell_mistake(const struct rig *rig, const struct mistake *mistake, double as_noted_px,
                         double with_px, GError **error) {
    g_autofree char *fit =
        as_noted_px < 1e5
            ? g_strdup_printf("the board fits to %.2g px instead of %.3g px", with_px, as_noted_px)
            : g_strdup_printf("the board fits to %.2g px, and otherwise not at all", with_px);
    if (mistake->turntable == 1)
        tell_cameras(rig, mistake, fit, error);
    else if (mistake->turntable == -1)
        cameras_refuse(error, CAMERAS_ERROR_FIT,
                       "the turntable turns the wrong way, clockwise seen from above: with the "
                       "other sign of the angles, %s; correct the sign of steps_per_deg or "
                       "units_per_deg of [axis turntable] in the rig file, or for imported "
                       "pictures turntable_deg in the table, and capture or import again",
                       fit);
    else
        cameras_refuse(
            error, CAMERAS_ERROR_FIT,
            "the turntable's angles seem to be in radians%s: read as radians, %s; correct "
            "turntable_deg in the table (imported pictures) or steps_per_deg or units_per_deg of "
            "[axis turntable] in the rig file, and capture or import again",
            mistake->turntable < 0 ? " and of the opposite sign" : "", fit);
}

static int by_start(gconstpointer a, gconstpointer b) {
    const struct mistake *x = a, *y = b;
    return (x->start_px > y->start_px) - (x->start_px < y->start_px);
}

gboolean cameras_find_mistake(struct cameras_work *work, gboolean fitted, GError **error) {
    const struct mistake none = mistake_of(1);
    struct mistake best = none;
    const double as_noted_px = fitted ? typical_px(work) : G_MAXDOUBLE;
    if (as_noted_px < SUSPICIOUS_PX)
        return FALSE;
    g_autoptr(GArray) mistakes = all_mistakes(work);
    for (guint i = 0; i < mistakes->len; i++) {
        struct mistake *mistake = &g_array_index(mistakes, struct mistake, i);
        mistake->start_px = start_px(work, mistake);
    }
    g_array_sort(mistakes, by_start);
    double min_px = G_MAXDOUBLE;
    for (guint i = 0; i < MIN(mistakes->len, REFINED); i++) {
        const struct mistake *mistake = &g_array_index(mistakes, struct mistake, i);
        const double px = refined_px(work, mistake);
        if (px >= min_px)
            continue;
        min_px = px;
        best = *mistake;
    }
    if (min_px < EXPLAINED_PX && min_px < as_noted_px / BETTER) {
        tell_mistake(&work->nominal, &best, as_noted_px, min_px, error);
        return TRUE;
    }
    work->unexplained_px = fitted ? as_noted_px : 0;
    refined_px(work, &none); /* restores the state without a mistake */
    return FALSE;
}

/* The places are compared, because exchanged cameras can fit well if their poses are free. */
gboolean cameras_check_places(const struct cameras_work *work, GError **error) {
    const struct rig *rig = &work->nominal;
    for (int i = 0; i < rig->n_cameras; i++) {
        struct rig_camera found;
        if (work->bundle.cameras[i].fixed_pose)
            continue;
        cameras_take_camera(&found, &work->bundle.cameras[i]);
        const struct vec3 at = rig_camera_centre_mm(&found);
        const double own_mm = vec3_length(vec3_sub(at, rig_camera_centre_mm(&rig->cameras[i])));
        for (int k = 0; k < rig->n_cameras; k++) {
            const double other_mm =
                vec3_length(vec3_sub(at, rig_camera_centre_mm(&rig->cameras[k])));
            if (rig_camera_unit(rig, i) == rig_camera_unit(rig, k) || other_mm > own_mm / EXCHANGED)
                continue;
            return cameras_refuse(
                error, CAMERAS_ERROR_FIT,
                "camera %s stands %.0f mm from its expected place, but only %.0f mm from "
                "the place of camera %s: the two cameras are exchanged; " CAMERAS_EXCHANGE_THEM,
                rig->cameras[i].name, own_mm, other_mm, rig->cameras[k].name, rig->cameras[i].name,
                rig->cameras[k].name);
        }
    }
    return TRUE;
}
