#include "guard.h"

#include <math.h>
#include <string.h>

#include "hand_link.h"
#include "picture_report.h"
#include "radiometry/fiducials.h"
#include "trial.h"

#define LONG_PICTURES 500
/* Maximum part of a camera's pixels that may be saturated at the shortest exposure. It is above 0
 * because a few highlights are allowed. */
#define SATURATED_PART 0.05
/* At the longest exposure under the brightest lamp, the 99th percentile of a picture must reach at
 * least BRIGHT_PART of the range. If it does not, an exposure is suggested that reaches
 * WANTED_PART. */
#define BRIGHT_PART 0.1
#define WANTED_PART 0.5
/* A camera counts as seeing a lamp if the lamp raises the mean of its picture by this part of the
 * range. */
#define LAMP_PART 0.0005
/* If a picture is saturated, another one is taken with an exposure that is shorter by this factor.
 * The suitable exposure follows from it. */
#define SHORTER 32
/* Limits for fiducials, the same as in a capture (capture_marks.c). */
#define SYSTEMATIC_PX 0.05
#define MIN_DEG       0.05

struct seen { /* what a camera has seen of all lamps */
    int bits;
    double dark_dn;
    double high_dn;    /* highest 99th percentile of all pictures at the longest exposure */
    double saturated;  /* largest saturated part of all pictures at the shortest exposure */
    int saturated_by;  /* the lamp of that picture */
    double shorter_us; /* exposure at which that picture would not be saturated; 0 if not known */
    gboolean any;      /* the camera sees at least one lamp */
};

struct guard {
    struct trial trial;
    const struct calibration *calibration;
    GPtrArray *warnings;
    double arc_deg;
    int n_shots;
    struct seen seen[RIG_MAX_CAMERAS];
    gboolean shines[RIG_MAX_LAMPS], tried[RIG_MAX_LAMPS];
    GArray *fiducials; /* of struct fiducial_seen */
    /* `moved` is what has moved according to all shots. moved_before is what has moved according to
     * the last shot. */
    struct fiducials_moved moved, moved_before;
};

static int count_directions(const struct ring *rings, int n, char **devices, int n_devices) {
    int sum = 0;
    for (int i = 0; i < n; i++)
        sum += rings[i].count;
    for (char **name = devices; name && *name; name++)
        sum += g_str_equal(*name, "all") ? n_devices : 1;
    return sum;
}

gboolean guard_is_worth_it(const struct session_conf *conf, const struct rig *rig) {
    return count_directions(conf->views, conf->n_views, conf->views_of, rig->n_cameras) *
               count_directions(conf->lights, conf->n_lights, conf->lights_of, rig->n_lamps) >=
           LONG_PICTURES;
}

G_GNUC_PRINTF(2, 3)
static void warn(struct guard *guard, const char *format, ...) {
    va_list args;
    va_start(args, format);
    g_ptr_array_add(guard->warnings, g_strdup_vprintf(format, args));
    va_end(args);
}

/* Adds a warning for each part that the session needs and the calibration lacks. */
static void judge_calibration(struct guard *guard) {
    const struct session_conf *conf = guard->trial.conf;
    const gboolean lights = conf->n_lights > 0 || conf->lights_of;
    const gboolean lasers = conf->n_lasers > 0 || conf->lasers_of;
    const gboolean needed[CALIBRATION_PARTS] = {[CALIBRATION_CAMERAS] = TRUE,
                                                [CALIBRATION_LIGHTS] = lights,
                                                [CALIBRATION_LASER] = lasers,
                                                [CALIBRATION_RADIOMETRY] = lights};
    g_autoptr(GString) lacks = g_string_new(NULL);
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        if (needed[i] && !guard->calibration->parts[i].done)
            g_string_append_printf(lacks, "%s%s", lacks->len ? ", " : "",
                                   calibration_part_name((enum calibration_kind)i));
    if (lacks->len)
        warn(guard,
             "parts of the rig are not calibrated (%s): positions in the rig file may be wrong by "
             "millimetres, and brightness by a tenth or more; calibrate them with "
             "mesorig calibrate, and name the file in [rig] calibration or with -c FILE",
             lacks->str);
}

static Frame *snap(struct guard *guard, int camera, double exposure_us, struct picture_values *ret,
                   GError **error) {
    Frame *frame = trial_snap(&guard->trial, camera, exposure_us, FALSE, error);
    if (!frame)
        return NULL;
    guard->seen[camera].bits = frame->bits;
    *ret = picture_values(frame);
    return frame;
}

static double range_dn(const struct guard *guard, int camera) {
    return (1 << guard->seen[camera].bits) - 1;
}

static double longest_exposure_us(const struct guard *guard) {
    return guard->trial.conf->exposures_us[guard->trial.conf->n_exposures - 1];
}

static gboolean take_darks(struct guard *guard, GError **error) {
    guard->n_shots++;
    for (int i = 0; i < guard->trial.n_cameras; i++) {
        const int c = guard->trial.cameras[i];
        struct picture_values report;
        g_autoptr(Frame) frame = snap(guard, c, longest_exposure_us(guard), &report, error);
        if (!frame)
            return FALSE;
        guard->seen[c].dark_dn = report.mean_dn;
    }
    return TRUE;
}

