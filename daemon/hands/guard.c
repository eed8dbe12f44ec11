#include "guard.h"

#include <math.h>
#include <string.h>

#include "geometry/rig.h"
#include "hand_link.h"
#include "picture_report.h"

#define LONG_PICTURES 500
/* Part of a camera's pixels that may be saturated at the shortest exposure; a few highlights may.
 */
#define SATURATED_PART 0.05
/* Part of the range that the 99th percentile reaches at the longest exposure under the brightest
 * lamp, at least; and that a suggested exposure is to reach. */
#define BRIGHT_PART 0.05
#define WANTED_PART 0.5
/* Part of the range by which a lamp raises the mean of a picture that sees it. */
#define LAMP_PART 0.0005
/* A saturated picture is taken again with an exposure shorter by this factor, to find one that is
 * short enough. */
#define SHORTER 32

struct seen { /* by a camera, of all lamps */
    int dark_of, bits;
    double dark_dn;
    double high_dn;   /* highest 99th percentile at the longest exposure */
    double saturated; /* largest part at the shortest exposure */
    int saturated_by; /* that lamp */
    gboolean any;     /* it sees a lamp */
};

struct guard {
    Link *link;
    const struct session_conf *conf;
    const struct rig *rig;
    GPtrArray *warnings;
    struct seen seen[RIG_MAX_CAMERAS];
    gboolean shines[RIG_MAX_LAMPS];
};

static int count_directions(const struct ring *rings, int n) {
    int sum = 0;
    for (int i = 0; i < n; i++)
        sum += rings[i].count;
    return sum;
}

gboolean guard_is_worth_it(const struct session_conf *conf) {
    return conf->n_exposures > 0 && count_directions(conf->views, conf->n_views) *
                                            count_directions(conf->lights, conf->n_lights) >=
                                        LONG_PICTURES;
}

static gboolean guard_snap(struct guard *guard, int camera, double exposure_us,
                           struct picture_report *ret, GError **error) {
    g_autoptr(Frame) frame = hand_snap(guard->link, guard->rig->cameras[camera].name,
                                       llround(exposure_us), guard->conf->gain_db, error);
    if (!frame)
        return FALSE;
    guard->seen[camera].bits = frame->bits;
    *ret = picture_report(frame);
    return TRUE;
}

static double range_dn(const struct guard *guard, int camera) {
    return (1 << guard->seen[camera].bits) - 1;
}

/* The planned azimuth of a light, with the turntable at 0, that is farthest from all cameras. */
static double free_azimuth_deg(const struct guard *guard) {
    const struct ring *ring = &guard->conf->lights[0];
    double best_deg = ring->offset_deg, farthest_deg = -1;
    for (int k = 0; k < ring->count; k++) {
        const double deg = ring->offset_deg + 360.0 * k / ring->count;
        double nearest_deg = 180;
        for (int c = 0; c < guard->rig->n_cameras; c++) {
            const struct vec3 at = rig_camera_centre_mm(&guard->rig->cameras[c]);
            const double phi_deg = atan2(at.y, at.x) * 180 / G_PI;
            nearest_deg = MIN(nearest_deg, fabs(remainder(deg - phi_deg, 360)));
        }
        if (nearest_deg > farthest_deg) {
            farthest_deg = nearest_deg;
            best_deg = deg;
        }
    }
    return best_deg;
}

/* Moves the arc to where it stands in no picture; an axis that the rig lacks is left out. */
static gboolean guard_pose(struct guard *guard, GError **error) {
    GVariant *devices = bus_rig1_get_devices(link_rig(guard->link));
    const char *class_name, *name, *driver, *health;
    GVariantIter iter;
    double deg;
    if (!devices)
        return TRUE;
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health)) {
        const gboolean arc = strcmp(name, "arc") == 0, table = strcmp(name, "turntable") == 0;
        if (strcmp(class_name, "axis") != 0 || (!arc && !table))
            continue;
        if (!hand_home(guard->link, name, &deg, error) ||
            (arc && !hand_move(guard->link, name, free_azimuth_deg(guard), &deg, error)))
            return FALSE;
    }
    return TRUE;
}

static gboolean take_darks(struct guard *guard, GError **error) {
    for (int c = 0; c < guard->rig->n_cameras; c++) {
        struct picture_report report;
        if (!guard_snap(guard, c, guard->conf->exposures_us[guard->conf->n_exposures - 1], &report,
                        error))
            return FALSE;
        guard->seen[c].dark_dn = report.mean_dn;
    }
    return TRUE;
}

