#include "plan_private.h"

#include <string.h>

#include "shot_frames.h"

#define DEG(rad) ((rad) * (180 / G_PI))
#define RAD(deg) ((deg) * (G_PI / 180))

G_DEFINE_QUARK(plan_error, plan_error)

void plan_sweep_deg(const struct session_conf *conf, const struct rig *rig, int laser,
                    double turntable_deg, double arc_deg, double *ret_from_deg,
                    double *ret_to_deg) {
    const struct session_grid *grid = &conf->grid;
    *ret_from_deg = G_MAXDOUBLE;
    *ret_to_deg = -G_MAXDOUBLE;
    for (int corner = 0; corner < 8; corner++) {
        double x = grid->width_mm / 2 + conf->sweep_margin_mm;
        double y = grid->height_mm / 2 + conf->sweep_margin_mm;
        double z = grid->reference_mm - (corner & 4 ? grid->depth_mm : 0);
        struct vec3 p =
            rig_turn(vec3(corner & 1 ? x : -x, corner & 2 ? y : -y, z), RAD(turntable_deg));
        double s = DEG(rig_laser_sweep_rad(&rig->arc, &rig->lasers[laser], RAD(arc_deg), p));
        *ret_from_deg = MIN(*ret_from_deg, s);
        *ret_to_deg = MAX(*ret_to_deg, s);
    }
}

static gboolean set_sweep(const struct plan_build *b, struct session_shot *shot, GError **error) {
    const struct rig_laser *laser = &b->rig->lasers[shot->device];
    const struct axis_motion *limits = &b->timing->sweep[shot->device];
    double from, to;

    plan_sweep_deg(b->conf, b->rig, shot->device, shot->turntable_deg, shot->arc_deg, &from, &to);
    shot->sweep_from_deg = from;
    shot->sweep_to_deg = to;
    shot->sweep_steps = plan_sweep_steps(b->conf, laser, to - from);
    if (from >= limits->min_deg && to <= limits->max_deg && to > from && to - from < 180)
        return TRUE;
    if (from >= limits->min_deg && to <= limits->max_deg)
        plan_set_error(
            error, PLAN_ERROR_LIMITS, b->conf, "lasers", NULL,
            "laser %s must sweep from %.2f° to %.2f° to pass the whole sample, and a sweep "
            "must be more than 0° and less than 180°: reduce [capture] sweep_margin_mm, or "
            "correct the position of the laser in the rig file",
            laser->name, from, to);
    else
        plan_set_error(
            error, PLAN_ERROR_LIMITS, b->conf, "lasers", NULL,
            "laser %s must sweep from %.2f° to %.2f° to pass the whole sample, and its sweep "
            "axis goes from %g° to %g°: reduce [capture] sweep_margin_mm or widen the limits "
            "in the rig file",
            laser->name, from, to, limits->min_deg, limits->max_deg);
    return FALSE;
}

struct pose_plan { /* the pose and the cameras of shots that are to be added */
    gint64 turn_udeg, arc_udeg;
    struct camera_set cameras;
    gint64 probe_udeg; /* each stop of the probe has separate poses */
    int azimuth;       /* index into azimuths */
    enum session_shot_state state;
    const char *note;
};

static guint pose_hash(gconstpointer key) {
    const struct plan_pose *p = key;
    const gint64 udeg[] = {p->turntable_udeg, p->arc_udeg, p->arm_udeg, p->probe_udeg};
    guint hash = 0;

    for (gsize i = 0; i < G_N_ELEMENTS(udeg); i++)
        hash = hash * 31 + g_int64_hash(&udeg[i]);
    return hash;
}

static gboolean pose_equal(gconstpointer a, gconstpointer b) {
    const struct plan_pose *p = a, *q = b;

    return p->turntable_udeg == q->turntable_udeg && p->arc_udeg == q->arc_udeg &&
           p->arm_udeg == q->arm_udeg && p->probe_udeg == q->probe_udeg;
}

static gint64 probe_udeg(const struct plan_build *b, enum session_shot_kind kind, int device) {
    return llround(rig_probe_deg(b->rig, kind == SHOT_LAMP ? device : -1) * UDEG);
}

