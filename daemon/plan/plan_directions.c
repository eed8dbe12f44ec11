#include "plan_private.h"

#define DEG(rad)   ((rad) * (180 / G_PI))
#define RAD(deg)   ((deg) * (G_PI / 180))
#define MAX_LISTED 12

/* A camera, lamp or laser that can show directions. */
struct candidate {
    const char *name;
    /* Position in spherical coordinates; for lamps and lasers, the position with the arc at 0. */
    double theta_deg;
    gint64 phi_udeg;
    gboolean fixed;  /* the device is a lamp or laser that is not on the arc */
    gboolean on_arm; /* the device is a camera on the arm */
    gint64 arm_udeg; /* angle of the arm for a camera on the arm */
    /* the arm or the probe that carries the device; NULL if neither does */
    const struct axis_motion *axis;
    double axis_deg; /* angle of that axis */
};

gboolean plan_is_absent(const struct axis_motion *motion) {
    return !motion->wraps && motion->min_deg == 0 && motion->max_deg == 0;
}

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

static struct candidate candidate_of(const char *name, struct vec3 position_mm, gboolean fixed) {
    double theta, phi;

    rig_angles(position_mm, &theta, &phi);
    if (sin(theta) < 1e-6) /* at the pole every azimuth is equally good */
        phi = 0;
    return (struct candidate){.name = name,
                              .theta_deg = DEG(theta),
                              .phi_udeg = plan_wrap(llround(DEG(phi) * UDEG)),
                              .fixed = fixed};
}

struct candidates {                  /* the devices of one kind */
    const struct session_conf *conf; /* for messages, as kind and section */
    const char *kind, *section;
    char **of; /* the devices whose directions are wanted; NULL for rings */
    const struct ring *rings;
    int n_rings;
    enum session_shot_kind shot; /* kind of the shots; only used for lamps and lasers */
    enum plan_error missing;
    /* sign of the angle that shows a direction: angle = sign · (φ of the device − φ of the
     * direction) */
    int sign;
    /* limits of the turntable, which turns to the angle, for cameras; NULL for lamps and lasers */
    const struct axis_motion *limits;
    struct candidate list[MAX(RIG_MAX_CAMERAS, MAX(RIG_MAX_LAMPS, RIG_MAX_LASERS))];
    int n;
};

static gboolean no_candidate(const struct candidates *candidates, double theta_deg, double phi_deg,
                             GError **error) {
    g_autoptr(GString) there = g_string_new(NULL);
    g_autofree char *where = NULL;
    gboolean same_theta = FALSE;
    int n = 0;

    for (int i = 0; i < candidates->n && !same_theta; i++)
        same_theta = fabs(candidates->list[i].theta_deg - theta_deg) <= PLAN_TOLERANCE_DEG;
    for (int i = 0; i < candidates->n; i++) {
        const struct candidate *c = &candidates->list[i];
        if ((same_theta && fabs(c->theta_deg - theta_deg) > PLAN_TOLERANCE_DEG) ||
            n++ >= MAX_LISTED)
            continue;
        g_string_append_printf(there, "%s%.4g°", n > 1 ? ", " : "", c->theta_deg);
        if (c->fixed)
            g_string_append_printf(there, " at azimuth %.4g°", (double)c->phi_udeg / UDEG);
        g_string_append_printf(there, " (%s)", c->name);
    }
    if (n > MAX_LISTED)
        g_string_append_printf(there, " and %d more", n - MAX_LISTED);
    where = same_theta ? g_strdup_printf(" and azimuth %g° at any angle of the turntable that the "
                                         "views need",
                                         phi_deg)
                       : g_strdup("");
    plan_set_error(error, candidates->missing, candidates->conf, candidates->section, NULL,
                   "no %s stands at theta %g°%s (within %g°); there are: %s. Change the rings "
                   "in the session file%s, or the rig file",
                   candidates->kind, theta_deg, where, PLAN_TOLERANCE_DEG,
                   candidates->n ? there->str : "none",
                   same_theta ? ", or write devices = all for the directions that there are" : "");
    return FALSE;
}

/* Returns the index of the entry of angles that a candidate can use for the angle udeg, or −1 if
 * there is none. A camera on the arm cannot use an entry of another stop of the arm. */
static int find_angle(const GArray *angles, gint64 udeg, const struct candidate *candidate) {
    for (guint i = 0; i < angles->len; i++) {
        const struct plan_angle *angle = &g_array_index(angles, struct plan_angle, i);
        if (!angle->fixed && angle->udeg == udeg &&
            (!candidate->on_arm || !angle->on_arm || angle->arm_udeg == candidate->arm_udeg))
            return (int)i;
    }
    return -1;
}