static gboolean try_lamp(struct guard *guard, int lamp, GError **error) {
    const struct session_conf *conf = guard->conf;
    const char *name = guard->rig->lamps[lamp].name;
    if (!hand_light(guard->link, FALSE, name, TRUE, error))
        return FALSE;
    for (int c = 0; c < guard->rig->n_cameras; c++) {
        struct seen *seen = &guard->seen[c];
        struct picture_report longest, shortest;
        if (!guard_snap(guard, c, conf->exposures_us[conf->n_exposures - 1], &longest, error) ||
            !guard_snap(guard, c, conf->exposures_us[0], &shortest, error))
            return FALSE;
        const gboolean sees = longest.mean_dn - seen->dark_dn > LAMP_PART * range_dn(guard, c);
        seen->any |= sees;
        guard->shines[lamp] |= sees;
        seen->high_dn = MAX(seen->high_dn, longest.high_dn);
        if (shortest.saturated > seen->saturated) {
            seen->saturated = shortest.saturated;
            seen->saturated_by = lamp;
        }
    }
    return hand_light(guard->link, FALSE, name, FALSE, error);
}

/* To two digits: more is not known. */
static double rounded(double us) {
    const double step = pow(10, floor(log10(MAX(us, 1))) - 1);
    return round(us / step) * step;
}

/* How long a saturated camera should expose; 0: that is not known. */
static gboolean suggest_shorter(struct guard *guard, int camera, double *ret_us, GError **error) {
    const struct seen *seen = &guard->seen[camera];
    const char *lamp = guard->rig->lamps[seen->saturated_by].name;
    const double us = MAX(guard->conf->exposures_us[0] / SHORTER, 1);
    struct picture_report report = {0};
    *ret_us = 0;
    if (!hand_light(guard->link, FALSE, lamp, TRUE, error))
        return FALSE;
    g_autoptr(GError) why = NULL; /* it may be shorter than the camera can */
    const gboolean taken = guard_snap(guard, camera, us, &report, &why);
    const double above_dn = report.high_dn - seen->dark_dn;
    if (taken && report.saturated < SATURATED_PART && above_dn > 1)
        *ret_us = us * WANTED_PART * range_dn(guard, camera) / above_dn;
    return hand_light(guard->link, FALSE, lamp, FALSE, error);
}

static gboolean judge_camera(struct guard *guard, int camera, GError **error) {
    const struct seen *seen = &guard->seen[camera];
    const struct session_conf *conf = guard->conf;
    const char *name = guard->rig->cameras[camera].name;
    const double longest_us = conf->exposures_us[conf->n_exposures - 1];
    const double reached = (seen->high_dn - seen->dark_dn) / range_dn(guard, camera);
    GPtrArray *to = guard->warnings;
    if (!seen->any) {
        g_ptr_array_add(to, g_strdup_printf("camera %s sees none of the %d lamps, at %g µs: is it "
                                            "covered, and does it look at the sample?",
                                            name, guard->rig->n_lamps, longest_us));
        return TRUE;
    }
    if (seen->saturated > SATURATED_PART) {
        double us;
        if (!suggest_shorter(guard, camera, &us, error))
            return FALSE;
        g_autofree char *to_what =
            us > 0 ? g_strdup_printf(", to about %.0f", rounded(us)) : g_strdup("");
        g_ptr_array_add(to, g_strdup_printf("%.0f %% of camera %s's pixels are saturated at %g µs "
                                            "under lamp %s: shorten the first of [capture] "
                                            "exposures_us%s",
                                            100 * seen->saturated, name, conf->exposures_us[0],
                                            guard->rig->lamps[seen->saturated_by].name, to_what));
    } else if (reached < BRIGHT_PART) {
        g_ptr_array_add(to,
                        g_strdup_printf("camera %s reaches only %.2g %% of its range at %g µs "
                                        "under the brightest lamp: lengthen the last of "
                                        "[capture] exposures_us, to about %.0f",
                                        name, 100 * reached, longest_us,
                                        rounded(longest_us * WANTED_PART / MAX(reached, 1e-4))));
    }
    return TRUE;
}

static gboolean judge(struct guard *guard, GError **error) {
    gboolean any = FALSE, ok = TRUE;
    for (int l = 0; l < guard->rig->n_lamps; l++)
        any |= guard->shines[l];
    if (!any) {
        g_ptr_array_add(guard->warnings,
                        g_strdup("no camera sees any lamp: check the lamps' power, the lens caps, "
                                 "and [capture] exposures_us"));
        return TRUE;
    }
    for (int l = 0; l < guard->rig->n_lamps; l++)
        if (!guard->shines[l])
            g_ptr_array_add(guard->warnings,
                            g_strdup_printf("lamp %s changes no camera's picture: check the lamp, "
                                            "its fuse and its relay",
                                            guard->rig->lamps[l].name));
    for (int c = 0; c < guard->rig->n_cameras && ok; c++)
        ok = judge_camera(guard, c, error);
    return ok;
}

GPtrArray *guard_try(Link *link, const struct session_conf *conf, const struct rig *rig,
                     GError **error) {
    g_autoptr(GPtrArray) warnings = g_ptr_array_new_with_free_func(g_free);
    struct guard guard = {.link = link, .conf = conf, .rig = rig, .warnings = warnings};
    gboolean ok = guard_pose(&guard, error) && take_darks(&guard, error);
    for (int l = 0; l < rig->n_lamps && ok; l++)
        ok = try_lamp(&guard, l, error);
    return ok && judge(&guard, error) ? g_steal_pointer(&warnings) : NULL;
}
