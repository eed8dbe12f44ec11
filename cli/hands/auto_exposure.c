#include "auto_exposure.h"

#include <math.h>

#include "hand_link.h"
#include "rig/devices.h"
#include "trial.h"

#define FIRST_US     4000
#define MAX_PICTURES 10 /* maximum number of pictures of one camera under one light */
/* Parts of a camera's range above black that the brightest pixels of a picture (…_HIGH) or many of
 * its pixels (…_LOW) must reach (auto_exposure.h). */
#define LAMP_HIGH 0.7
#define LAMP_LOW  0.2
/* If LAMP_LOW cannot be reached in the dimmest picture, this part is sufficient. */
#define LAMP_MIN  0.05
#define LINE_LOW  0.05
#define LINE_HIGH 0.7
#define FULL_PART 0.95 /* a picture that reaches this counts as saturated */
/* A picture whose brightest pixels reach this part suffices to compute other exposures. */
#define TELLING_PART 0.1
#define NOTHING_PART 0.0005
#define MAX_RATIO    (AUTO_MAX_FACTOR * AUTO_MAX_FACTOR)
#define LINE_RATIO   64 /* maximum ratio of laser_exposure_us to laser_short_us */
#define LINE_LASERS  2
#define LINE_PLACES  3

struct measured { /* the measurement of a camera under a light */
    int camera;
    const char *light;
    /* Values per microsecond, as parts of the range. `high` is the value that only a few pixels
     * reach. `low` is the lower value that many pixels reach. */
    double high, low;
    /* The picture is saturated even at the camera's shortest exposure. The true value of `high` is
     * then larger. */
    gboolean full;
};

struct choice {
    struct trial trial;
    const struct rig_timing *timing;
    double dark[RIG_MAX_CAMERAS]; /* dark signal per microsecond, as a part of the range */
    double arc_deg;
    GArray *lamps, *lines; /* of struct measured */
};

/* Returns the largest value in DN that at least n pixels reach. Returns 0 if fewer than n pixels
 * are above 0. */
static int value_of(const Frame *frame, gsize n) {
    const gsize pixels = (gsize)frame->width * (gsize)frame->height;
    const int top = (1 << frame->bits) - 1;
    g_autofree gsize *counts = g_new0(gsize, top + 1);
    gsize above = 0;
    int dn = top;
    for (gsize i = 0; i < pixels; i++)
        counts[MIN(frame->pixels[i], top)]++;
    for (; dn > 0; dn--)
        if ((above += counts[dn]) >= n)
            break;
    return dn;
}

/* Returns the largest value that at least n pixels reach. The value has black and dark current
 * subtracted, and is a part of the range above black. */
static double part_of(const struct choice *choice, int camera, const Frame *frame, gsize n) {
    const double range_dn = (1 << frame->bits) - 1 - frame->black_level;
    return (value_of(frame, n) - frame->black_level) / range_dn -
           choice->dark[camera] * (double)frame->exposure_us;
}

static gint64 least_us(const struct choice *choice, int camera) {
    return MAX(choice->timing->min_exposure_us[camera], 1);
}

/* Searches for an exposure at which the picture is neither saturated nor dark. The search begins
 * with *us, and *us is set to the result. `line` is TRUE for a laser's line.
 *
 * ret->high is the value per microsecond that n_high pixels reach, and ret->low is the value that
 * n_low pixels reach. Both values are 0 if there is no light. Returns FALSE with an error if a
 * device has failed. */
