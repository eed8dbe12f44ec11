#include "plan_private.h"

#define DEG(rad)            ((rad) * (180 / G_PI))
#define RAD(deg)            ((deg) * (G_PI / 180))
#define THETA_TOLERANCE_DEG 0.5

/* The position of a camera in the rig, or of a lamp or laser with the arc at 0. */
struct stand {
    const char *name;
    double theta_deg;
    gint64 phi_udeg;
};

gint64 plan_wrap(gint64 udeg) {
    return (udeg % PLAN_FULL_TURN + PLAN_FULL_TURN) % PLAN_FULL_TURN;
}

gboolean plan_axis_reach(const struct axis_motion *motion, gint64 udeg, gint64 *ret_udeg) {
    gint64 min = (gint64)ceil(motion->min_deg * UDEG - 0.5);
    gint64 max = (gint64)floor(motion->max_deg * UDEG + 0.5);
    gint64 up = plan_wrap(udeg), down = up - PLAN_FULL_TURN;

    if (motion->wraps) {
        *ret_udeg = up;
        return TRUE;
    }
    if (up < min)
        up += (min - up + PLAN_FULL_TURN - 1) / PLAN_FULL_TURN * PLAN_FULL_TURN;
    if (down > max)
        down -= (down - max + PLAN_FULL_TURN - 1) / PLAN_FULL_TURN * PLAN_FULL_TURN;
    gboolean up_fits = up <= max, down_fits = down >= min;
    *ret_udeg = up_fits && (!down_fits || ABS(up) <= ABS(down)) ? up : down;
    return up_fits || down_fits;
}

static struct stand stand_of(const char *name, struct vec3 position_mm) {
    double theta, phi;

    rig_angles(position_mm, &theta, &phi);
    if (sin(theta) < 1e-6) /* overhead, every azimuth is as good */
        phi = 0;
    return (struct stand){name, DEG(theta), plan_wrap(llround(DEG(phi) * UDEG))};
}

struct stands {
    const struct session_conf *conf; /* for messages, as kind and section */
    const char *kind, *section;
    enum plan_error missing;
    struct stand list[MAX(RIG_MAX_CAMERAS, MAX(RIG_MAX_LAMPS, RIG_MAX_LASERS))];
    int n;
};

static gboolean none_stands(const struct stands *stands, double theta_deg, GError **error) {
    g_autoptr(GString) there = g_string_new(NULL);

    for (int i = 0; i < stands->n; i++)
        g_string_append_printf(there, "%s%.4g° (%s)", i ? ", " : "", stands->list[i].theta_deg,
                               stands->list[i].name);
    plan_set_error(error, stands->missing, stands->conf, stands->section, NULL,
                   "no %s stands at elevation %g° (within %g°); there are: %s. Change the rings "
                   "in the session file, or the rig file",
                   stands->kind, theta_deg, THETA_TOLERANCE_DEG, stands->n ? there->str : "none");
    return FALSE;
}

static int find_udeg(const GArray *list, gsize stride, gint64 udeg) {
    for (guint i = 0; i < list->len; i++)
        if (*(const gint64 *)(list->data + i * stride) == udeg)
            return (int)i;
    return -1;
}

/* The device for one direction: of those at its elevation, one that the axis can bring there, if
 * possible by an angle that is needed anyway, so that no pose is added. */
static int plan_directions_choose(const struct stands *stands, double theta_deg, gint64 phi_udeg,
                                  int sign, const GArray *angles, gsize stride,
                                  const struct axis_motion *limits, gint64 *ret_udeg) {
    int chosen = -1, best = -1;

    for (int i = 0; i < stands->n; i++) {
        if (fabs(stands->list[i].theta_deg - theta_deg) > THETA_TOLERANCE_DEG)
            continue;
        gint64 udeg = plan_wrap(sign * (stands->list[i].phi_udeg - phi_udeg));
        gboolean reached = !limits || plan_axis_reach(limits, udeg, &udeg);
        int merit = 2 * reached + (find_udeg(angles, stride, udeg) >= 0);
        if (merit > best) {
            best = merit;
            chosen = i;
            *ret_udeg = udeg;
        }
    }
    return chosen;
}

static struct session_direction plan_directions_direction_of(const struct stands *stands,
                                                             int device, int index,
                                                             double theta_deg, double phi_deg) {
    struct session_direction d = {
        .index = index, .device = device, .theta_deg = theta_deg, .phi_deg = phi_deg};

    if (fabs(stands->list[device].theta_deg - theta_deg) > 1e-6)
        d.note = g_strdup_printf("%s stands at elevation %.4g°", stands->list[device].name,
                                 stands->list[device].theta_deg);
    return d;
}

static double ring_phi_deg(const struct ring *ring, int k) {
    double phi = fmod(ring->offset_deg + 360.0 * k / ring->count, 360);

    phi = phi < 0 ? phi + 360 : phi;
    return phi >= 360 ? 0 : phi;
}

