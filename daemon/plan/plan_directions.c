#include "plan_private.h"

#define DEG(rad)            ((rad) * (180 / G_PI))
#define RAD(deg)            ((deg) * (G_PI / 180))
#define THETA_TOLERANCE_DEG 0.5

/* A device for some directions: where a camera stands, or a lamp or laser with the arc at 0. */
struct candidate {
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

static struct candidate candidate_of(const char *name, struct vec3 position_mm) {
    double theta, phi;

    rig_angles(position_mm, &theta, &phi);
    if (sin(theta) < 1e-6) /* overhead, every azimuth is as good */
        phi = 0;
    return (struct candidate){name, DEG(theta), plan_wrap(llround(DEG(phi) * UDEG))};
}

struct candidates {                  /* of one kind */
    const struct session_conf *conf; /* for messages, as kind and section */
    const char *kind, *section;
    enum plan_error missing;
    int sign; /* angle = sign · (φ of the device − φ of the direction) */
    const struct axis_motion *limits; /* of the turntable, which turns to the angle; NULL: none */
    struct candidate list[MAX(RIG_MAX_CAMERAS, MAX(RIG_MAX_LAMPS, RIG_MAX_LASERS))];
    int n;
};

static gboolean no_candidate(const struct candidates *candidates, double theta_deg,
                             GError **error) {
    g_autoptr(GString) there = g_string_new(NULL);

    for (int i = 0; i < candidates->n; i++)
        g_string_append_printf(there, "%s%.4g° (%s)", i ? ", " : "", candidates->list[i].theta_deg,
                               candidates->list[i].name);
    plan_set_error(error, candidates->missing, candidates->conf, candidates->section, NULL,
                   "no %s stands at elevation %g° (within %g°); there are: %s. Change the rings "
                   "in the session file, or the rig file",
                   candidates->kind, theta_deg, THETA_TOLERANCE_DEG,
                   candidates->n ? there->str : "none");
    return FALSE;
}

static int find_udeg(const GArray *angles, gint64 udeg) {
    for (guint i = 0; i < angles->len; i++)
        if (g_array_index(angles, struct plan_angle, i).udeg == udeg)
            return (int)i;
    return -1;
}

/* The device for one direction: of those at its elevation, one that the axis can bring there, if
 * possible by an angle that is needed anyway, so that no pose is added. */
static int plan_directions_choose(const struct candidates *candidates, double theta_deg,
                                  gint64 phi_udeg, const GArray *angles, gint64 *ret_udeg) {
    int chosen = -1, best = -1;

    for (int i = 0; i < candidates->n; i++) {
        if (fabs(candidates->list[i].theta_deg - theta_deg) > THETA_TOLERANCE_DEG)
            continue;
        gint64 udeg = plan_wrap(candidates->sign * (candidates->list[i].phi_udeg - phi_udeg));
        gboolean reached = !candidates->limits || plan_axis_reach(candidates->limits, udeg, &udeg);
        int merit = 2 * reached + (find_udeg(angles, udeg) >= 0);
        if (merit > best) {
            best = merit;
            chosen = i;
            *ret_udeg = udeg;
        }
    }
    return chosen;
}

static double ring_phi_deg(const struct ring *ring, int k) {
    double phi = fmod(ring->offset_deg + 360.0 * k / ring->count, 360);

    phi = phi < 0 ? phi + 360 : phi;
    return phi >= 360 ? 0 : phi;
}

/* Adds a direction of a ring, and the angle that shows it: of a camera at azimuth φ_c, which sees
 * the sample from φ_c − τ, the turntable's τ; of a lamp or laser, which the sample sees at φ = α −
 * τ plus its own azimuth at α = 0, the azimuth α − τ. */
static gboolean add_direction(const struct candidates *candidates, double theta_deg, double phi_deg,
                              GArray *angles, GArray *directions, GArray *angle_of,
                              GError **error) {
    struct session_direction d = {
        .index = (int)directions->len, .theta_deg = theta_deg, .phi_deg = phi_deg};
    gint64 udeg = 0;

    d.device =
        plan_directions_choose(candidates, theta_deg, llround(phi_deg * UDEG), angles, &udeg);
    if (d.device < 0)
        return no_candidate(candidates, theta_deg, error);
    const struct candidate *candidate = &candidates->list[d.device];
    const struct axis_motion *limits = candidates->limits;
    if (limits && !plan_axis_reach(limits, udeg, &udeg)) {
        plan_set_error(error, PLAN_ERROR_LIMITS, candidates->conf, "views", NULL,
                       "the turntable cannot turn to %g°, from where %s would see theta %g° phi "
                       "%g°: its limits are %g° to %g°. Change the rings or the limits in the rig "
                       "file",
                       (double)udeg / UDEG, candidate->name, theta_deg, phi_deg, limits->min_deg,
                       limits->max_deg);
        return FALSE;
    }
    int at = find_udeg(angles, udeg);
    if (at < 0) {
        struct plan_angle angle = {udeg, 0};
        g_array_append_val(angles, angle);
        at = (int)angles->len - 1;
    }
    if (fabs(candidate->theta_deg - theta_deg) > 1e-6)
        d.note =
            g_strdup_printf("%s stands at elevation %.4g°", candidate->name, candidate->theta_deg);
    if (limits) {
        d.turntable_deg = (double)udeg / UDEG;
        g_array_index(angles, struct plan_angle, at).cameras |= 1u << d.device;
    } else {
        g_array_append_val(angle_of, at);
    }
    g_array_append_val(directions, d);
    return TRUE;
}

static gboolean add_rings(const struct candidates *candidates, const struct ring *rings,
                          int n_rings, GArray *angles, GArray *directions, GArray *angle_of,
                          GError **error) {
    for (int r = 0; r < n_rings; r++)
        for (int k = 0; k < rings[r].count; k++)
            if (!add_direction(candidates, rings[r].theta_deg, ring_phi_deg(&rings[r], k), angles,
                               directions, angle_of, error))
                return FALSE;
    return TRUE;
}

gboolean plan_add_directions(struct plan_build *b, GError **error) {
    const struct rig *rig = b->rig;
    struct candidates cameras = {.conf = b->conf,
                                 .kind = "camera",
                                 .section = "views",
                                 .missing = PLAN_ERROR_NO_CAMERA,
                                 .sign = 1,
                                 .limits = &b->timing->turntable};
    struct candidates lamps = {.conf = b->conf,
                               .kind = "lamp",
                               .section = "lights",
                               .missing = PLAN_ERROR_NO_LAMP,
                               .sign = -1};
    struct candidates lasers = {.conf = b->conf,
                                .kind = "laser",
                                .section = "lasers",
                                .missing = PLAN_ERROR_NO_LASER,
                                .sign = -1};

    for (int i = 0; i < rig->n_cameras; i++)
        cameras.list[cameras.n++] =
            candidate_of(rig->cameras[i].name, rig_camera_centre_mm(&rig->cameras[i]));
    for (int i = 0; i < rig->n_lamps; i++)
        lamps.list[lamps.n++] = candidate_of(rig->lamps[i].name, rig->lamps[i].position_mm);
    for (int i = 0; i < rig->n_lasers; i++)
        lasers.list[lasers.n++] = candidate_of(rig->lasers[i].name, rig->lasers[i].position_mm);
    return add_rings(&cameras, b->conf->views, b->conf->n_views, b->turns, b->views, NULL, error) &&
           add_rings(&lamps, b->conf->lights, b->conf->n_lights, b->azimuths, b->lights,
                     b->light_at, error) &&
           add_rings(&lasers, b->conf->lasers, b->conf->n_lasers, b->azimuths, b->lasers,
                     b->laser_at, error);
}