static gboolean measure(const struct choice *choice, int camera, const char *light, gboolean line,
                        double *us, struct measured *ret, GError **error) {
    const struct rig_camera *shape = &choice->trial.rig->cameras[camera];
    const double pixels = (double)shape->width * shape->height;
    const gsize side = (gsize)MAX(shape->width, shape->height);
    const gsize n_high =
        line ? MAX(side / 100, 2) : (gsize)MAX(pixels * choice->trial.conf->saturated_pct / 100, 1);
    const gsize n_low = line ? MAX(side / 2, 1) : (gsize)MAX(pixels / 100, 1);
    const double longest_us = choice->trial.conf->auto_longest_us;
    const double shortest_us = (double)least_us(choice, camera);
    *ret = (struct measured){.camera = camera, .light = light};
    for (int i = 0; i < MAX_PICTURES; i++) {
        *us = CLAMP(*us, shortest_us, MAX(longest_us, shortest_us));
        g_autoptr(Frame) frame = trial_snap(&choice->trial, camera, *us, FALSE, error);
        if (!frame)
            return FALSE;
        const double high = part_of(choice, camera, frame, n_high);
        const double low = part_of(choice, camera, frame, n_low);
        const double range_dn = (1 << frame->bits) - 1 - frame->black_level;
        const gboolean full = high + choice->dark[camera] * (double)frame->exposure_us >= FULL_PART;
        ret->high = high / (double)frame->exposure_us;
        ret->low = low / (double)frame->exposure_us;
        ret->full = full;
        if (full && *us > shortest_us)
            *us /= 8;
        else if (!full && high < TELLING_PART && *us < longest_us)
            *us *= high > TELLING_PART / 8 ? 0.5 / high : 8;
        else if (!full && high < MAX(NOTHING_PART, 8 / range_dn))
            ret->high = ret->low = 0; /* the picture contains only noise */
        else
            break;
        if (ret->high == 0)
            break;
    }
    return TRUE;
}

static gboolean take_dark(struct choice *choice, GError **error) {
    for (int i = 0; i < choice->trial.n_cameras; i++) {
        const int c = choice->trial.cameras[i];
        const struct rig_camera *shape = &choice->trial.rig->cameras[c];
        g_autoptr(Frame) frame =
            trial_snap(&choice->trial, c, choice->trial.conf->auto_longest_us, TRUE, error);
        if (!frame)
            return FALSE;
        choice->dark[c] =
            MAX(part_of(choice, c, frame, (gsize)shape->width * (gsize)shape->height / 2), 0) /
            (double)frame->exposure_us;
    }
    return TRUE;
}

static gboolean measure_cameras(struct choice *choice, const char *light, gboolean line, double *us,
                                GArray *to, GError **error) {
    for (int i = 0; i < choice->trial.n_cameras; i++) {
        struct measured measured;
        if (!measure(choice, choice->trial.cameras[i], light, line, us, &measured, error))
            return FALSE;
        if (measured.high > 0)
            g_array_append_val(to, measured);
    }
    return TRUE;
}

static gboolean try_lamps(struct choice *choice, GError **error) {
    const struct trial *trial = &choice->trial;
    double us = FIRST_US;
    if (!trial_pose(trial, FALSE, &choice->arc_deg, error))
        return FALSE;
    for (int i = 0; i < MIN(trial->n_lamps, TRIAL_FIRST_LAMPS); i++) {
        const char *name = trial->rig->lamps[trial->lamps[i]].name;
        if (!trial_light(trial, trial->lamps[i], TRUE, error) ||
            !measure_cameras(choice, name, FALSE, &us, choice->lamps, error) ||
            !trial_light(trial, trial->lamps[i], FALSE, error))
            return FALSE;
    }
    return TRUE;
}

/* Measures a laser's line at several places of the sample, as in a sweep. `sweep` is the name of
 * the axis that turns the laser. */
static gboolean try_laser(struct choice *choice, int laser, const char *sweep, double *us,
                          GError **error) {
    const struct trial *trial = &choice->trial;
    const char *name = trial->rig->lasers[laser].name;
    double from_deg, to_deg, deg;
    plan_sweep_deg(trial->conf, trial->rig, laser, 0, choice->arc_deg, &from_deg, &to_deg);
    if (!hand_home(trial->link, sweep, &deg, error))
        return FALSE;
    for (int i = 0; i < LINE_PLACES; i++) {
        const double at_deg = from_deg + (to_deg - from_deg) * (i + 1) / (LINE_PLACES + 1);
        if (!hand_move(trial->link, sweep, at_deg, &deg, error) ||
            (i == 0 && !hand_light(trial->link, TRUE, name, TRUE, error)) ||
            !measure_cameras(choice, name, TRUE, us, choice->lines, error))
            return FALSE;
    }
    return hand_light(trial->link, TRUE, name, FALSE, error);
}

