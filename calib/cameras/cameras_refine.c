/* The bundle adjustment is made in rounds. Each round estimates the noise of each camera's corners,
 * and rejects corners and pictures that are outliers. Rejected pictures are tried again as the
 * geometry improves. */
#include "cameras_private.h"

#include <math.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
/* Smallest residual of an outlier, in units of the noise. A corner whose error is only noise
 * exceeds it with probability 4e-5. The limit is twice as large after a fit with Huber's loss. */
#define OUTLIER         4.5
#define OUTLIER_PX      0.1    /* smaller residuals are never outliers */
#define ROBUST          3      /* threshold of Huber's loss, in units of the noise */
#define MEDIAN_OF_NOISE 1.1774 /* median length of 2D normal deviates, in σ: √(2 ln 2) */
/* The noise of a picture is estimated from its residuals and from the noise of its camera. The
 * noise of the camera counts as much as this number of residuals. */
#define TYPICAL 20
/* Smallest decrease of χ² that is significant. By chance alone χ² decreases too; the unit is the
 * standard deviation of this decrease by chance. */
#define SIGNIFICANT  4
#define MAX_REJECTED 0.4 /* share of rejected corners above which the picture is rejected */

/* Returns |W (projected − seen)|, where W is the inverse square root of the corner's covariance. */
double cameras_residual(const struct bundle *bundle, const struct bundle_observation *o,
                        double ret_d[2]) {
    double px[2] = {0, 0};
    const gboolean seen = bundle_project(bundle, o->camera, o->stop, FALSE, o->board_mm, px);
    ret_d[0] = px[0] - o->seen_px[0];
    ret_d[1] = px[1] - o->seen_px[1];
    const double u = o->whiten[0][0] * ret_d[0] + o->whiten[0][1] * ret_d[1];
    const double v = o->whiten[1][0] * ret_d[0] + o->whiten[1][1] * ret_d[1];
    return seen ? hypot(u, v) : G_MAXDOUBLE;
}

int cameras_n_parameters(const struct cameras_work *work) {
    int lenses = 0;
    for (int c = 0; c < work->bundle.n_cameras; c++)
        lenses += work->bundle.cameras[c].stop == 0;
    return 9 * lenses + 6 * work->bundle.n_cameras + 6 * work->bundle.n_lays +
           (work->free_boards ? 0 : work->bundle.n_stops) + (work->bundle.bend_sigma > 0 ? 3 : 0) +
           (work->bundle.wobble_harmonics > 0 ? 4 * work->bundle.wobble_harmonics - 2 : 0);
}

/* The covariance of a corner is L Lᵀ with L = W⁻¹. Its trace is the mean square of the noise. After
 * a fit of p parameters to N residuals, the share 1 − p / N of the noise remains. */
double cameras_expected_px(const struct cameras_work *work, int camera) {
    const struct bundle *b = &work->bundle;
    double sum = 0;
    int n = 0, all = 0;
    for (int i = 0; i < b->n_observations; i++) {
        const struct bundle_observation *o = &b->observations[i];
        all += !o->rejected;
        if (o->rejected || (camera >= 0 && o->camera != camera))
            continue;
        const double k = 1 / o->whiten[0][0], m = 1 / o->whiten[1][1];
        const double l = -o->whiten[1][0] * k * m;
        sum += k * k + l * l + m * m;
        n++;
    }
    if (work->free_boards || n == 0)
        return 0;
    return sqrt(sum / n * MAX(1 - cameras_n_parameters(work) / (2.0 * all), 0.05));
}

/* Estimates the noise as the median of |residual| / √(2 ln 2). The corners' covariances contain
 * only the pixel noise. Compression, a warped print and errors of the lens model only add to the
 * noise, so the estimate is at least 1. */
void cameras_estimate_noise(struct bundle *b) {
    double d[2];
    for (int c = 0; c < b->n_cameras; c++) {
        g_autoptr(GArray) residuals = g_array_new(FALSE, FALSE, sizeof(double));
        for (int i = 0; i < b->n_observations; i++) {
            const double r = cameras_residual(b, &b->observations[i], d);
            if (b->observations[i].camera == c)
                g_array_append_val(residuals, r);
        }
        if (residuals->len > 0)
            b->cameras[c].noise = MAX(cameras_median(residuals) / MEDIAN_OF_NOISE, 1);
    }
}

/* Returns the sum over all corners of (residual / noise)², each at most ROBUST². */
static double robust_squares(const struct bundle *b) {
    double sum = 0, d[2];
    for (int i = 0; i < b->n_observations; i++) {
        const struct bundle_observation *o = &b->observations[i];
        const double r = cameras_residual(b, o, d) / b->cameras[o->camera].noise;
        sum += MIN(r * r, ROBUST * ROBUST);
    }
    return sum;
}

/* Returns the number of different angles of the turntable, modulo a turn. */
static int n_angles(const struct bundle *b) {
    int n = 0;
    for (int i = 0; i < b->n_stops; i++) {
        gboolean fresh = TRUE;
        for (int k = 0; k < i && fresh; k++)
            fresh = fabs(remainder(b->stops[i].commanded_rad - b->stops[k].commanded_rad,
                                   2 * G_PI)) > RAD(0.5);
        n += fresh;
    }
    return n;
}

