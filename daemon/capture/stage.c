#include "stage.h"

#include <math.h>
#include <string.h>

#define MAX_AXES (DEVICES_POSITIONERS + RIG_MAX_LASERS)

struct track { /* an axis */
    Stage *stage;
    Axis *axis;
    double at_deg; /* the last goal position that the axis has reached; NAN if not known */
    double target_deg;
    gboolean homing, homed;
};

struct stage_light { /* a lamp or a laser */
    gboolean asked;  /* whether the last command was "on" */
    gboolean on;     /* whether the light is on according to its last report */
    gint64 since_us;
    int pending; /* for lamps: number of switch commands without an answer */
};

struct Stage {
    struct devices *devices;
    struct stage_hooks hooks;
    gboolean active; /* from stage_home() until the next stage_make_safe() */
    struct track axes[MAX_AXES];
    int n_axes;
    struct stage_light lamps[RIG_MAX_LAMPS], lasers[RIG_MAX_LASERS];
    guint interlocks[DEVICES_MAX_INTERLOCKS];
};

static const char *advice(const GError *error) {
    if (error->domain != DEVICE_ERROR)
        return "Check the device";
    switch (error->code) {
    case DEVICE_ERROR_TIMEOUT:
        return "Check its power and its cable";
    case DEVICE_ERROR_DISCONNECTED:
        return "Connect it again";
    case DEVICE_ERROR_STALLED:
        return "Check that nothing is in its way";
    case DEVICE_ERROR_INTERLOCK:
        return "Close the interlock";
    case DEVICE_ERROR_RANGE:
        return "Check the rig file against the session";
    case DEVICE_ERROR_STALE:
        return "Switch it off and on again";
    case DEVICE_ERROR_PROTOCOL:
        return "Check its wiring and that the rig file names the right device";
    default:
        return "Check the device";
    }
}

char *stage_advise(const char *text, const GError *error) {
    if (error_details_advice(error))
        return g_strdup_printf("%s, then continue.", text);
    return g_strdup_printf("%s. %s, then continue.", text, advice(error));
}

/* Returns the text of an error with advice. If the error does not name the device, class and name
 * of the device come first. */
static char *describe(const char *class_name, const char *name, const GError *error) {
    g_autofree char *device = g_strdup_printf("%s %s", class_name, name);
    const gboolean named = g_strcmp0(error_details_subject(error), device) == 0;
    g_autofree char *text =
        named ? g_strdup(error->message) : g_strdup_printf("%s: %s", device, error->message);
    return stage_advise(text, error);
}

static void fault(Stage *stage, const char *kind, const char *name, const GError *error) {
    g_autofree char *reason = describe(kind, name, error);
    if (stage->active)
        stage->hooks.fault(name, reason, stage->hooks.data);
}

/* Reports that a light has failed. A light that does not confirm "off" may still be lit; this is
 * reported even while the stage is inactive. */
static void light_fault(Stage *stage, const char *kind, const char *name, gboolean on,
                        const GError *error) {
    if (on) {
        fault(stage, kind, name, error);
        return;
    }
    g_autofree char *advised = describe(kind, name, error);
    g_autofree char *reason = g_strdup_printf(DEVICES_UNSAFE ": %s", advised);
    (stage->active ? stage->hooks.fault : stage->hooks.unsafe)(name, reason, stage->hooks.data);
}

static void changed(Stage *stage) {
    if (stage->active)
        stage->hooks.changed(stage->hooks.data);
}

static void axis_fault(struct track *track, const GError *error) {
    track->at_deg = NAN;
    fault(track->stage, "axis", track->axis->device.name, error);
}