static gboolean try_lasers(struct choice *choice, const char *rig_path, GError **error) {
    const struct trial *trial = &choice->trial;
    g_autoptr(Config) config = config_load(rig_path, error);
    int usable[RIG_MAX_LASERS], n = 0;
    double us = FIRST_US;
    if (!config || !trial_pose(trial, TRUE, &choice->arc_deg, error))
        return FALSE;
    for (int i = 0; i < trial->n_lasers; i++) {
        const int l = trial->lasers[i];
        if (choice->timing->mounts[rig_laser_unit(choice->timing, l)] == 0)
            usable[n++] = l;
    }
    if (trial->n_lasers > 0 && n == 0)
        g_set_error_literal(error, PLAN_ERROR, PLAN_ERROR_LIMITS,
                            "[capture] laser_exposure_us and laser_short_us cannot be auto: every "
                            "laser is mounted by hand; give their values");
    if (n == 0)
        return trial->n_lasers == 0;
    for (int i = 0; i < MIN(n, LINE_LASERS); i++) {
        const int l = usable[i == 0 ? 0 : n - 1];
        const struct config_section *section =
            config_find(config, "laser", trial->rig->lasers[l].name);
        const char *sweep = section ? config_value(section, "sweep", NULL) : NULL;
        if (sweep && !try_laser(choice, l, sweep, &us, error))
            return FALSE;
    }
    return TRUE;
}

/* Returns the measurement with the largest `high` or, if brightest is FALSE, with the smallest
 * `low`. Returns NULL if nothing was measured. */
static const struct measured *extreme(const GArray *all, gboolean brightest) {
    const struct measured *found = NULL;
    for (guint i = 0; i < all->len; i++) {
        const struct measured *m = &g_array_index(all, struct measured, i);
        if (!found || (brightest ? m->high > found->high : m->low < found->low))
            found = m;
    }
    return found;
}

static const char *name_of(const struct choice *choice, const struct measured *measured) {
    return choice->trial.rig->cameras[measured->camera].name;
}

/* Returns the shortest exposure that is possible with all cameras of the session's plan. */
static double common_us(const struct choice *choice) {
    gint64 us = 1;
    for (int i = 0; i < choice->trial.n_cameras; i++)
        us = MAX(us, least_us(choice, choice->trial.cameras[i]));
    return (double)us;
}

/* Checks the ends of the range of exposures. The brightest picture allows an exposure of at most
 * shortest_us for the shortest, and the dimmest picture needs at least needed_us for the longest.
 * Returns FALSE with an error that names the key to change in three cases:
 * - the brightest picture saturates at the shortest exposure that is possible with all cameras,
 * - needed_us is above auto_longest_us,
 * - needed_us is above max_ratio · shortest_us. */
static gboolean check_ends(const struct choice *choice, const struct measured *brightest,
                           const struct measured *dimmest, const char *key, double shortest_us,
                           double needed_us, double max_ratio, GError **error) {
    const struct session_conf *conf = choice->trial.conf;
    const double min_us = common_us(choice);
    if (brightest->full || brightest->high * MAX(shortest_us, min_us) > FULL_PART)
        plan_set_error(error, PLAN_ERROR_LIMITS, conf, "capture", key,
                       "camera %s saturates under %s even at %.0f µs, the shortest "
                       "exposure that all cameras have: dim the light, close the aperture, or "
                       "lower [capture] gain_db",
                       name_of(choice, brightest), brightest->light, min_us);
    else if (needed_us > conf->auto_longest_us)
        plan_set_error(
            error, PLAN_ERROR_LIMITS, conf, "capture", "auto_longest_us",
            "camera %s needs %.0f µs under %s, but “%s = auto” may choose %g µs at most: raise "
            "auto_longest_us, open the aperture, or raise gain_db",
            name_of(choice, dimmest), ceil(needed_us), dimmest->light, key, conf->auto_longest_us);
    else if (needed_us > max_ratio * shortest_us)
        plan_set_error(
            error, PLAN_ERROR_LIMITS, conf, "capture", key,
            "camera %s may expose for %.0f µs at most under %s, and camera %s needs %.0f µs "
            "under %s: exposures may be %g times apart at most. Bring their apertures "
            "together, or give the exposures yourself",
            name_of(choice, brightest), shortest_us, brightest->light, name_of(choice, dimmest),
            ceil(needed_us), dimmest->light, max_ratio);
    else
        return TRUE;
    return FALSE;
}