static gboolean add_shot(struct plan_build *b, const struct pose_plan *p,
                         enum session_shot_kind kind, const struct session_direction *source,
                         int device, GError **error) {
    const struct plan_pose key = {p->turn_udeg, p->arc_udeg,
                                  llround(rig_arm_deg(b->rig, p->cameras) * UDEG), p->probe_udeg};
    int pose = GPOINTER_TO_INT(g_hash_table_lookup(b->pose_index, &key)) - 1;
    if (pose < 0) {
        pose = (int)b->poses->len;
        g_array_append_val(b->poses, key);
        g_hash_table_insert(b->pose_index, g_memdup2(&key, sizeof key), GINT_TO_POINTER(pose + 1));
    }
    struct session_shot shot = {.kind = kind,
                                .pose = pose,
                                .turntable_deg = (double)p->turn_udeg / UDEG,
                                .arc_deg = (double)p->arc_udeg / UDEG,
                                .source = source->index,
                                .device = device,
                                .cameras = p->cameras,
                                .state = p->state};

    if (kind == SHOT_SWEEP && !set_sweep(b, &shot, error))
        return FALSE;
    shot.note = g_strdup(p->note);
    g_array_append_val(b->shots, shot);
    return TRUE;
}

/* Returns the names of cameras: "cam1, cam2"; g_free(). */
static char *plan_camera_names(const struct plan_build *b, struct camera_set cameras) {
    GString *names = g_string_new(NULL);
    for (int c = camera_set_next(cameras, -1); c >= 0; c = camera_set_next(cameras, c))
        g_string_append_printf(names, "%s%s", names->len ? ", " : "", b->rig->cameras[c].name);
    return g_string_free(names, FALSE);
}

/* Adds the shot of a light whose lamp or laser is fixed. The device depends on the angle of the
 * turntable. If no device stands in the direction of the light, the shot is added as skipped.
 *
 * Cameras that are in the device's way, or that see the device in front of the sample, get a
 * separate, skipped shot. If on_blocked is refuse, the function returns FALSE with an error
 * instead. */
static gboolean add_fixed_shot(struct plan_build *b, const struct pose_plan *from,
                               enum session_shot_kind kind, const struct session_direction *source,
                               GError **error) {
    const double turntable_deg = (double)from->turn_udeg / UDEG;
    double off_deg;
    const int device = plan_fixed_device(b->rig, kind, source->theta_deg, source->phi_deg,
                                         turntable_deg, &off_deg);
    const char *what = kind == SHOT_LAMP ? "lamp" : "laser";
    const char *name = kind == SHOT_LAMP ? b->rig->lamps[device].name : b->rig->lasers[device].name;
    const struct vec3 at =
        kind == SHOT_LAMP ? b->rig->lamps[device].position_mm : b->rig->lasers[device].position_mm;
    struct pose_plan p = *from;
    g_autofree char *text = NULL;

    if (probe_udeg(b, kind, device) != p.probe_udeg)
        return TRUE;
    if (off_deg > PLAN_TOLERANCE_DEG) {
        p.note = text =
            g_strdup_printf("skipped: no %s stands where its light would come from", what);
        plan_add_note(b, "shot", text);
        p.state = SHOT_SKIPPED;
        return add_shot(b, &p, kind, source, device, error);
    }
    const struct camera_set hidden = plan_blocked_by(b->rig, p.cameras, at, b->radius_mm);
    p.cameras = camera_set_without(p.cameras, hidden);
    if (!camera_set_is_empty(p.cameras) && !add_shot(b, &p, kind, source, device, error))
        return FALSE;
    if (camera_set_is_empty(hidden))
        return TRUE;
    g_autofree char *names = plan_camera_names(b, hidden);
    if (b->conf->on_blocked == BLOCKED_REFUSE) {
        plan_set_error(
            error, PLAN_ERROR_BLOCKED, b->conf, kind == SHOT_LAMP ? "lights" : "lasers", NULL,
            "%s %s and %s are in each other's way: leave one of them out, or set [capture] "
            "on_blocked = skip",
            what, name, names);
        return FALSE;
    }
    p.cameras = hidden;
    p.note = text =
        g_strdup_printf("skipped: %s %s and %s are in each other's way", what, name, names);
    plan_add_note(b, "shot", text);
    p.state = SHOT_SKIPPED;
    return add_shot(b, &p, kind, source, device, error);
}

static gboolean add_shots(struct plan_build *b, const struct pose_plan *p, GError **error) {
    const struct {
        enum session_shot_kind kind;
        const GArray *directions, *at;
    } sources[] = {{SHOT_LAMP, b->lights, b->light_at}, {SHOT_SWEEP, b->lasers, b->laser_at}};
    const gboolean fixed = g_array_index(b->azimuths, struct plan_angle, p->azimuth).fixed;

    for (gsize k = 0; k < G_N_ELEMENTS(sources) && !camera_set_is_empty(p->cameras); k++)
        for (guint i = 0; i < sources[k].directions->len; i++) {
            const struct session_direction *source =
                &g_array_index(sources[k].directions, struct session_direction, i);
            if (g_array_index(sources[k].at, int, i) != p->azimuth ||
                (!fixed && probe_udeg(b, sources[k].kind, source->device) != p->probe_udeg))
                continue;
            if (!(fixed && p->state == SHOT_PLANNED
                      ? add_fixed_shot(b, p, sources[k].kind, source, error)
                      : add_shot(b, p, sources[k].kind, source, source->device, error)))
                return FALSE;
        }
    return TRUE;
}