static void start_homing(struct track *track) {
    g_autoptr(GError) error = NULL;
    track->homing = axis_home(track->axis, &error);
    if (!track->homing)
        axis_fault(track, error);
}

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    struct track *track = data;
    if (!track->stage->active)
        return;
    if (event == AXIS_PASSING) {
        changed(track->stage);
    } else if (event == AXIS_FAULT) {
        axis_fault(track, error);
    } else if (!track->homed && !track->homing) {
        start_homing(track); /* the axis was still moving when homing was requested */
    } else if (event == AXIS_HOMED) {
        track->homing = FALSE;
        track->homed = TRUE;
        track->at_deg = axis_position_deg(axis);
        changed(track->stage);
    } else if (event == AXIS_ARRIVED) {
        track->at_deg = track->target_deg;
        changed(track->stage);
    } else {
        /* The axis has stopped without a command, because of a limit switch or because somebody
         * stopped it at the drive's own panel. */
        g_autoptr(GError) stalled = NULL;
        device_error_set(&stalled, DEVICE_ERROR_STALLED, axis->device.who,
                         "it stopped on its way to %g° without a command", track->target_deg);
        axis_fault(track, stalled);
    }
}

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    Stage *stage = data;
    if (error) {
        light_fault(stage, "lamps", bank->device.name, on, error);
        return;
    }
    for (int i = 0; i < stage->devices->geometry.n_lamps; i++) {
        if (rig_lamp_unit(&stage->devices->geometry, i) == i &&
            stage->devices->lamps[i].bank == bank &&
            (index < 0 || stage->devices->lamps[i].index == index))
            stage->lamps[i] =
                (struct stage_light){stage->lamps[i].asked, on, at_us,
                                     index < 0 ? 0 : MAX(stage->lamps[i].pending - 1, 0)};
    }
    changed(stage);
}

static void on_laser(Laser *laser, gboolean on, const GError *error, gpointer data) {
    Stage *stage = data;
    if (error) {
        light_fault(stage, "laser", laser->device.name, on, error);
        return;
    }
    for (int i = 0; i < stage->devices->geometry.n_lasers; i++) {
        if (stage->devices->lasers[i] == laser && rig_laser_unit(&stage->devices->timing, i) == i)
            stage->lasers[i] = (struct stage_light){stage->lasers[i].asked, on,
                                                    clock_now_us(stage->devices->clock), 0};
    }
    changed(stage);
}

static void on_interlock(Interlock *interlock, gboolean closed, gpointer data) {
    Stage *stage = data;
    if (closed || !stage->active)
        return;
    g_autofree char *reason = interlock_advice(interlock);
    stage->hooks.fault(interlock->device.name, reason, stage->hooks.data);
}

static struct track *find_track(Stage *stage, Axis *axis) {
    for (int i = 0; i < stage->n_axes; i++) {
        if (stage->axes[i].axis == axis)
            return &stage->axes[i];
    }
    return NULL;
}

static void add_track(Stage *stage, Axis *axis) {
    if (!axis || find_track(stage, axis))
        return; /* the rig has no such axis, or two lasers share one sweep axis */
    struct track *track = &stage->axes[stage->n_axes++];
    *track = (struct track){.stage = stage, .axis = axis, .at_deg = NAN};
    axis_listen(axis, on_axis, track);
}

Stage *stage_new(struct devices *devices, const struct stage_hooks *hooks) {
    Stage *stage = g_new0(Stage, 1);
    stage->devices = devices;
    stage->hooks = *hooks;
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        add_track(stage, devices_positioner(devices, i));
    for (int i = 0; i < devices->geometry.n_lasers; i++) {
        add_track(stage, devices->sweeps[i]);
        stage->lasers[i].on =
            rig_laser_unit(&devices->timing, i) == i && laser_is_on(devices->lasers[i]);
        laser_listen(devices->lasers[i], on_laser, stage);
    }
    for (int i = 0; i < devices->geometry.n_lamps; i++)
        stage->lamps[i].on = rig_lamp_unit(&devices->geometry, i) == i &&
                             lamps_is_on(devices->lamps[i].bank, devices->lamps[i].index);
    for (int i = 0; i < devices->n_banks; i++)
        lamps_listen(devices->banks[i], on_lamp, stage);
    for (int i = 0; i < devices->n_interlocks; i++)
        stage->interlocks[i] = interlock_listen(devices->interlocks[i], on_interlock, stage);
    return stage;
}