/* Returns whether a device and a direction of the same polar angle theta_deg are within
 * PLAN_TOLERANCE_DEG of each other. udeg is the difference of their azimuths. */
static gboolean is_near(gint64 udeg, double theta_deg) {
    const double off_deg = (double)MIN(udeg, PLAN_FULL_TURN - udeg) / UDEG;

    return off_deg * sin(RAD(theta_deg)) <= PLAN_TOLERANCE_DEG;
}

/* Returns the index of the device for a direction, and in *ret_udeg the angle that shows the
 * direction. Only devices at the polar angle of the direction that are not fixed are considered.
 * Returns −1 if there is none.
 *
 * Devices whose angle the axis can reach are preferred. Among these, devices are preferred whose
 * angle is already in angles, so that no pose is added. If the rig has no turntable, a camera that
 * stands near the direction gets the angle 0. The angle of any other camera is then not 0, and the
 * caller refuses it. */
static int choose(const struct candidates *candidates, double theta_deg, gint64 phi_udeg,
                  const GArray *angles, gint64 *ret_udeg) {
    int chosen = -1, best = -1;

    for (int i = 0; i < candidates->n; i++) {
        if (candidates->list[i].fixed ||
            fabs(candidates->list[i].theta_deg - theta_deg) > PLAN_TOLERANCE_DEG)
            continue;
        gint64 udeg = plan_wrap(candidates->sign * (candidates->list[i].phi_udeg - phi_udeg));
        if (candidates->limits && plan_is_absent(candidates->limits) && is_near(udeg, theta_deg))
            udeg = 0;
        gboolean reached = !candidates->limits || plan_axis_reach(candidates->limits, udeg, &udeg);
        int merit = 2 * reached + (find_angle(angles, udeg, &candidates->list[i]) >= 0);
        if (merit > best) {
            best = merit;
            chosen = i;
            *ret_udeg = udeg;
        }
    }
    return chosen;
}

int plan_fixed_device(const struct rig *rig, enum session_shot_kind kind, double theta_deg,
                      double phi_deg, double turntable_deg, double *ret_off_deg) {
    const struct vec3 towards = rig_direction(RAD(theta_deg), RAD(phi_deg + turntable_deg));
    const int n = kind == SHOT_LAMP ? rig->n_lamps : rig->n_lasers;
    int nearest = -1;

    *ret_off_deg = G_MAXDOUBLE;
    for (int i = 0; i < n; i++) {
        const struct rig_lamp *lamp = &rig->lamps[i];
        const struct rig_laser *laser = &rig->lasers[i % RIG_MAX_LASERS];
        const struct vec3 at = kind == SHOT_LAMP ? lamp->position_mm : laser->position_mm;
        if (!(kind == SHOT_LAMP ? lamp->fixed : laser->fixed))
            continue;
        const double off_deg =
            DEG(atan2(vec3_length(vec3_cross(towards, at)), vec3_dot(towards, at)));
        if (off_deg < *ret_off_deg) {
            *ret_off_deg = off_deg;
            nearest = i;
        }
    }
    return nearest;
}

/* Returns a fixed lamp or laser that gives the light of a direction at some angle of the turntable
 * that a view needs. If several do, returns the one of the first such angle. Returns −1 if there is
 * none. */
static int fixed_anywhere(const struct plan_build *b, enum session_shot_kind kind, double theta_deg,
                          double phi_deg) {
    for (guint t = 0; t < b->turns->len; t++) {
        double off_deg;
        const double turn_deg = (double)g_array_index(b->turns, struct plan_angle, t).udeg / UDEG;
        const int device = plan_fixed_device(b->rig, kind, theta_deg, phi_deg, turn_deg, &off_deg);
        if (off_deg <= PLAN_TOLERANCE_DEG)
            return device;
    }
    return -1;
}

/* Returns the index of the entry of angles that represents all fixed devices. Adds the entry if it
 * is missing. */
static int fixed_angle(GArray *angles) {
    const struct plan_angle angle = {.fixed = TRUE};

    for (guint i = 0; i < angles->len; i++)
        if (g_array_index(angles, struct plan_angle, i).fixed)
            return (int)i;
    g_array_append_val(angles, angle);
    return (int)angles->len - 1;
}

static double ring_phi_deg(const struct ring *ring, int k) {
    double phi = fmod(ring->offset_deg + 360.0 * k / ring->count, 360);

    phi = phi < 0 ? phi + 360 : phi;
    return phi >= 360 ? 0 : phi;
}

/* Returns whether the arm or probe that carries a device can reach the stop of the device. Returns
 * TRUE if neither carries it. */