/* Returns the positions (struct vec3), with the arc at 0, of the lamps and lasers on the arc that
 * give the session's lights of one azimuth with the probe at an angle. Returns an empty array for
 * the entry of fixed devices. */
static GArray *lights_at(const struct plan_build *b, int azimuth, gint64 probe) {
    GArray *positions = g_array_new(FALSE, FALSE, sizeof(struct vec3));

    if (g_array_index(b->azimuths, struct plan_angle, azimuth).fixed)
        return positions;
    for (guint i = 0; i < b->lights->len; i++) {
        int lamp = g_array_index(b->lights, struct session_direction, i).device;
        if (g_array_index(b->light_at, int, i) == azimuth &&
            probe_udeg(b, SHOT_LAMP, lamp) == probe)
            g_array_append_val(positions, b->rig->lamps[lamp].position_mm);
    }
    for (guint i = 0; i < b->lasers->len; i++) {
        int laser = g_array_index(b->lasers, struct session_direction, i).device;
        if (g_array_index(b->laser_at, int, i) == azimuth &&
            probe_udeg(b, SHOT_SWEEP, laser) == probe)
            g_array_append_val(positions, b->rig->lasers[laser].position_mm);
    }
    return positions;
}

/* Adds the shots of a pose for blocked cameras (plan_blocked()). If on_blocked is shift and a turn
 * of the arc helps, the shots get the turned arc. Otherwise they are added as skipped. If
 * on_blocked is refuse, returns FALSE with an error. */
static gboolean add_blocked(struct plan_build *b, struct pose_plan p, const GArray *lights,
                            GError **error) {
    g_autofree char *names = plan_camera_names(b, p.cameras);
    g_autofree char *text = NULL;
    gint64 shift;

    if (b->conf->on_blocked == BLOCKED_REFUSE) {
        plan_set_error(
            error, PLAN_ERROR_BLOCKED, b->conf, "capture", "on_blocked",
            "the light arc stands in the picture of %s with the turntable at %g° and the "
            "arc at %g°: turn [lights] and [lasers] by another offset_deg, or set "
            "[capture] on_blocked = shift",
            names, (double)p.turn_udeg / UDEG, (double)p.arc_udeg / UDEG);
        return FALSE;
    }
    if (b->conf->on_blocked == BLOCKED_SHIFT &&
        plan_shift(b->rig, &b->timing->arc, p.cameras, p.arc_udeg, b->radius_mm, lights, &shift) &&
        plan_axis_reach(&b->timing->arc, p.arc_udeg + shift, &p.arc_udeg)) {
        text = g_strdup_printf("arc shifted by %+.1f°: it stood in the picture of %s",
                               (double)shift / UDEG, names);
    } else {
        text = g_strdup_printf(
            "skipped: the arc stands in the picture of %s%s", names,
            b->conf->on_blocked == BLOCKED_SHIFT ? ", also when it is shifted by up to 20°" : "");
        p.state = SHOT_SKIPPED;
    }
    plan_add_note(b, "pose", text);
    p.note = text;
    return add_shots(b, &p, error);
}

static gboolean add_pose(struct plan_build *b, const struct plan_angle *turn, int azimuth,
                         gint64 probe, GError **error) {
    g_autoptr(GArray) lights = lights_at(b, azimuth, probe);
    const struct plan_angle *at = &g_array_index(b->azimuths, struct plan_angle, azimuth);
    gint64 arc_udeg = at->fixed ? 0 : turn->udeg + at->udeg;
    struct pose_plan p = {
        .turn_udeg = turn->udeg, .azimuth = azimuth, .probe_udeg = probe, .state = SHOT_PLANNED};

    if (!plan_axis_reach(&b->timing->arc, arc_udeg, &p.arc_udeg)) {
        plan_set_error(
            error, PLAN_ERROR_LIMITS, b->conf, "lights", NULL,
            "the light arc cannot turn to %g°, which is needed with the turntable at %g°: "
            "min_deg and max_deg of [axis arc] are %g° and %g°. Leave out directions, or "
            "change min_deg and max_deg in the rig file",
            (double)plan_wrap(arc_udeg) / UDEG, (double)turn->udeg / UDEG, b->timing->arc.min_deg,
            b->timing->arc.max_deg);
        return FALSE;
    }
    const struct camera_set blocked =
        plan_blocked(b->rig, turn->cameras, (double)p.arc_udeg / UDEG, b->radius_mm, lights);
    p.cameras = camera_set_without(turn->cameras, blocked);
    if (!add_shots(b, &p, error))
        return FALSE;
    p.cameras = blocked;
    return camera_set_is_empty(blocked) || add_blocked(b, p, lights, error);
}