/* Returns the exposure in µs that reaches the wanted part of the range. part_a_us is the part of
 * the range that the light reaches per microsecond. Returns ∞ if there is no light, which means
 * part_a_us ≤ 0. */
static double exposure_for(double wanted, double part_a_us) {
    return part_a_us > 0 ? wanted / part_a_us : INFINITY;
}

static gboolean refuse_dark(const struct choice *choice, const char *what, const char *key,
                            GError **error) {
    plan_set_error(
        error, PLAN_ERROR_LIMITS, choice->trial.conf, "capture", key,
        "cannot be chosen: no camera sees %s at %g µs, the longest that auto_longest_us allows: "
        "check the power of the light, the lens caps, and that the sample is in view",
        what, choice->trial.conf->auto_longest_us);
    return FALSE;
}

static gboolean choose_lamps(const struct choice *choice, GString *to, GError **error) {
    const struct measured *brightest = extreme(choice->lamps, TRUE);
    const struct measured *dimmest = extreme(choice->lamps, FALSE);
    const double max_us = choice->trial.conf->auto_longest_us;
    if (!brightest)
        return refuse_dark(choice, "a lamp", auto_key_names[AUTO_EXPOSURES], error);
    const double shortest_us = MIN(LAMP_HIGH / brightest->high, max_us / AUTO_FACTOR);
    if (!check_ends(choice, brightest, dimmest, auto_key_names[AUTO_EXPOSURES], shortest_us,
                    exposure_for(LAMP_MIN, dimmest->low), MAX_RATIO, error))
        return FALSE;
    const double longest_us = CLAMP(exposure_for(LAMP_LOW, dimmest->low), AUTO_FACTOR * shortest_us,
                                    MIN(MAX_RATIO * shortest_us, max_us));
    const int n = longest_us > AUTO_FACTOR * shortest_us * 1.01 ? AUTO_MAX_EXPOSURES : 2;
    const double min_us = common_us(choice);
    g_string_append_printf(to, "%s = ", auto_key_names[AUTO_EXPOSURES]);
    for (int i = 0; i < n; i++) {
        const double us = shortest_us * pow(longest_us / shortest_us, (double)i / (n - 1));
        g_string_append_printf(to, "%s%.0f", i ? "; " : "",
                               MIN(MAX(trial_rounded_us(us), min_us), max_us));
    }
    g_string_append_c(to, '\n');
    return TRUE;
}