/* Fits the bearing's wobble, and keeps it if it is significant (cameras.h). Otherwise the wobble
 * is set to 0, but the other parameters keep the values of this fit. Returns FALSE if the fit
 * fails. n angles determine the harmonics 1 … (n − 1) / 2 (Nyquist). */
static gboolean fit_wobble(struct cameras_work *work, GError **error) {
    struct bundle *b = &work->bundle;
    double inflation[RIG_MAX_CAMERAS] = {0}, most = 1;
    const int harmonics = MIN((n_angles(b) - 1) / 2, RIG_WOBBLE_HARMONICS);
    if (work->free_boards || work->task->no_turntable || harmonics < 1)
        return TRUE;
    const double without = robust_squares(b);
    b->wobble_harmonics = harmonics;
    if (!bundle_solve(b, error) || !bundle_covariance(b, inflation, error))
        return FALSE;
    for (int c = 0; c < b->n_cameras; c++)
        most = MAX(most, inflation[c]);
    const double with = robust_squares(b), p = 4 * harmonics - 2;
    const double gain = 2 * b->n_observations * (without / MAX(with, 1e-9) - 1) / most;
    if (gain > p + SIGNIFICANT * sqrt(2 * p)) {
        cameras_estimate_noise(b);
        return TRUE;
    }
    b->wobble_harmonics = 0;
    b->wobble_error_rad = 0;
    memset(b->wobble, 0, sizeof b->wobble);
    return TRUE;
}

static gboolean is_outlier(const struct bundle *b, const struct bundle_observation *o,
                           double *ret_r) {
    double d[2];
    *ret_r = cameras_residual(b, o, d);
    return *ret_r > OUTLIER * b->cameras[o->camera].noise * (b->robust > 0 ? 2 : 1) &&
           hypot(d[0], d[1]) > OUTLIER_PX;
}

/* Rejects outliers, and estimates each camera's noise from its other corners: σ² = Σ r² / (n (1 − p
 * / N)). n is the number of the camera's residuals r. p parameters are fitted to N residuals of all
 * cameras. */
static void weigh(struct cameras_work *work) {
    struct bundle *b = &work->bundle;
    double sum[RIG_MAX_CAMERAS] = {0}, n[RIG_MAX_CAMERAS] = {0}, r;
    double used = 0;
    for (int i = 0; i < b->n_observations; i++) {
        struct bundle_observation *o = &b->observations[i];
        o->rejected = !work->seen[o->picture].corners || is_outlier(b, o, &r);
        if (o->rejected)
            continue;
        sum[o->camera] += r * r;
        n[o->camera] += 2;
        used += 2;
    }
    const double share = MAX(1 - cameras_n_parameters(work) / MAX(used, 1), 0.05);
    for (int c = 0; c < b->n_cameras; c++)
        if (n[c] > 0)
            b->cameras[c].noise = sqrt(MAX(sum[c] / n[c] / share, 1e-6));
}

/* Estimates the noise of each picture relative to its camera, because darker and more oblique
 * pictures are noisier: σ² = (TYPICAL + Σ r²) / (TYPICAL + n). n is the number of the picture's
 * residuals r, in units of the camera's noise. With few corners the camera's noise dominates. */
static void weigh_pictures(struct cameras_work *work) {
    struct bundle *b = &work->bundle;
    const int n = work->task->n_pictures;
    g_autofree double *sum = g_new0(double, n + 1), *count = g_new0(double, n + 1);
    double d[2];
    for (int i = 0; i < b->n_observations; i++) {
        const struct bundle_observation *o = &b->observations[i];
        if (o->rejected)
            continue;
        const double r = cameras_residual(b, o, d) / b->cameras[o->camera].noise;
        sum[o->picture] += r * r;
        count[o->picture] += 2;
    }
    for (int i = 0; i < b->n_observations; i++) {
        const int picture = b->observations[i].picture;
        b->observations[i].noise = sqrt((TYPICAL + sum[picture]) / (TYPICAL + count[picture]));
    }
}

static void set_aside(struct cameras_work *work, int picture) {
    struct seen *seen = &work->seen[picture];
    seen->set_aside = g_steal_pointer(&seen->corners);
    for (int i = 0; i < work->bundle.n_observations; i++)
        if (work->bundle.observations[i].picture == picture)
            work->bundle.observations[i].rejected = TRUE;
}

/* Rejects pictures in which too many corners are outliers. Such pictures show something else, or
 * something has moved. */