/* Returns the angles (gint64, in 1e-6°) of the probe at which the rig's lamps shine, and the angle
 * for sweeps. */
static GArray *probe_angles(const struct plan_build *b) {
    GArray *angles = g_array_new(FALSE, FALSE, sizeof(gint64));

    for (int i = -1; i < b->rig->n_lamps; i++) {
        const gint64 udeg = probe_udeg(b, SHOT_LAMP, i);
        gboolean known = FALSE;
        for (guint k = 0; k < angles->len; k++)
            known |= g_array_index(angles, gint64, k) == udeg;
        if (!known)
            g_array_append_val(angles, udeg);
    }
    return angles;
}

static gboolean add_poses(struct plan_build *b, GError **error) {
    struct session_shot dark = {.kind = SHOT_DARK, .source = -1, .device = -1};
    g_autoptr(GArray) probes = probe_angles(b);

    /* A dark frame of a camera on the arm serves for all of its stops. */
    for (guint i = 0; i < b->views->len; i++)
        camera_set_add(
            &dark.cameras,
            rig_camera_unit(b->rig, g_array_index(b->views, struct session_direction, i).device));
    g_array_append_val(b->shots, dark);
    for (guint t = 0; t < b->turns->len; t++)
        for (guint a = 0; a < b->azimuths->len; a++)
            for (guint k = 0; k < probes->len; k++)
                if (!add_pose(b, &g_array_index(b->turns, struct plan_angle, t), (int)a,
                              g_array_index(probes, gint64, k), error))
                    return FALSE;
    return TRUE;
}

void plan_set_error(GError **error, enum plan_error code, const struct session_conf *conf,
                    const char *section, const char *key, const char *format, ...) {
    g_autoptr(GString) place = g_string_new(NULL);
    va_list args;
    va_start(args, format);
    g_autofree char *what = g_strdup_vprintf(format, args);
    va_end(args);
    if (conf->path && conf->text) {
        g_autofree char *heading = g_strdup_printf("[%s]", section);
        g_auto(GStrv) lines = g_strsplit(conf->text, "\n", -1);
        int line = 0;
        while (lines[line] && !g_str_has_prefix(g_strchug(lines[line]), heading))
            line++;
        g_string_append(place, conf->path);
        if (lines[line])
            g_string_append_printf(place, ":%d", line + 1);
        g_string_append(place, ": ");
    }
    g_set_error(error, PLAN_ERROR, (gint)code, "%s[%s]%s%s: %s", place->str, section,
                key ? " " : "", key ? key : "", what);
}

static gboolean plan_check_exposure(const struct plan_build *b, int camera, double exposure_us,
                                    enum auto_key key, GError **error) {
    const char *name = b->conf->is_auto[key] ? "auto_longest_us" : auto_key_names[key];
    gint64 min = b->timing->min_exposure_us[camera], max = b->timing->max_exposure_us[camera];

    if (llround(exposure_us) >= min && llround(exposure_us) <= max)
        return TRUE;
    plan_set_error(error, PLAN_ERROR_LIMITS, b->conf, "capture", name,
                   "%g µs is outside the range of camera %s: give %" G_GINT64_FORMAT
                   " to %" G_GINT64_FORMAT " µs",
                   exposure_us, b->rig->cameras[camera].name, min, max);
    return FALSE;
}

static gboolean check_auto(const struct plan_build *b, int camera, GError **error) {
    for (int key = 0; key < AUTO_KEYS && b->timing->listed_exposures[camera]; key++)
        if (b->conf->is_auto[key]) {
            const char *name = b->rig->cameras[camera].name;
            plan_set_error(error, PLAN_ERROR_LIMITS, b->conf, "capture", auto_key_names[key],
                           "auto does not work with camera %s, which has only the exposure times "
                           "of its own list: write times of this list in µs; “mesorig snap %s -e "
                           "US” takes a picture, or names the nearest time of the list",
                           name, name);
            return FALSE;
        }
    return TRUE;
}

static gboolean check_exposures(const struct plan_build *b, GError **error) {
    const struct session_conf *conf = b->conf;

    for (guint v = 0; v < b->views->len; v++) {
        int camera = g_array_index(b->views, struct session_direction, v).device;
        if (!check_auto(b, camera, error))
            return FALSE;
        /* While the exposures are not chosen yet, the longest one is an upper bound. Only this one
         * must fit. */
        for (int i = conf->is_auto[AUTO_EXPOSURES] ? conf->n_exposures - 1 : 0;
             i < conf->n_exposures; i++)
            if (!plan_check_exposure(b, camera, conf->exposures_us[i], AUTO_EXPOSURES, error))
                return FALSE;
        if (!plan_check_exposure(b, camera, conf->laser_exposure_us, AUTO_LASER, error) ||
            (conf->laser_short_us > 0 && !conf->is_auto[AUTO_SHORT] &&
             !plan_check_exposure(b, camera, conf->laser_short_us, AUTO_SHORT, error)))
            return FALSE;
    }
    return TRUE;
}

