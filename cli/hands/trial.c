#include "trial.h"

#include <math.h>
#include <string.h>

#include "geometry/rig.h"
#include "hand_link.h"

/* Maximum difference between the polar angle of a camera, lamp or laser and that of the ring to
 * which it belongs. The plan has the same limit. */
#define TOLERANCE_DEG 0.5

static gboolean is_planned(const struct ring *rings, int n, char **devices, const char *name,
                           struct vec3 position_mm) {
    double theta_rad, phi_rad;
    gboolean planned = FALSE;
    if (devices)
        return g_strv_contains((const char *const *)devices, name) ||
               g_strv_contains((const char *const *)devices, "all");
    rig_angles(position_mm, &theta_rad, &phi_rad);
    for (int i = 0; i < n; i++)
        planned |= fabs(theta_rad * 180 / G_PI - rings[i].theta_deg) <= TOLERANCE_DEG;
    return planned;
}

/* Returns the irradiance of a lamp at the middle of the sample, in W·m⁻². */
static double irradiance(const struct rig *rig, int lamp) {
    const struct vec3 at = rig_lamp_position_mm(NULL, &rig->lamps[lamp], 0);
    return rig_lamp_irradiance(NULL, &rig->lamps[lamp], 0, vec3(0, 0, 0)) * at.z /
           sqrt(at.x * at.x + at.y * at.y + at.z * at.z);
}

static int by_irradiance(gconstpointer a, gconstpointer b, gpointer rig) {
    const double x = irradiance(rig, *(const int *)a);
    const double y = irradiance(rig, *(const int *)b);
    return x != y ? (x < y) - (x > y) : *(const int *)a - *(const int *)b;
}

/* Sorts the lamps: the brightest, the dimmest, those at one third and two thirds of the order by
 * brightness, then all others. */
static void sort_lamps(struct trial *trial) {
    const int n = trial->n_lamps, firsts[TRIAL_FIRST_LAMPS] = {0, n - 1, n / 3, 2 * n / 3};
    int sorted[RIG_MAX_LAMPS], k = 0;
    gboolean used[RIG_MAX_LAMPS] = {0};
    if (n <= TRIAL_FIRST_LAMPS)
        return;
    memcpy(sorted, trial->lamps, sizeof sorted);
    g_qsort_with_data(sorted, n, sizeof *sorted, by_irradiance, (gpointer)trial->rig);
    for (; k < TRIAL_FIRST_LAMPS; k++) {
        trial->lamps[k] = sorted[firsts[k]];
        used[firsts[k]] = TRUE;
    }
    for (int i = 0; i < n; i++)
        if (!used[i])
            trial->lamps[k++] = sorted[i];
}

void trial_init(struct trial *trial, Link *link, const struct session_conf *conf,
                const struct rig *rig) {
    *trial = (struct trial){.link = link, .conf = conf, .rig = rig};
    for (int c = 0; c < rig->n_cameras; c++)
        if (is_planned(conf->views, conf->n_views, conf->views_of, rig->cameras[c].name,
                       rig_camera_centre_mm(&rig->cameras[c])))
            trial->cameras[trial->n_cameras++] = c;
    for (int l = 0; l < rig->n_lamps; l++)
        if (is_planned(conf->lights, conf->n_lights, conf->lights_of, rig->lamps[l].name,
                       rig->lamps[l].position_mm))
            trial->lamps[trial->n_lamps++] = l;
    for (int l = 0; l < rig->n_lasers; l++)
        if (is_planned(conf->lasers, conf->n_lasers, conf->lasers_of, rig->lasers[l].name,
                       rig->lasers[l].position_mm))
            trial->lasers[trial->n_lasers++] = l;
    sort_lamps(trial);
}

/* Returns an azimuth of a ring, with the turntable at 0. Of all planned azimuths, it is the one
 * that is farthest from all cameras. */
static double free_azimuth_deg(const struct rig *rig, const struct ring *ring) {
    double best_deg = ring->offset_deg, farthest_deg = -1;
    for (int k = 0; k < ring->count; k++) {
        const double deg = ring->offset_deg + 360.0 * k / ring->count;
        double nearest_deg = 180;
        for (int c = 0; c < rig->n_cameras; c++) {
            const struct vec3 at = rig_camera_centre_mm(&rig->cameras[c]);
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

gboolean trial_pose(const struct trial *trial, gboolean lasers, double *ret_arc_deg,
                    GError **error) {
    g_autoptr(GVariant) devices = bus_rig1_dup_devices(link_rig(trial->link));
    const struct ring *ring = lasers ? trial->conf->lasers : trial->conf->lights;
    const char *class_name, *name, *driver, *health;
    GVariantIter iter;
    double deg;
    *ret_arc_deg = 0;
    if (!devices)
        return TRUE;
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health)) {
        static const char *const homed[] = {"turntable", "arc", "arm", "probe", NULL};
        const gboolean arc = strcmp(name, "arc") == 0;
        if (strcmp(class_name, "axis") != 0 || !g_strv_contains(homed, name))
            continue;
        if (!hand_home(trial->link, name, &deg, error) ||
            (arc && !hand_move(trial->link, name, free_azimuth_deg(trial->rig, ring), &deg, error)))
            return FALSE;
        if (arc)
            *ret_arc_deg = deg;
    }
    return TRUE;
}

Frame *trial_snap(const struct trial *trial, int camera, double exposure_us, gboolean dark,
                  GError **error) {
    const struct rig_camera *at = &trial->rig->cameras[camera];
    char device[RIG_NAME];
    double deg;

    rig_stop_device(at->name, at->on_arm, device);
    if (at->on_arm && !dark && !hand_move(trial->link, "arm", at->arm_deg, &deg, error))
        return NULL;
    return hand_snap(trial->link, device, llround(exposure_us), trial->conf->gain_db, error);
}

gboolean trial_light(const struct trial *trial, int lamp, gboolean on, GError **error) {
    const struct rig_lamp *at = &trial->rig->lamps[lamp];
    char device[RIG_NAME];
    double deg;

    rig_stop_device(at->name, at->on_probe, device);
    return (!on || !at->on_probe || hand_move(trial->link, "probe", at->probe_deg, &deg, error)) &&
           hand_light(trial->link, FALSE, device, on, error);
}

double trial_rounded_us(double us) {
    const double step = pow(10, floor(log10(MAX(us, 1))) - 1);
    return round(us / step) * step;
}