/* A camera at azimuth φ_c sees the sample from φ_c − τ. */
static gboolean plan_directions_add_view(struct plan_build *b, const struct stands *cameras,
                                         double theta_deg, double phi_deg, GError **error) {
    const struct axis_motion *limits = &b->timing->turntable;
    gint64 udeg = 0;
    int camera = plan_directions_choose(cameras, theta_deg, llround(phi_deg * UDEG), 1, b->turns,
                                        sizeof(struct plan_turn), limits, &udeg);

    if (camera < 0)
        return none_stands(cameras, theta_deg, error);
    if (!plan_axis_reach(limits, udeg, &udeg)) {
        plan_set_error(error, PLAN_ERROR_LIMITS, b->conf, "views", NULL,
                       "the turntable cannot turn to %g°, from where %s would see theta %g° phi "
                       "%g°: its limits are %g° to %g°. Change the rings or the limits in the rig "
                       "file",
                       (double)udeg / UDEG, cameras->list[camera].name, theta_deg, phi_deg,
                       limits->min_deg, limits->max_deg);
        return FALSE;
    }
    int at = find_udeg(b->turns, sizeof(struct plan_turn), udeg);
    if (at < 0) {
        struct plan_turn turn = {udeg, 0};
        g_array_append_val(b->turns, turn);
        at = (int)b->turns->len - 1;
    }
    g_array_index(b->turns, struct plan_turn, at).cameras |= 1u << camera;
    struct session_direction d =
        plan_directions_direction_of(cameras, camera, (int)b->views->len, theta_deg, phi_deg);
    d.turntable_deg = (double)udeg / UDEG;
    g_array_append_val(b->views, d);
    return TRUE;
}

static gboolean add_views(struct plan_build *b, const struct stands *cameras, GError **error) {
    for (int r = 0; r < b->conf->n_views; r++) {
        const struct ring *ring = &b->conf->views[r];
        for (int k = 0; k < ring->count; k++)
            if (!plan_directions_add_view(b, cameras, ring->theta_deg, ring_phi_deg(ring, k),
                                          error))
                return FALSE;
    }
    return TRUE;
}

/* A lamp on the arc is seen from the sample at φ = α − τ (plus its own azimuth at α = 0). */
static gboolean add_sources(struct plan_build *b, const struct stands *stands,
                            const struct ring *rings, int n_rings, GArray *directions,
                            GArray *lit_at, GError **error) {
    for (int r = 0; r < n_rings; r++)
        for (int k = 0; k < rings[r].count; k++) {
            double phi_deg = ring_phi_deg(&rings[r], k);
            gint64 udeg = 0;
            int device = plan_directions_choose(stands, rings[r].theta_deg, llround(phi_deg * UDEG),
                                                -1, b->azimuths, sizeof(gint64), NULL, &udeg);
            if (device < 0)
                return none_stands(stands, rings[r].theta_deg, error);
            int at = find_udeg(b->azimuths, sizeof(gint64), udeg);
            if (at < 0) {
                g_array_append_val(b->azimuths, udeg);
                at = (int)b->azimuths->len - 1;
            }
            struct session_direction d = plan_directions_direction_of(
                stands, device, (int)directions->len, rings[r].theta_deg, phi_deg);
            g_array_append_val(directions, d);
            g_array_append_val(lit_at, at);
        }
    return TRUE;
}

gboolean plan_add_directions(struct plan_build *b, GError **error) {
    const struct rig *rig = b->rig;
    struct stands cameras = {
        .conf = b->conf, .kind = "camera", .section = "views", .missing = PLAN_ERROR_NO_CAMERA};
    struct stands lamps = {
        .conf = b->conf, .kind = "lamp", .section = "lights", .missing = PLAN_ERROR_NO_LAMP};
    struct stands lasers = {
        .conf = b->conf, .kind = "laser", .section = "lasers", .missing = PLAN_ERROR_NO_LASER};

    for (int i = 0; i < rig->n_cameras; i++)
        cameras.list[cameras.n++] =
            stand_of(rig->cameras[i].name, rig_camera_centre_mm(&rig->cameras[i]));
    for (int i = 0; i < rig->n_lamps; i++)
        lamps.list[lamps.n++] = stand_of(rig->lamps[i].name, rig->lamps[i].position_mm);
    for (int i = 0; i < rig->n_lasers; i++)
        lasers.list[lasers.n++] = stand_of(rig->lasers[i].name, rig->lasers[i].position_mm);
    return add_views(b, &cameras, error) &&
           add_sources(b, &lamps, b->conf->lights, b->conf->n_lights, b->lights, b->light_at,
                       error) &&
           add_sources(b, &lasers, b->conf->lasers, b->conf->n_lasers, b->lasers, b->laser_at,
                       error);
}