/* Returns the first laser unit that is mounted by hand at several places, or NULL if there is
 * none. */
static const char *plan_mounted_by_hand(const struct plan_build *b) {
    for (int i = 0; i < b->rig->n_lasers; i++)
        if (b->timing->mounts[i] != 0)
            return b->rig->lasers[i].name;
    return NULL;
}

/* Returns FALSE with an error if [lasers] stop = covered is used with a laser unit that is mounted
 * by hand. A further round would require the operator to mount the unit again. */
static gboolean plan_check_stop(const struct plan_build *b, GError **error) {
    const char *unit = b->conf->laser_stop == STOP_COVERED ? plan_mounted_by_hand(b) : NULL;
    if (unit)
        plan_set_error(error, PLAN_ERROR_LIMITS, b->conf, "lasers", "stop",
                       "covered needs lasers that stay where they are, and laser %s is mounted "
                       "by hand at several places: set stop = all",
                       unit);
    return unit == NULL;
}

/* Returns FALSE with an error if this session cannot use [lights] sampling = adaptive. It needs at
 * least two views, because pictures are predicted from those of other views. A laser unit that
 * sweeps must not be mounted by hand, because nobody may be present at a further round. */
static gboolean plan_check_sampling(const struct plan_build *b, GError **error) {
    const struct session_conf *conf = b->conf;
    if (conf->light_sampling == SAMPLING_ALL)
        return TRUE;
    if (b->views->len < 2) {
        plan_set_error(error, PLAN_ERROR_LIMITS, conf, "lights", "sampling",
                       "adaptive predicts pictures from those of other views, and this session has "
                       "a single view, as an RTI set has: set sampling = all");
        return FALSE;
    }
    const char *unit = b->lasers->len > 0 ? plan_mounted_by_hand(b) : NULL;
    if (unit)
        plan_set_error(error, PLAN_ERROR_LIMITS, conf, "lights", "sampling",
                       "adaptive takes the lamps' shots in rounds, and the laser unit %s is "
                       "mounted by hand at several places, for which somebody has to be present: "
                       "set sampling = all, or capture [lasers] in a separate session",
                       unit);
    return unit == NULL;
}

/* Sets b->is_first for all shots. */
static void plan_find_first(struct plan_build *b) {
    const int n = (int)b->shots->len;
    g_autofree const struct session_shot **list = g_new(const struct session_shot *, n + 1);
    for (int i = 0; i < n; i++)
        list[i] = &g_array_index(b->shots, struct session_shot, i);
    b->is_first = g_new(gboolean, n + 1);
    plan_first_sweeps(b->conf, b->rig, list, n, b->is_first);
    plan_first_lamps(b->conf, b->rig, b->timing, list, n, b->is_first);
}

/* Returns FALSE with an error if [lights] budget_min is too short for the first round of lamps. */
static gboolean plan_check_budget(const struct plan_build *b, GError **error) {
    const struct session_conf *conf = b->conf;
    if (conf->light_sampling == SAMPLING_ALL || conf->light_budget_min <= 0)
        return TRUE;
    g_autofree const struct session_shot **list =
        g_new(const struct session_shot *, b->shots->len + 1);
    int n = 0;
    for (guint i = 0; i < b->shots->len; i++) {
        const struct session_shot *shot = &g_array_index(b->shots, struct session_shot, i);
        if (b->is_first[i] && shot->kind == SHOT_LAMP)
            list[n++] = shot;
    }
    const double min_s = plan_lamps_s(list, n, conf, b->rig, b->timing);
    if (min_s <= 60 * conf->light_budget_min)
        return TRUE;
    plan_set_error(error, PLAN_ERROR_LIMITS, conf, "lights", "budget_min",
                   "%g min are too few for the first round, whose %d shots take %.2f min: give at "
                   "least that many, or reduce [lights] first, which is %d",
                   conf->light_budget_min, n, ceil(min_s / 0.6) / 100, conf->light_first);
    return FALSE;
}

static void plan_count(const struct plan_build *b, struct plan *plan) {
    for (guint i = 0; i < b->shots->len; i++) {
        const struct session_shot *shot = &g_array_index(b->shots, struct session_shot, i);
        if (shot->state != SHOT_PLANNED)
            continue;
        plan->n_frames += shot_n_frames(b->conf, shot) * camera_set_count(shot->cameras);
    }
    plan->bytes = plan_bytes(b, (guint)plan->n_first, &plan->bytes_least);
}