/* Finds the fiducials in a picture, if the cameras are calibrated and the calibration has
 * fiducials. */
static void find_fiducials(struct guard *guard, int camera, int lamp, const Frame *frame) {
    const struct calibration *known = guard->calibration;
    const gsize n = (gsize)frame->width * (gsize)frame->height;
    if (!known->parts[CALIBRATION_CAMERAS].done || known->rig.n_fiducials == 0)
        return;
    g_autofree float *mosaic = g_new(float, n);
    for (gsize i = 0; i < n; i++)
        mosaic[i] = (float)((frame->pixels[i] - guard->seen[camera].dark_dn) * 1000.0 /
                            (double)frame->exposure_us);
    const struct fiducial_scene scene = {.rig = &known->rig,
                                         .camera = camera,
                                         .lamp = lamp,
                                         .arc_rad = guard->arc_deg * G_PI / 180,
                                         .radiometry = &known->camera_radiometry[camera],
                                         .lamp_radiometry = &known->lamp_radiometry[lamp]};
    fiducials_measure(&scene, cfa_name(frame->cfa), mosaic, guard->fiducials);
}

static void check_fiducials(const struct guard *guard, guint from, struct fiducials_check *ret) {
    fiducials_check(&guard->calibration->rig,
                    (const struct fiducial_seen *)(void *)guard->fiducials->data + from,
                    (int)(guard->fiducials->len - from), SYSTEMATIC_PX, MIN_DEG, ret);
}

/* Finds what has moved, from the fiducials of one shot, which begin at the index `from`. If there
 * is more than one lamp, two consecutive shots must agree. The reason is that a bright sample next
 * to a fiducial may make the fiducial look displaced under one lamp. */
static void compare_shot(struct guard *guard, guint from) {
    struct fiducials_check check;
    if (guard->fiducials->len == from)
        return;
    check_fiducials(guard, from, &check);
    const struct fiducials_moved seen = fiducials_moved(&guard->calibration->rig, &check);
    const struct fiducials_moved sure =
        guard->trial.n_lamps == 1 ? seen : fiducials_moved_both(seen, guard->moved_before);
    guard->moved = fiducials_moved_union(guard->moved, sure);
    guard->moved_before = seen;
}

/* Returns an exposure at which a saturated camera would not saturate. It is found with one more
 * picture of the same shot. Returns 0 if none was found. */
static double find_shorter_us(struct guard *guard, int camera) {
    const double us = MAX(guard->trial.conf->exposures_us[0] / SHORTER, 1);
    struct picture_values report;
    /* The picture fails if the camera does not support such a short exposure. The result is then
     * 0. */
    g_autoptr(Frame) frame = snap(guard, camera, us, &report, NULL);
    const double above_dn = frame ? report.high_dn - guard->seen[camera].dark_dn : 0;
    return frame && report.saturated < SATURATED_PART && above_dn > 1
               ? us * WANTED_PART * range_dn(guard, camera) / above_dn
               : 0;
}

static gboolean try_camera(struct guard *guard, int lamp, int camera, GError **error) {
    const struct session_conf *conf = guard->trial.conf;
    struct seen *seen = &guard->seen[camera];
    struct picture_values longest, shortest;
    g_autoptr(Frame) bright = snap(guard, camera, longest_exposure_us(guard), &longest, error);
    g_autoptr(Frame) dim =
        bright ? snap(guard, camera, conf->exposures_us[0], &shortest, error) : NULL;
    if (!dim)
        return FALSE;
    const gboolean sees = longest.mean_dn - seen->dark_dn > LAMP_PART * range_dn(guard, camera);
    seen->any |= sees;
    guard->shines[lamp] |= sees;
    seen->high_dn = MAX(seen->high_dn, longest.high_dn);
    if (shortest.saturated > seen->saturated) {
        seen->saturated = shortest.saturated;
        seen->saturated_by = lamp;
        seen->shorter_us = shortest.saturated > SATURATED_PART ? find_shorter_us(guard, camera) : 0;
    }
    find_fiducials(guard, camera, lamp, longest.saturated > 0 ? dim : bright);
    return TRUE;
}

/* Takes pictures under a lamp. If only_shines is FALSE, all cameras take them, otherwise only as
 * many as are needed until one sees the lamp. */
static gboolean try_lamp(struct guard *guard, int lamp, gboolean only_shines, GError **error) {
    const guint before = guard->fiducials->len;
    guard->n_shots++;
    guard->tried[lamp] = TRUE;
    if (!trial_light(&guard->trial, lamp, TRUE, error))
        return FALSE;
    for (int i = 0; i < guard->trial.n_cameras && !(only_shines && guard->shines[lamp]); i++)
        if (!try_camera(guard, lamp, guard->trial.cameras[i], error))
            return FALSE;
    compare_shot(guard, before);
    return trial_light(&guard->trial, lamp, FALSE, error);
}