static void drop_pictures(struct cameras_work *work) {
    const int n = work->task->n_pictures;
    g_autofree int *rejected = g_new0(int, n + 1), *all = g_new0(int, n + 1);
    for (int i = 0; i < work->bundle.n_observations; i++) {
        const struct bundle_observation *o = &work->bundle.observations[i];
        all[o->picture]++;
        rejected[o->picture] += o->rejected;
    }
    for (int i = 0; i < n; i++) {
        struct seen *seen = &work->seen[i];
        if (!seen->corners || rejected[i] <= MAX_REJECTED * all[i])
            continue;
        g_autofree char *why = g_strdup_printf(
            "%d of the picture's %d corners contradict the other pictures; %s", rejected[i], all[i],
            work->free_boards ? "check zoom and focus, and that the photograph is not cropped, "
                                "scaled or blurred by motion"
                              : "check whether something has moved");
        cameras_set_why(seen, why);
        set_aside(work, i);
    }
}

/* Fits the position of the board in one picture to the present cameras. With a turntable, only the
 * angle is fitted. Changes the picture's lay and stop in place. Returns FALSE if the fit fails. */
static gboolean solve_picture(struct cameras_work *work, int picture) {
    struct seen *seen = &work->seen[picture];
    struct bundle one = work->bundle;
    g_autofree struct bundle_camera *cameras =
        g_memdup2(one.cameras, sizeof *cameras * (gsize)one.n_cameras);
    g_autoptr(GArray) own = g_array_new(FALSE, FALSE, sizeof(struct bundle_observation));
    for (int i = 0; i < one.n_observations; i++) {
        struct bundle_observation o = one.observations[i];
        o.rejected = FALSE;
        o.noise = 1;
        if (o.picture == picture)
            g_array_append_val(own, o);
    }
    for (int c = 0; c < one.n_cameras; c++)
        cameras[c].fixed_pose = cameras[c].fixed_lens = TRUE;
    one.cameras = cameras;
    one.observations = (struct bundle_observation *)(gpointer)own->data;
    one.n_observations = (int)own->len;
    one.fix_azimuth = FALSE;
    one.bend_sigma = 0;
    one.wobble_harmonics = 0;
    one.robust = ROBUST;
    const gboolean was_fixed = one.lays[seen->lay].fixed;
    one.lays[seen->lay].fixed |= !work->free_boards && !work->task->no_turntable;
    const gboolean ok =
        (!work->free_boards || cameras_start_lay(work, seen->lay)) && bundle_solve(&one, NULL);
    one.lays[seen->lay].fixed = was_fixed;
    return ok;
}

/* Sets `rejected` of those corners of one picture that are outliers. Returns FALSE if so many
 * corners are outliers that the picture must not be used. */
static gboolean is_good(struct cameras_work *work, int picture) {
    struct bundle *b = &work->bundle;
    int rejected = 0, all = 0;
    double r;
    for (int i = 0; i < b->n_observations; i++) {
        if (b->observations[i].picture != picture)
            continue;
        b->observations[i].rejected = is_outlier(b, &b->observations[i], &r);
        rejected += b->observations[i].rejected;
        all++;
    }
    return rejected <= MAX_REJECTED * all;
}

/* Tries rejected pictures again with the present geometry. A picture that now fits is used
 * again. The lay and stop of any other picture are restored. */
static void retry_pictures(struct cameras_work *work) {
    for (int i = 0; i < work->task->n_pictures; i++) {
        struct seen *seen = &work->seen[i];
        if (!seen->set_aside)
            continue;
        struct bundle_lay *lay = &work->bundle.lays[seen->lay];
        struct bundle_stop *stop = &work->bundle.stops[seen->stop];
        const struct bundle_lay lay_before = *lay;
        const struct bundle_stop stop_before = *stop;
        seen->corners = g_steal_pointer(&seen->set_aside);
        if (solve_picture(work, i) && is_good(work, i)) {
            g_clear_pointer(&seen->why, g_free);
            continue;
        }
        *lay = lay_before;
        *stop = stop_before;
        set_aside(work, i);
    }
}

/* The first round uses Huber's loss. Later rounds use least squares without the outliers. */
gboolean cameras_refine(struct cameras_work *work, GError **error) {
    /* Fixes the height of flat lays, because they define z = 0. */
    for (int l = 0; l < work->bundle.n_lays; l++) {
        struct bundle_lay *lay = &work->bundle.lays[l];
        lay->fixed_height =
            !work->free_boards && !work->task->no_turntable && cameras_tilt_rad(lay) < RAD(2);
        if (lay->fixed_height)
            lay->place[2] = work->task->board.thickness_mm;
    }
    cameras_set_observations(work);
    for (int round = 0; round < CAMERAS_ROUNDS; round++) {
        work->bundle.robust = round == 0 ? ROBUST : 0;
        if (round > 0)
            retry_pictures(work);
        if (!bundle_solve(&work->bundle, error))
            return FALSE;
        /* fitted twice, because Huber's threshold depends on the estimated noise */
        if (round == 0) {
            cameras_estimate_noise(&work->bundle);
            if (!bundle_solve(&work->bundle, error))
                return FALSE;
            cameras_estimate_noise(&work->bundle);
            if (!fit_wobble(work, error))
                return FALSE;
        }
        weigh(work);
        weigh_pictures(work);
        drop_pictures(work);
        if (!cameras_progress(work, error))
            return FALSE;
    }
    return bundle_solve(&work->bundle, error) &&
           bundle_covariance(&work->bundle, work->inflation, error);
}