static int plan_later(const struct plan *plan) {
    return plan->n_later_sweeps + plan->n_later_lamps;
}

/* Orders the shots: the first round, then the shots that may follow. Sets the plan's poses,
 * n_first, n_later_sweeps and n_later_lamps. */
static void plan_order_rounds(struct plan_build *b, const struct plan_pose *poses, int n_poses,
                              struct plan *plan) {
    g_autoptr(GArray) first = g_array_new(FALSE, FALSE, sizeof(struct session_shot));
    g_autoptr(GArray) later = g_array_new(FALSE, FALSE, sizeof(struct session_shot));

    for (guint i = 0; i < b->shots->len; i++) {
        const struct session_shot *shot = &g_array_index(b->shots, struct session_shot, i);
        const gboolean is_planned = shot->state == SHOT_PLANNED;
        g_array_append_vals(b->is_first[i] && is_planned ? first : later, shot, 1);
        const gboolean is_later = !b->is_first[i] && is_planned;
        plan->n_later_sweeps += is_later && shot->kind == SHOT_SWEEP;
        plan->n_later_lamps += is_later && shot->kind == SHOT_LAMP;
    }
    if (plan_later(plan) == 0) {
        plan->n_poses = plan_order(b->shots, poses, n_poses, b->conf, b->rig, b->timing);
        plan->n_first = (int)b->shots->len;
        return;
    }
    plan->n_poses = plan_order(first, poses, n_poses, b->conf, b->rig, b->timing);
    plan->n_first = (int)first->len;
    const int n_later = plan_order(later, poses, n_poses, b->conf, b->rig, b->timing);
    plan_set_passes(later, b->conf, b->rig, b->timing,
                    plan_set_passes(first, b->conf, b->rig, b->timing, 0));
    for (guint i = 0; i < later->len; i++)
        g_array_index(later, struct session_shot, i).pose += plan->n_poses;
    plan->n_poses += n_later;
    /* The result has the same shots in another order. Their strings are not copied. */
    g_array_append_vals(first, later->data, later->len);
    memcpy(b->shots->data, first->data, first->len * sizeof(struct session_shot));
}

/* Returns the lower bound of the time without homing. The passes are set as if all shots belonged
 * to one round. */
static double plan_bound_s(const struct plan_build *b, const struct plan_pose *poses, int n_poses) {
    g_autoptr(GArray) shots = g_array_new(FALSE, FALSE, sizeof(struct session_shot));

    g_array_append_vals(shots, b->shots->data, b->shots->len);
    if (b->conf->motion == MOTION_CONTINUOUS) {
        g_autoptr(GArray) followers = passes_take_followers(shots, b->conf, b->rig, b->timing);
        passes_put_back(shots, followers, b->rig);
        plan_set_passes(shots, b->conf, b->rig, b->timing, 0);
    }
    return plan_lower_bound_s(shots, poses, n_poses, b->conf, b->rig, b->timing);
}

/* Returns the predicted time if the turntable stands still for all shots. It is counted from the
 * moment when the axes are in the pose of the first shot. */
static double plan_standing_s(const struct plan_build *b, const struct plan_pose *poses,
                              int n_poses) {
    g_autoptr(GArray) shots = g_array_new(FALSE, FALSE, sizeof(struct session_shot));
    double first_s;

    g_array_append_vals(shots, b->shots->data, b->shots->len);
    plan_order_standing(shots, poses, n_poses, b->rig, b->timing, b->conf->order);
    return plan_total_s(shots, b->conf, b->rig, b->timing, &first_s);
}

/* Sets plan->n_passes, n_passing and passes. */
static void plan_count_passes(const struct plan_build *b, struct plan *plan) {
    struct camera_set cameras = {{0}};
    int before = 0;

    if (b->conf->motion != MOTION_CONTINUOUS)
        return;
    for (guint i = 0; i < b->shots->len; i++) {
        const struct session_shot *shot = &g_array_index(b->shots, struct session_shot, i);
        plan->n_passes += shot->pass.number > 0 && shot->pass.number != before;
        plan->n_passing += shot->pass.number > 0;
        before = shot->pass.number;
        if (shot->kind == SHOT_LAMP)
            cameras = camera_set_union(cameras, shot->cameras);
    }
    plan->passes = passes_speed(b->conf, b->rig, b->timing, cameras);
}