void stage_free(Stage *stage) {
    if (!stage)
        return;
    struct devices *devices = stage->devices;
    for (int i = 0; i < stage->n_axes; i++)
        axis_listen(stage->axes[i].axis, NULL, NULL);
    for (int i = 0; i < devices->n_banks; i++)
        lamps_listen(devices->banks[i], NULL, NULL);
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        laser_listen(devices->lasers[i], NULL, NULL);
    for (int i = 0; i < devices->n_interlocks; i++)
        interlock_unlisten(devices->interlocks[i], stage->interlocks[i]);
    g_free(stage);
}

const Interlock *stage_open_interlock(const Stage *stage) {
    for (int i = 0; i < stage->devices->n_interlocks; i++) {
        if (!interlock_is_closed(stage->devices->interlocks[i]))
            return stage->devices->interlocks[i];
    }
    return NULL;
}

/* Commands "off" again for the lights that have not confirmed it since the rig was made safe. */
static void darken(Stage *stage) {
    const struct devices *devices = stage->devices;
    for (int i = 0; i < devices->geometry.n_lamps && stage->active; i++) {
        g_autoptr(GError) error = NULL;
        if (stage->lamps[i].on &&
            !lamps_set(devices->lamps[i].bank, devices->lamps[i].index, FALSE, &error))
            light_fault(stage, "lamp", devices->geometry.lamps[i].name, FALSE, error);
    }
    for (int i = 0; i < devices->geometry.n_lasers && stage->active; i++) {
        g_autoptr(GError) error = NULL;
        if (stage->lasers[i].on && !laser_set(devices->lasers[i], FALSE, &error))
            light_fault(stage, "laser", devices->geometry.lasers[i].name, FALSE, error);
    }
}

void stage_home(Stage *stage) {
    stage->active = TRUE;
    for (int i = 0; i < stage->n_axes; i++) {
        struct track *track = &stage->axes[i];
        track->homing = track->homed = FALSE;
        track->at_deg = NAN;
    }
    darken(stage);
    for (int i = 0; i < stage->n_axes && stage->active; i++) {
        if (!axis_is_moving(stage->axes[i].axis))
            start_homing(&stage->axes[i]);
    }
}

static gboolean lasers_are(const Stage *stage, int lit) {
    for (int i = 0; i < stage->devices->geometry.n_lasers; i++) {
        gboolean wanted = i == lit;
        if (stage->lasers[i].on != wanted || stage->lasers[i].asked != wanted)
            return FALSE;
    }
    return TRUE;
}

static gboolean lamps_are(const Stage *stage, int lit) {
    for (int i = 0; i < stage->devices->geometry.n_lamps; i++) {
        gboolean wanted = i == lit;
        /* A lamp that was switched off and on again has the wanted state before it has answered the
         * first command. It is ready only when it has answered both. */
        if (stage->lamps[i].on != wanted || stage->lamps[i].asked != wanted ||
            stage->lamps[i].pending > 0)
            return FALSE;
    }
    return TRUE;
}

gboolean stage_is_homed(const Stage *stage) {
    for (int i = 0; i < stage->n_axes; i++) {
        if (!stage->axes[i].homed)
            return FALSE;
    }
    return lamps_are(stage, -1) && lasers_are(stage, -1);
}

static void pursue_axis(Stage *stage, Axis *axis, double target_deg) {
    struct track *track = find_track(stage, axis);
    if (!track || !stage->active || axis_is_moving(axis) || track->at_deg == target_deg)
        return;
    g_autoptr(GError) error = NULL;
    track->at_deg = NAN;
    track->target_deg = target_deg;
    if (!axis_move(axis, target_deg, &error))
        axis_fault(track, error);
}