static gboolean check_axis(const struct candidates *candidates, const struct candidate *c,
                           GError **error) {
    if (!c->axis || c->axis->wraps ||
        (c->axis_deg >= c->axis->min_deg && c->axis_deg <= c->axis->max_deg))
        return TRUE;
    plan_set_error(
        error, PLAN_ERROR_LIMITS, candidates->conf, candidates->section, NULL,
        "[axis %s] cannot turn to %g°, the stop of %s %s: its min_deg and max_deg are %g° and %g°. "
        "Change the rings in the session file, or the stops, min_deg or max_deg in the rig file",
        c->on_arm ? "arm" : "probe", c->axis_deg, candidates->kind, c->name, c->axis->min_deg,
        c->axis->max_deg);
    return FALSE;
}

/* Adds a direction and the angle that shows it. A camera at azimuth φ_c sees the sample from the
 * azimuth φ = φ_c − τ, so that the angle of a view is the turntable's τ = φ_c − φ. The light of a
 * lamp or laser whose azimuth is φ_d at α = 0 comes from φ = φ_d + α − τ, so that the angle of a
 * light is α − τ = φ − φ_d. angle_of gets the index of the angle of each light; it is NULL for
 * views. */
static gboolean add_direction(const struct plan_build *b, const struct candidates *candidates,
                              double theta_deg, double phi_deg, GArray *angles, GArray *directions,
                              GArray *angle_of, GError **error) {
    struct session_direction d = {
        .index = (int)directions->len, .theta_deg = theta_deg, .phi_deg = phi_deg};
    gint64 udeg = 0;

    d.device = choose(candidates, theta_deg, llround(phi_deg * UDEG), angles, &udeg);
    if (d.device < 0 && angle_of &&
        (d.device = fixed_anywhere(b, candidates->shot, theta_deg, phi_deg)) >= 0) {
        if (!check_axis(candidates, &candidates->list[d.device], error))
            return FALSE;
        const int at = fixed_angle(angles);
        g_array_append_val(angle_of, at);
        g_array_append_val(directions, d);
        return TRUE;
    }
    if (d.device < 0)
        return no_candidate(candidates, theta_deg, phi_deg, error);
    const struct candidate *candidate = &candidates->list[d.device];
    const struct axis_motion *limits = candidates->limits;
    if (limits && plan_is_absent(limits) && udeg != 0) {
        plan_set_error(error, PLAN_ERROR_LIMITS, candidates->conf, "views", NULL,
                       "no camera stands at theta %g° phi %g° (within %g°), and there is no [axis "
                       "turntable] in the rig file that would turn the sample before one: give the "
                       "directions of the cameras, or write devices = all",
                       theta_deg, phi_deg, PLAN_TOLERANCE_DEG);
        return FALSE;
    }
    if (limits && !plan_axis_reach(limits, udeg, &udeg)) {
        plan_set_error(
            error, PLAN_ERROR_LIMITS, candidates->conf, "views", NULL,
            "the turntable cannot turn to %g°, where %s would see the sample from theta %g° phi "
            "%g°: min_deg and max_deg of [axis turntable] are %g° and %g°. Change the rings in the "
            "session file, or min_deg and max_deg in the rig file",
            (double)udeg / UDEG, candidate->name, theta_deg, phi_deg, limits->min_deg,
            limits->max_deg);
        return FALSE;
    }
    if (!check_axis(candidates, candidate, error))
        return FALSE;
    int at = find_angle(angles, udeg, candidate);
    if (at < 0) {
        struct plan_angle angle = {.udeg = udeg};
        g_array_append_val(angles, angle);
        at = (int)angles->len - 1;
    }
    if (candidate->on_arm) {
        g_array_index(angles, struct plan_angle, at).on_arm = TRUE;
        g_array_index(angles, struct plan_angle, at).arm_udeg = candidate->arm_udeg;
    }
    if (fabs(candidate->theta_deg - theta_deg) > 1e-6)
        d.note = g_strdup_printf("%s stands at theta %.4g°", candidate->name, candidate->theta_deg);
    if (limits) {
        d.turntable_deg = (double)udeg / UDEG;
        camera_set_add(&g_array_index(angles, struct plan_angle, at).cameras, d.device);
    } else {
        g_array_append_val(angle_of, at);
    }
    g_array_append_val(directions, d);
    return TRUE;
}