static void plan_predict(struct plan_build *b, struct plan *plan) {
    const struct plan_pose *poses = (const struct plan_pose *)(gpointer)b->poses->data;
    int n_poses = (int)b->poses->len;
    g_autoptr(GArray) nested = g_array_new(FALSE, FALSE, sizeof(struct session_shot));

    g_array_append_vals(nested, b->shots->data, b->shots->len);
    plan_order_standing(nested, poses, n_poses, b->rig, b->timing, ORDER_VIEWS);
    const double homing_s = plan_homing_s(b->rig, b->timing);
    double first_s;
    plan->nested_s = plan_total_s(nested, b->conf, b->rig, b->timing, &first_s);
    plan->lower_bound_s = homing_s + plan_bound_s(b, poses, n_poses);
    plan->standing_s =
        b->conf->motion == MOTION_CONTINUOUS ? plan_standing_s(b, poses, n_poses) : 0;
    plan_order_rounds(b, poses, n_poses, plan);
    plan_count_passes(b, plan);
    plan->predicted_s =
        plan_total_s(b->shots, b->conf, b->rig, b->timing, &first_s) + homing_s + first_s;
    /* The axes are homed again before a further round. */
    plan->predicted_s += plan_later(plan) > 0 ? homing_s : 0;
    plan->first_s = plan->predicted_s;
    if (plan_later(plan) > 0) {
        g_autoptr(GArray) round = g_array_new(FALSE, FALSE, sizeof(struct session_shot));
        g_array_append_vals(round, b->shots->data, (guint)plan->n_first);
        plan->first_s =
            plan_total_s(round, b->conf, b->rig, b->timing, &first_s) + homing_s + first_s;
    }
    /* plan_total_s() does not include the move into the first pose. For the other orders, this move
     * is assumed to take as long. */
    plan->nested_s += homing_s + first_s;
    plan->standing_s += plan->standing_s > 0 ? homing_s + first_s : 0;
    for (guint i = 0; i < b->shots->len; i++)
        g_array_index(b->shots, struct session_shot, i).id = i + 1;
}

static gboolean plan_check_motion(const struct plan_build *b, GError **error) {
    struct camera_set cameras = {{0}};
    for (guint i = 0; i < b->views->len; i++)
        camera_set_add(&cameras, g_array_index(b->views, struct session_direction, i).device);
    g_autofree char *why = passes_refused(b->conf, b->rig, b->timing, cameras);
    if (why)
        plan_set_error(error, PLAN_ERROR_LIMITS, b->conf, "capture", "motion", "continuous: %s",
                       why);
    return why == NULL;
}

/* Returns the number of times that laser units must be mounted by hand in the order of the
 * shots. */
static int count_mounts(const struct plan_build *b) {
    int in_place[RIG_MAX_LASERS], n = 0;

    for (int i = 0; i < RIG_MAX_LASERS; i++)
        in_place[i] = -1;
    for (guint i = 0; i < b->shots->len; i++) {
        const struct session_shot *shot = &g_array_index(b->shots, struct session_shot, i);
        if (shot->kind != SHOT_SWEEP || shot->state != SHOT_PLANNED)
            continue;
        int unit = rig_laser_unit(b->timing, shot->device);
        n += b->timing->mounts[unit] != 0 && in_place[unit] != shot->device;
        in_place[unit] = shot->device;
    }
    return n;
}

static struct plan *plan_finish(struct plan_build *b) {
    struct plan *plan = g_new0(struct plan, 1);
    plan_predict(b, plan);
    plan_count(b, plan);
    plan->n_mounts = count_mounts(b);
    plan->notes = plan_tell_notes(b, plan);
    plan->session = (struct session_plan){.grid = b->conf->grid,
                                          .n_views = (int)b->views->len,
                                          .n_lights = (int)b->lights->len,
                                          .n_lasers = (int)b->lasers->len,
                                          .n_shots = (int)b->shots->len};
    plan->session.views = (gpointer)g_array_free(g_steal_pointer(&b->views), FALSE);
    plan->session.lights = (gpointer)g_array_free(g_steal_pointer(&b->lights), FALSE);
    plan->session.lasers = (gpointer)g_array_free(g_steal_pointer(&b->lasers), FALSE);
    plan->session.shots = (gpointer)g_array_free(g_steal_pointer(&b->shots), FALSE);
    char *missing = plan_missing(&plan->session);
    if (missing)
        g_ptr_array_add(plan->notes, missing);
    return plan;
}

static void clear_direction(gpointer direction) {
    g_free(((struct session_direction *)direction)->note);
}

static void plan_clear_shot(gpointer shot) {
    g_free(((struct session_shot *)shot)->note);
}

static GArray *owning_array(gsize size, GDestroyNotify clear) {
    GArray *array = g_array_new(FALSE, FALSE, (guint)size);
    g_array_set_clear_func(array, clear);
    return array;
}

/* Returns FALSE with an error if n exceeds `most`. `what` names the things that n counts. The
 * planning time grows with the square of the number of poses. The memory grows with the square of
 * the number of angles of the arc. */