void stage_turn(Stage *stage, double by_deg, double speed_deg_s) {
    struct track *track = find_track(stage, stage->devices->turntable);
    g_autoptr(GError) error = NULL;
    track->at_deg = track->target_deg = NAN;
    if (!axis_turn(track->axis, by_deg, speed_deg_s, &error))
        axis_fault(track, error);
}

static void switch_lamp(Stage *stage, int lamp, gboolean on) {
    g_autoptr(GError) error = NULL;
    LampBank *bank = stage->devices->lamps[lamp].bank;
    if (!stage->active || stage->lamps[lamp].asked == on)
        return;
    stage->lamps[lamp].asked = on;
    stage->lamps[lamp].pending++;
    if (!lamps_set(bank, stage->devices->lamps[lamp].index, on, &error))
        fault(stage, "lamp", stage->devices->geometry.lamps[lamp].name, error);
}

static void switch_laser(Stage *stage, int laser, gboolean on) {
    g_autoptr(GError) error = NULL;
    if (!stage->active || stage->lasers[laser].asked == on)
        return;
    stage->lasers[laser].asked = on;
    if (!laser_set(stage->devices->lasers[laser], on, &error))
        fault(stage, "laser", stage->devices->geometry.lasers[laser].name, error);
}

void stage_pursue(Stage *stage, const struct stage_goal *goal) {
    const struct devices *devices = stage->devices;
    for (int i = 0; i < devices->geometry.n_lamps; i++) {
        if (i != goal->lamp)
            switch_lamp(stage, i, FALSE);
    }
    for (int i = 0; i < devices->geometry.n_lasers; i++) {
        if (i != goal->laser)
            switch_laser(stage, i, FALSE);
    }
    const double degs[DEVICES_POSITIONERS] = {goal->turntable_deg, goal->arc_deg, goal->arm_deg,
                                              goal->probe_deg};
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        pursue_axis(stage, devices_positioner(devices, i), degs[i]);
    if (goal->sweep >= 0)
        pursue_axis(stage, devices->sweeps[goal->sweep], goal->sweep_deg);
    if (goal->lamp >= 0)
        switch_lamp(stage, goal->lamp, TRUE);
    if (goal->laser >= 0)
        switch_laser(stage, goal->laser, TRUE);
}

static gboolean stands_at(const Stage *stage, Axis *axis, double deg) {
    const struct track *track = find_track((Stage *)stage, axis);
    if (!track) /* the rig has no such axis */
        return deg == 0;
    return track->at_deg == deg && !axis_is_moving(axis);
}

gboolean stage_has_reached(const Stage *stage, const struct stage_goal *goal, gint64 *ret_at_us) {
    const struct devices *devices = stage->devices;
    const double degs[DEVICES_POSITIONERS] = {goal->turntable_deg, goal->arc_deg, goal->arm_deg,
                                              goal->probe_deg};
    *ret_at_us = 0;
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        if (!stands_at(stage, devices_positioner(devices, i), degs[i]))
            return FALSE;
    if ((goal->sweep >= 0 && !stands_at(stage, devices->sweeps[goal->sweep], goal->sweep_deg)) ||
        !lamps_are(stage, goal->lamp) || !lasers_are(stage, goal->laser))
        return FALSE;
    if (goal->lamp >= 0)
        *ret_at_us = stage->lamps[goal->lamp].since_us +
                     (gint64)ceil(devices->lamps[goal->lamp].bank->warm_up_s * 1e6);
    if (goal->laser >= 0)
        *ret_at_us =
            MAX(*ret_at_us, stage->lasers[goal->laser].since_us +
                                (gint64)ceil(devices->lasers[goal->laser]->warm_up_s * 1e6));
    return TRUE;
}

gboolean stage_make_safe(Stage *stage, GError **error) {
    stage->active = FALSE;
    for (int i = 0; i < RIG_MAX_LAMPS; i++)
        stage->lamps[i].asked = stage->lamps[i].pending = 0;
    for (int i = 0; i < RIG_MAX_LASERS; i++)
        stage->lasers[i].asked = FALSE;
    return devices_make_safe(stage->devices, error);
}