static gboolean choose_lines(const struct choice *choice, GString *to, GError **error) {
    const struct session_conf *conf = choice->trial.conf;
    const struct measured *brightest = extreme(choice->lines, TRUE);
    const struct measured *dimmest = extreme(choice->lines, FALSE);
    const gboolean may_short = conf->is_auto[AUTO_SHORT] || conf->laser_short_us > 0;
    const char *key = auto_key_names[conf->is_auto[AUTO_LASER] ? AUTO_LASER : AUTO_SHORT];
    if (!brightest)
        return refuse_dark(choice, "a laser's line", key, error);
    double shortest_us = LINE_HIGH / brightest->high, long_us = conf->laser_exposure_us;
    /* The line must reach twice the threshold from which its brightness counts. */
    const double range_dn = (1 << choice->timing->bits[dimmest->camera]) - 1;
    const double least = 2 * conf->laser_threshold_dn / range_dn;
    const double needed_us = exposure_for(least, dimmest->low);
    if (conf->is_auto[AUTO_LASER]) {
        /* If no short exposure is allowed, this exposure must not saturate. */
        const double max_us = may_short ? LINE_RATIO * shortest_us : FULL_PART / brightest->high;
        if (!check_ends(choice, brightest, dimmest, key, shortest_us, needed_us,
                        max_us / shortest_us, error))
            return FALSE;
        long_us = MIN(exposure_for(MAX(LINE_LOW, least), dimmest->low),
                      MIN(max_us, conf->auto_longest_us));
        long_us = MAX(trial_rounded_us(long_us), common_us(choice));
        if (!conf->is_auto[AUTO_SHORT] && long_us <= conf->laser_short_us) {
            plan_set_error(error, PLAN_ERROR_LIMITS, conf, "capture", "laser_short_us",
                           "%g µs is not shorter than the %g µs chosen for laser_exposure_us: set "
                           "laser_short_us = auto, or a shorter one",
                           conf->laser_short_us, long_us);
            return FALSE;
        }
        g_string_append_printf(to, "%s = %.0f\n", auto_key_names[AUTO_LASER], long_us);
    }
    if (!conf->is_auto[AUTO_SHORT])
        return TRUE;
    const gboolean saturates = brightest->high * long_us >= FULL_PART;
    if (saturates && !check_ends(choice, brightest, dimmest, auto_key_names[AUTO_SHORT],
                                 shortest_us, MIN(needed_us, long_us), LINE_RATIO, error))
        return FALSE;
    shortest_us = MAX(trial_rounded_us(shortest_us), common_us(choice));
    g_string_append_printf(to, "%s = %.0f\n", auto_key_names[AUTO_SHORT],
                           saturates ? shortest_us : 0);
    return TRUE;
}

char *auto_exposure_choose(Link *link, const struct session_conf *conf, const char *rig_path,
                           GError **error) {
    g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GArray) lamps = g_array_new(FALSE, FALSE, sizeof(struct measured));
    g_autoptr(GArray) lines = g_array_new(FALSE, FALSE, sizeof(struct measured));
    g_autoptr(GString) chosen = g_string_new(NULL);
    struct rig rig;
    struct rig_timing timing;
    struct choice choice = {.timing = &timing, .lamps = lamps, .lines = lines};
    const gboolean want_lamps = conf->is_auto[AUTO_EXPOSURES];
    const gboolean want_lines = conf->is_auto[AUTO_LASER] || conf->is_auto[AUTO_SHORT];
    if (!want_lamps && !want_lines)
        return g_strdup("");
    if (!devices_read_timing(rig_path, &rig, &timing, assumed, error))
        return NULL;
    trial_init(&choice.trial, link, conf, &rig);
    if (!take_dark(&choice, error))
        return NULL;
    /* If the session has no lamps or no lasers, their exposure has no effect. The value that stands
     * for "auto" is used. */
    if (want_lamps && choice.trial.n_lamps == 0)
        g_string_append_printf(chosen, "%s = %.0f\n", auto_key_names[AUTO_EXPOSURES],
                               conf->exposures_us[0]);
    else if (want_lamps && (!try_lamps(&choice, error) || !choose_lamps(&choice, chosen, error)))
        return NULL;
    if (want_lines && choice.trial.n_lasers > 0) {
        if (!try_lasers(&choice, rig_path, error) || !choose_lines(&choice, chosen, error))
            return NULL;
    } else if (want_lines) {
        if (conf->is_auto[AUTO_LASER])
            g_string_append_printf(chosen, "%s = %.0f\n", auto_key_names[AUTO_LASER],
                                   conf->laser_exposure_us);
        if (conf->is_auto[AUTO_SHORT])
            g_string_append_printf(chosen, "%s = 0\n", auto_key_names[AUTO_SHORT]);
    }
    return g_string_free(g_steal_pointer(&chosen), FALSE);
}