static void judge_camera(struct guard *guard, int camera) {
    const struct seen *seen = &guard->seen[camera];
    const struct session_conf *conf = guard->trial.conf;
    const char *name = guard->trial.rig->cameras[camera].name;
    const double longest_us = longest_exposure_us(guard);
    const double reached = (seen->high_dn - seen->dark_dn) / range_dn(guard, camera);
    if (!seen->any) {
        warn(guard,
             "camera %s sees none of the %d lamps that were tried, with exposures of up to %g µs: "
             "is "
             "it covered, and does it look at the sample?",
             name, MIN(guard->trial.n_lamps, TRIAL_FIRST_LAMPS), longest_us);
    } else if (seen->saturated > SATURATED_PART) {
        g_autofree char *to_what =
            seen->shorter_us > 0
                ? g_strdup_printf(", to about %.0f", trial_rounded_us(seen->shorter_us))
                : g_strdup("");
        warn(guard,
             "%.0f %% of camera %s's pixels are saturated at %g µs under lamp %s: shorten "
             "the first of [capture] exposures_us%s",
             100 * seen->saturated, name, conf->exposures_us[0],
             guard->trial.rig->lamps[seen->saturated_by].name, to_what);
    } else if (reached < BRIGHT_PART) {
        warn(guard,
             "camera %s reaches only %.2g %% of its range at %g µs under the brightest lamp: "
             "lengthen the last of [capture] exposures_us, to about %.0f",
             name, 100 * reached, longest_us,
             trial_rounded_us(longest_us * WANTED_PART / MAX(reached, 1e-4)));
    }
}

static void judge_fiducials(struct guard *guard) {
    struct fiducials_check check;
    if (!guard->calibration->parts[CALIBRATION_CAMERAS].done ||
        guard->calibration->rig.n_fiducials == 0)
        return;
    if (guard->fiducials->len == 0) {
        warn(guard,
             "no camera sees a fiducial where the calibration has one: are the fiducials covered, "
             "or was the turntable homed elsewhere? Uncover them, home the turntable again, or "
             "calibrate again");
        return;
    }
    check_fiducials(guard, 0, &check);
    g_autofree char *what = fiducials_describe(&guard->calibration->rig, &check);
    if (fiducials_moved_any(guard->moved) && what)
        warn(guard,
             "something has moved since the rig was calibrated: %s; put it back, or "
             "calibrate again",
             what);
}

/* Adds warnings about the shots up to now. */
static void judge(struct guard *guard) {
    const struct trial *trial = &guard->trial;
    gboolean any = FALSE;
    for (int i = 0; i < trial->n_lamps; i++)
        any |= guard->shines[trial->lamps[i]];
    if (!any) {
        warn(guard,
             "no camera sees any of the %d lamps that were tried: check the lamps' power, the lens "
             "caps, and [capture] exposures_us",
             MIN(trial->n_lamps, TRIAL_FIRST_LAMPS));
        return;
    }
    for (int i = 0; i < trial->n_lamps; i++) {
        const int l = trial->lamps[i];
        if (guard->tried[l] && !guard->shines[l])
            warn(guard,
                 "lamp %s changes no camera's picture: check the lamp, its fuse and its "
                 "relay",
                 trial->rig->lamps[l].name);
    }
    for (int i = 0; i < trial->n_cameras; i++)
        judge_camera(guard, trial->cameras[i]);
    judge_fiducials(guard);
}

GPtrArray *guard_try(Link *link, const struct session_conf *conf, const struct rig *rig,
                     const struct calibration *calibration, int *ret_shots, GError **error) {
    g_autoptr(GPtrArray) warnings = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GArray) fiducials = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
    struct guard guard = {.calibration = calibration, .warnings = warnings, .fiducials = fiducials};
    trial_init(&guard.trial, link, conf, rig);
    const struct trial *trial = &guard.trial;
    const int n_first = MIN(trial->n_lamps, TRIAL_FIRST_LAMPS);
    *ret_shots = 0;
    if (trial->n_cameras == 0 || trial->n_lamps == 0) /* the plan reports what is missing */
        return g_steal_pointer(&warnings);
    judge_calibration(&guard);
    const guint n_before = warnings->len;
    gboolean ok = trial_pose(trial, FALSE, &guard.arc_deg, error) && take_darks(&guard, error);
    for (int i = 0; i < n_first && ok; i++)
        ok = try_lamp(&guard, trial->lamps[i], FALSE, error);
    if (ok)
        judge(&guard);
    /* The remaining lamps may be dead, which the first five shots cannot show. Each is therefore
     * tried until one camera sees it. Pictures of all pairs of lamp and camera would take too
     * long. */
    const gboolean rest = warnings->len == n_before;
    for (int i = n_first; i < trial->n_lamps && rest && ok; i++) {
        const int l = trial->lamps[i];
        ok = try_lamp(&guard, l, TRUE, error);
        if (ok && !guard.shines[l])
            warn(&guard,
                 "lamp %s changes no camera's picture: check the lamp, its fuse and its "
                 "relay",
                 rig->lamps[l].name);
    }
    *ret_shots = guard.n_shots;
    return ok ? g_steal_pointer(&warnings) : NULL;
}