/* Adds the directions of the devices that candidates->of names, or of all devices. */
static gboolean add_devices(const struct plan_build *b, const struct candidates *candidates,
                            GArray *angles, GArray *directions, GArray *angle_of, GError **error) {
    const gboolean all =
        g_strv_length(candidates->of) == 1 && g_str_equal(candidates->of[0], "all");
    gboolean wanted[G_N_ELEMENTS(candidates->list)] = {FALSE};

    for (char **name = candidates->of; *name && !all; name++) {
        int i = 0;
        while (i < candidates->n && !g_str_equal(candidates->list[i].name, *name))
            i++;
        if (i < candidates->n) {
            wanted[i] = TRUE;
            continue;
        }
        plan_set_error(error, candidates->missing, candidates->conf, candidates->section, "devices",
                       "there is no [%s %s] in the rig file; name a device of the rig file, or "
                       "write devices = all",
                       candidates->kind, *name);
        return FALSE;
    }
    for (int i = 0; i < candidates->n; i++) {
        const struct candidate *c = &candidates->list[i];
        if ((all || wanted[i]) &&
            !add_direction(b, candidates, round(c->theta_deg * UDEG) / UDEG,
                           (double)c->phi_udeg / UDEG, angles, directions, angle_of, error))
            return FALSE;
    }
    if (directions->len > 0)
        return TRUE;
    plan_set_error(
        error, candidates->missing, candidates->conf, candidates->section, "devices",
        "there is no %s in the rig file; add a section [%s NAME] there, or leave out [%s] here",
        candidates->kind, candidates->kind, candidates->section);
    return FALSE;
}

static gboolean add_directions(const struct plan_build *b, const struct candidates *candidates,
                               GArray *angles, GArray *directions, GArray *angle_of,
                               GError **error) {
    if (candidates->of)
        return add_devices(b, candidates, angles, directions, angle_of, error);
    for (int r = 0; r < candidates->n_rings; r++) {
        const struct ring *ring = &candidates->rings[r];
        for (int k = 0; k < ring->count; k++)
            if (!add_direction(b, candidates, ring->theta_deg, ring_phi_deg(ring, k), angles,
                               directions, angle_of, error))
                return FALSE;
    }
    return TRUE;
}

gboolean plan_add_directions(struct plan_build *b, GError **error) {
    const struct rig *rig = b->rig;
    struct candidates cameras = {.conf = b->conf,
                                 .kind = "camera",
                                 .section = "views",
                                 .of = b->conf->views_of,
                                 .rings = b->conf->views,
                                 .n_rings = b->conf->n_views,
                                 .missing = PLAN_ERROR_NO_CAMERA,
                                 .sign = 1,
                                 .limits = &b->timing->turntable};
    struct candidates lamps = {.conf = b->conf,
                               .kind = "lamp",
                               .section = "lights",
                               .of = b->conf->lights_of,
                               .rings = b->conf->lights,
                               .n_rings = b->conf->n_lights,
                               .shot = SHOT_LAMP,
                               .missing = PLAN_ERROR_NO_LAMP,
                               .sign = -1};
    struct candidates lasers = {.conf = b->conf,
                                .kind = "laser",
                                .section = "lasers",
                                .of = b->conf->lasers_of,
                                .rings = b->conf->lasers,
                                .n_rings = b->conf->n_lasers,
                                .shot = SHOT_SWEEP,
                                .missing = PLAN_ERROR_NO_LASER,
                                .sign = -1};

    for (int i = 0; i < rig->n_cameras; i++) {
        const struct rig_camera *camera = &rig->cameras[i];
        struct candidate *candidate = &cameras.list[cameras.n++];
        *candidate = candidate_of(camera->name, rig_camera_centre_mm(camera), FALSE);
        candidate->on_arm = camera->on_arm;
        candidate->arm_udeg = llround(camera->arm_deg * UDEG);
        candidate->axis = camera->on_arm ? &b->timing->arm : NULL;
        candidate->axis_deg = camera->arm_deg;
    }
    for (int i = 0; i < rig->n_lamps; i++) {
        const struct rig_lamp *lamp = &rig->lamps[i];
        struct candidate *candidate = &lamps.list[lamps.n++];
        *candidate = candidate_of(lamp->name, lamp->position_mm, lamp->fixed);
        candidate->axis = lamp->on_probe ? &b->timing->probe : NULL;
        candidate->axis_deg = lamp->probe_deg;
    }
    for (int i = 0; i < rig->n_lasers; i++)
        lasers.list[lasers.n++] =
            candidate_of(rig->lasers[i].name, rig->lasers[i].position_mm, rig->lasers[i].fixed);
    return add_directions(b, &cameras, b->turns, b->views, NULL, error) &&
           add_directions(b, &lamps, b->azimuths, b->lights, b->light_at, error) &&
           add_directions(b, &lasers, b->azimuths, b->lasers, b->laser_at, error);
}