static gboolean plan_check_size(const struct plan_build *b, guint64 n, int most, const char *what,
                                GError **error) {
    if (n <= (guint64)most)
        return TRUE;
    plan_set_error(
        error, PLAN_ERROR_SIZE, b->conf, "views", NULL,
        "these directions need %" G_GUINT64_FORMAT
        " %s, and a plan has at most %d: give fewer directions, or choose counts and offsets with "
        "which the rings share angles of turntable and arc",
        n, what, most);
    return FALSE;
}

static gboolean plan_check_directions(const struct plan_build *b, GError **error) {
    const guint64 turns = b->turns->len;
    return plan_check_size(b, turns * b->azimuths->len, PLAN_MAX_POSES, "poses", error) &&
           plan_check_size(b, turns * (b->lights->len + b->lasers->len), PLAN_MAX_SHOTS, "shots",
                           error);
}

/* Checks the size again when the shots are known, because blocked cameras have added poses and
 * shots. */
static gboolean check_poses(const struct plan_build *b, GError **error) {
    g_autoptr(GHashTable) angles = g_hash_table_new(g_int64_hash, g_int64_equal);
    for (guint i = 0; i < b->poses->len; i++)
        g_hash_table_add(angles, &g_array_index(b->poses, struct plan_pose, i).arc_udeg);
    return plan_check_size(b, b->poses->len, PLAN_MAX_POSES, "poses", error) &&
           plan_check_size(b, b->shots->len, PLAN_MAX_SHOTS, "shots", error) &&
           plan_check_size(b, g_hash_table_size(angles), PLAN_MAX_ARC_ANGLES,
                           "different angles of the arc", error);
}

struct plan *plan_build(const struct session_conf *conf, const struct rig *rig,
                        const struct rig_timing *timing, GError **error) {
    struct plan_build b = {.conf = conf, .rig = rig, .timing = timing};
    struct plan *plan = NULL;
    GError *why = NULL;

    b.radius_mm = hypot(conf->grid.width_mm, conf->grid.height_mm) / 2;
    b.views = owning_array(sizeof(struct session_direction), clear_direction);
    b.lights = owning_array(sizeof(struct session_direction), clear_direction);
    b.lasers = owning_array(sizeof(struct session_direction), clear_direction);
    b.turns = g_array_new(FALSE, FALSE, sizeof(struct plan_angle));
    b.azimuths = g_array_new(FALSE, FALSE, sizeof(struct plan_angle));
    b.light_at = g_array_new(FALSE, FALSE, sizeof(int));
    b.laser_at = g_array_new(FALSE, FALSE, sizeof(int));
    b.poses = g_array_new(FALSE, FALSE, sizeof(struct plan_pose));
    b.pose_index = g_hash_table_new_full(pose_hash, pose_equal, g_free, NULL);
    b.shots = owning_array(sizeof(struct session_shot), plan_clear_shot);
    b.notes = owning_array(sizeof(struct plan_note), plan_clear_note);
    if (plan_check_stop(&b, &why) && plan_add_directions(&b, &why) && plan_check_motion(&b, &why) &&
        plan_check_sampling(&b, &why) && plan_check_directions(&b, &why) &&
        check_exposures(&b, &why) && add_poses(&b, &why) && check_poses(&b, &why)) {
        plan_find_first(&b);
        if (plan_check_budget(&b, &why))
            plan = plan_finish(&b);
    }
    g_clear_pointer(&b.views, g_array_unref);
    g_clear_pointer(&b.lights, g_array_unref);
    g_clear_pointer(&b.lasers, g_array_unref);
    g_clear_pointer(&b.shots, g_array_unref);
    g_array_unref(b.turns);
    g_array_unref(b.azimuths);
    g_array_unref(b.light_at);
    g_array_unref(b.laser_at);
    g_array_unref(b.poses);
    g_hash_table_unref(b.pose_index);
    g_array_unref(b.notes);
    g_free(b.is_first);
    if (why)
        g_propagate_error(error, why);
    return plan;
}

static void free_directions(const struct session_direction *directions, int n) {
    for (int i = 0; i < n; i++)
        g_free(directions[i].note);
    g_free((gpointer)directions);
}

void plan_free(struct plan *plan) {
    if (!plan)
        return;
    free_directions(plan->session.views, plan->session.n_views);
    free_directions(plan->session.lights, plan->session.n_lights);
    free_directions(plan->session.lasers, plan->session.n_lasers);
    for (int i = 0; i < plan->session.n_shots; i++)
        g_free(plan->session.shots[i].note);
    g_free((gpointer)plan->session.shots);
    g_ptr_array_unref(plan->notes);
    g_free(plan);
}
