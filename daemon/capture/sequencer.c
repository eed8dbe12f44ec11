#include "sequencer_private.h"

#include <math.h>
#include <string.h>

#include "intake/radiance.h"
#include "plan/shot_frames.h"

/* Pause in µs before the next attempt to trigger a camera that does not respond. */
#define REST_US (3 * G_USEC_PER_SEC)

/* Pause in µs after the second refused picture in a row. After each further one, the pause is four
 * times as long, up to REST_US. A disturbance of a line, or a busy computer, may last a second, and
 * the pauses keep it from using up all attempts. */
#define FIRST_REST_US 100000

static void prepare(Sequencer *seq);

gboolean sequencer_stop(Sequencer *seq, GError **error) {
    seq->state = IDLE;
    seq->shot = NULL;
    seq->pending = seq->exposing = seq->waiting = (struct camera_set){{0}};
    clock_cancel(seq->devices->clock, &seq->timer);
    sequencer_pass_clear(seq);
    gboolean safe = stage_make_safe(seq->stage, error);
    for (int c = 0; c < seq->devices->geometry.n_cameras; c++)
        camera_disarm(seq->devices->cameras[c]);
    return safe;
}

void sequencer_fail(Sequencer *seq, const char *source, const char *reason, gboolean rig) {
    g_autoptr(GError) error = NULL;
    g_autofree char *text = g_strdup(reason);
    const gboolean safe = sequencer_stop(seq, &error);
    rig = rig || !safe;
    /* Add the error, unless reason already contains it. */
    if (!safe && !strstr(reason, error->message)) {
        g_free(text);
        text = g_strdup_printf(DEVICES_UNSAFE ": %s. Switch it off by hand first. %s",
                               error->message, reason);
    }
    seq->hooks.fault(source, text, rig, seq->hooks.data);
}

void sequencer_finish(Sequencer *seq) {
    g_autoptr(GError) error = NULL;
    if (sequencer_stop(seq, &error)) {
        seq->hooks.finished(seq->hooks.data);
        return;
    }
    g_autofree char *text = g_strdup_printf(
        DEVICES_UNSAFE ": %s. Switch it off by hand, then continue.", error->message);
    seq->hooks.fault("rig", text, TRUE, seq->hooks.data);
}

/* Returns the angle of the sweep axis at step k of n: from + k·(to − from)/(n − 1). After the last
 * step, a picture is taken with the laser off. Its angle is the middle of the sweep, because a
 * laser that is still lit would light the sample there. */
static double sweep_at_deg(const struct session_shot *shot, int step) {
    double span_deg = shot->sweep_to_deg - shot->sweep_from_deg;
    if (step >= shot->sweep_steps)
        return shot->sweep_from_deg + span_deg / 2;
    return shot->sweep_from_deg +
           (shot->sweep_steps > 1 ? step * span_deg / (shot->sweep_steps - 1) : 0);
}

static struct stage_goal goal_of(const Sequencer *seq, const struct session_shot *shot, int sub) {
    const struct rig *rig = &seq->devices->geometry;
    const gboolean passes = shot->pass.number > 0;
    struct stage_goal goal = {.turntable_deg = passes ? shot->pass.from_deg : shot->turntable_deg,
                              .arc_deg = shot->arc_deg,
                              .arm_deg = rig_arm_deg(rig, shot->cameras),
                              .probe_deg =
                                  rig_probe_deg(rig, shot->kind == SHOT_LAMP ? shot->device : -1),
                              .lamp = -1,
                              .laser = -1,
                              .sweep = -1};
    if (shot->kind == SHOT_LAMP)
        goal.lamp = rig_lamp_unit(rig, shot->device);
    if (shot->kind == SHOT_SWEEP) {
        int unit = rig_laser_unit(&seq->devices->timing, shot->device);
        int step = shot_sweep_step(seq->conf, shot, sub);
        goal.laser = step < shot->sweep_steps ? unit : -1;
        goal.sweep = unit;
        goal.sweep_deg = sweep_at_deg(shot, step);
    }
    return goal;
}

/* Returns the state that the stage must reach after the exposure of the picture under way. */
static struct stage_goal goal_after(const Sequencer *seq) {
    if (!camera_set_is_empty(seq->pending) && seq->pass.n == 0)
        return goal_of(seq, seq->shot, seq->sub);
    if (seq->sub + 1 < seq->n_subs)
        return goal_of(seq, seq->shot, seq->sub + 1);
    if (seq->next < seq->shots->len && !seq->pausing) {
        /* The next laser is not switched on before the last frame of this shot has arrived, because
         * this frame may have to be taken again. If the next laser could not be switched off any
         * more, it would light the repeated frame, and this would be noticed only at the end of the
         * next sweep. */
        struct stage_goal goal = goal_of(seq, seq->shots->pdata[seq->next], 0);
        goal.laser = camera_set_is_empty(seq->waiting) ? goal.laser : -1;
        return goal;
    }
    struct stage_goal goal = goal_of(seq, seq->shot, seq->sub);
    goal.lamp = goal.laser = -1;
    return goal;
}

/* Begins the next shot, or the pass to which the next shot belongs. Returns FALSE if no shots are
 * left. */
static gboolean begin_shot(Sequencer *seq) {
    if (seq->next >= seq->shots->len)
        return FALSE;
    seq->shot = seq->last_shot = seq->shots->pdata[seq->next++];
    seq->sub = 0;
    seq->n_subs = shot_n_frames(seq->conf, seq->shot);
    seq->pending = seq->shot->cameras;
    memset(seq->cameras, 0, sizeof seq->cameras);
    if (seq->shot->pass.number > 0)
        sequencer_pass_begin(seq);
    return TRUE;
}

gint64 sequencer_exposure_us(const Sequencer *seq, const struct session_shot *shot, int sub,
                             const struct sequencer_camera *state) {
    gint64 us = shot_exposure_us(seq->conf, shot, sub);
    return sub == 0 ? us >> (2 * state->shortened) : us;
}

gboolean sequencer_make_ready(Sequencer *seq, const struct session_shot *shot, int sub, int c,
                              const struct sequencer_camera *state, GError **error) {
    Camera *camera = seq->devices->cameras[c];
    struct camera_settings settings = {
        .exposure_us = sequencer_exposure_us(seq, shot, sub, state),
        .gain_db = seq->conf->gain_db,
    };
    return camera_configure(camera, &settings, error) &&
           (camera_is_armed(camera) || camera_arm(camera, error));
}

gboolean sequencer_trigger(Sequencer *seq, const struct session_shot *shot, int sub, int c,
                           const struct sequencer_camera *state, GError **error) {
    guint64 tag = (guint64)shot->id << 16 | (guint64)sub;
    return sequencer_make_ready(seq, shot, sub, c, state, error) &&
           camera_trigger(seq->devices->cameras[c], tag, error);
}

static gint64 rest_us(int refused) {
    gint64 us = refused < 2 ? 0 : FIRST_REST_US;
    for (int i = 2; i < refused && us < REST_US; i++)
        us *= 4;
    return MIN(us, REST_US);
}

gboolean sequencer_count_refusal(Sequencer *seq, int camera, struct sequencer_camera *state,
                                 const GError *error) {
    struct sequencer_unit *unit = &seq->units[camera];
    const char *name = seq->devices->geometry.cameras[camera].name;
    state->retakes++;
    if (++state->refused <= seq->conf->retries) {
        gint64 until_us = clock_now_us(seq->devices->clock) + rest_us(state->refused);
        unit->rest_until_us = MAX(unit->rest_until_us, until_us);
        seq->hooks.retake(camera, error_details_text(error), 0, seq->hooks.data);
        return seq->state != IDLE;
    }
    g_autofree char *advised = stage_advise(error_details_text(error), error);
    g_autofree char *reason =
        g_strdup_printf("camera %s: no good frame in %d attempts; the last time: %s", name,
                        state->refused, advised);
    sequencer_fail(seq, name, reason,
                   g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED));
    return FALSE;
}

gboolean sequencer_count_gone(Sequencer *seq, int camera, struct sequencer_camera *state,
                              const GError *error) {
    camera_disarm(seq->devices->cameras[camera]);
    seq->units[camera].rest_until_us = clock_now_us(seq->devices->clock) + REST_US;
    return sequencer_count_refusal(seq, camera, state, error);
}

/* Triggers the pending cameras. A camera that does not respond stays pending, and is triggered
 * again after a pause. */
static void trigger_pending(Sequencer *seq) {
    seq->state = EXPOSING;
    const struct camera_set pending = seq->pending;
    for (int c = camera_set_next(pending, -1); c >= 0; c = camera_set_next(pending, c)) {
        g_autoptr(GError) error = NULL;
        if (sequencer_trigger(seq, seq->shot, seq->sub, c, &seq->cameras[c], &error)) {
            camera_set_remove(&seq->pending, c);
            camera_set_add(&seq->exposing, c);
            camera_set_add(&seq->waiting, c);
            continue;
        }
        if (!sequencer_count_gone(seq, c, &seq->cameras[c], error))
            return;
    }
    if (camera_set_is_empty(seq->waiting)) {
        seq->state = PREPARING;
        prepare(seq);
    }
}

static void timer_due(gpointer data) {
    Sequencer *seq = data;
    seq->timer = 0;
    sequencer_advance(seq);
}

static void prepare(Sequencer *seq) {
    struct stage_goal goal = goal_of(seq, seq->shot, seq->sub);
    gint64 ready_us;
    stage_pursue(seq->stage, &goal);
    if (seq->state != PREPARING || !stage_has_reached(seq->stage, &goal, &ready_us))
        return;
    clock_cancel(seq->devices->clock, &seq->timer);
    for (int c = camera_set_next(seq->pending, -1); c >= 0; c = camera_set_next(seq->pending, c))
        ready_us = MAX(ready_us, seq->units[c].rest_until_us);
    if (ready_us > clock_now_us(seq->devices->clock))
        seq->timer = clock_call_at(seq->devices->clock, ready_us, timer_due, seq);
    else if (!seq->hooks.may_trigger(seq->hooks.data))
        return;
    else if (seq->pass.n > 0)
        sequencer_pass_start(seq);
    else
        trigger_pending(seq);
}

static void start_shots(Sequencer *seq) {
    seq->state = PREPARING;
    seq->hooks.homed(seq->hooks.data);
    if (seq->state != PREPARING)
        return;
    if (begin_shot(seq))
        prepare(seq);
    else
        sequencer_finish(seq);
}

void sequencer_go_on(Sequencer *seq) {
    struct stage_goal goal = goal_after(seq);
    stage_pursue(seq->stage, &goal);
}

void sequencer_advance(Sequencer *seq) {
    if (seq->state == HOMING && stage_is_homed(seq->stage)) {
        start_shots(seq);
    } else if (seq->state == PREPARING) {
        prepare(seq);
    } else if (seq->state == EXPOSING && camera_set_is_empty(seq->exposing)) {
        sequencer_go_on(seq);
    } else if (seq->state == PASSING) {
        sequencer_pass_step(seq);
    }
}

void sequencer_next_shot(Sequencer *seq) {
    seq->state = PREPARING;
    if (seq->pausing || !begin_shot(seq))
        sequencer_finish(seq);
    else
        prepare(seq);
}

/* Called when all cameras have answered for a picture. If frames were refused, the picture is taken
 * again with their cameras. Otherwise the next picture or shot follows. */
static void picture_over(Sequencer *seq) {
    seq->state = PREPARING;
    const gboolean taken = camera_set_is_empty(seq->pending);
    if (taken && seq->sub + 1 < seq->n_subs) {
        seq->sub++;
        seq->pending = seq->shot->cameras;
    } else if (taken) {
        sequencer_next_shot(seq);
        return;
    }
    prepare(seq);
}

static void answered(Sequencer *seq, int camera) {
    const gboolean was_exposing = !camera_set_is_empty(seq->exposing);
    camera_set_remove(&seq->exposing, camera);
    camera_set_remove(&seq->waiting, camera);
    if (camera_set_is_empty(seq->waiting))
        picture_over(seq);
    else if (was_exposing && camera_set_is_empty(seq->exposing))
        sequencer_advance(seq);
}

/* The saturated picture is kept if no shorter exposure is possible, or if the exposure was already
 * shortened as often as the session allows. A highlight must not end an unattended capture. */
gboolean sequencer_shorten(Sequencer *seq, const struct session_shot *shot, int sub, int camera,
                           struct sequencer_camera *state, const Frame *frame) {
    const gint64 us = sequencer_exposure_us(seq, shot, sub, state);
    if (shot->kind != SHOT_LAMP || sub != 0 || state->shortened >= seq->conf->retries ||
        !camera_can_expose(seq->devices->cameras[camera], us / 4))
        return FALSE;
    const double pct =
        100.0 * (double)radiance_saturated(frame) / ((double)frame->width * frame->height);
    if (pct <= seq->conf->saturated_pct)
        return FALSE;
    state->shortened++;
    state->retakes++;
    g_autofree char *why =
        g_strdup_printf("%.2g %% of the picture's pixels are saturated at %" G_GINT64_FORMAT
                        " µs; the picture is taken again at %" G_GINT64_FORMAT " µs",
                        pct, us, us / 4);
    seq->hooks.retake(camera, why, sequencer_exposure_us(seq, shot, sub, state), seq->hooks.data);
    return TRUE;
}

static void take_frame(Sequencer *seq, int camera, Frame *frame) {
    struct sequencer_camera *state = &seq->cameras[camera];
    state->refused = 0;
    if (sequencer_shorten(seq, seq->shot, seq->sub, camera, state, frame)) {
        if (seq->state != EXPOSING)
            return;
        camera_set_add(&seq->pending, camera);
        answered(seq, camera);
        return;
    }
    const struct taken_frame taken = {
        .shot = seq->shot,
        .sub = seq->sub,
        .frame = frame,
        .row = {.shot = seq->shot->id, .camera = camera, .retakes = state->retakes},
    };
    seq->hooks.frame(&taken, seq->hooks.data);
    if (seq->state == EXPOSING)
        answered(seq, camera);
}

static void take_again(Sequencer *seq, int camera, const GError *error) {
    if (!sequencer_count_refusal(seq, camera, &seq->cameras[camera], error) ||
        seq->state != EXPOSING)
        return;
    camera_set_add(&seq->pending, camera);
    answered(seq, camera);
}

static void on_camera(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                      gpointer data) {
    const struct sequencer_unit *unit = data;
    Sequencer *seq = unit->sequencer;
    int c = unit->camera;
    while (c < seq->devices->geometry.n_cameras && seq->devices->cameras[c] == camera &&
           !camera_set_has(seq->waiting, c))
        /* The stops of a camera on the arm are separate cameras of the rig. This loop finds the
         * stop whose frame is awaited. */
        c++;
    const gboolean passing = seq->state == PASSING;
    if ((seq->state != EXPOSING && !passing) || c >= seq->devices->geometry.n_cameras ||
        seq->devices->cameras[c] != camera)
        return;
    switch (event) {
    case CAMERA_EXPOSED:
        camera_set_remove(&seq->exposing, c);
        if (camera_set_is_empty(seq->exposing))
            sequencer_advance(seq);
        break;
    case CAMERA_FRAME:
        (passing ? sequencer_pass_take : take_frame)(seq, c, frame);
        break;
    case CAMERA_FAULT:
        camera_disarm(camera); /* sequencer_make_ready() arms it again */
        (passing ? sequencer_pass_refused : take_again)(seq, c, error);
        break;
    case CAMERA_REFUSED:
        (passing ? sequencer_pass_refused : take_again)(seq, c, error);
        break;
    }
}

static void on_stage_changed(gpointer data) {
    sequencer_advance(data);
}

static void on_stage_fault(const char *source, const char *reason, gpointer data) {
    Sequencer *seq = data;
    if (seq->state != IDLE)
        sequencer_fail(seq, source, reason, TRUE);
}

static void on_stage_unsafe(const char *source, const char *reason, gpointer data) {
    Sequencer *seq = data;
    seq->hooks.unsafe(source, reason, seq->hooks.data);
}

Sequencer *sequencer_new(struct devices *devices, const struct session_conf *conf,
                         const struct sequencer_hooks *hooks) {
    Sequencer *seq = g_new0(Sequencer, 1);
    struct stage_hooks stage_hooks = {on_stage_changed, on_stage_fault, on_stage_unsafe, seq};
    seq->devices = devices;
    seq->conf = conf;
    seq->hooks = *hooks;
    seq->stage = stage_new(devices, &stage_hooks);
    for (int c = 0; c < devices->geometry.n_cameras; c++) {
        seq->units[c] = (struct sequencer_unit){.sequencer = seq, .camera = c};
        /* All stops of a camera have one listener, because on_camera() finds the stop. */
        if (devices_is_unit(&devices->geometry, c))
            camera_listen(devices->cameras[c], on_camera, &seq->units[c]);
    }
    return seq;
}

void sequencer_free(Sequencer *seq) {
    if (!seq)
        return;
    clock_cancel(seq->devices->clock, &seq->timer);
    for (int c = 0; c < seq->devices->geometry.n_cameras; c++)
        camera_listen(seq->devices->cameras[c], NULL, NULL);
    sequencer_pass_clear(seq);
    stage_free(seq->stage);
    g_free(seq);
}

void sequencer_start(Sequencer *seq, const GPtrArray *shots) {
    g_return_if_fail(seq->state == IDLE);
    seq->shots = shots;
    seq->next = 0;
    seq->pausing = FALSE;
    for (int c = 0; c < RIG_MAX_CAMERAS; c++)
        seq->units[c].rest_until_us = 0;
    seq->state = HOMING;
    const Interlock *open = stage_open_interlock(seq->stage);
    if (open) {
        g_autofree char *reason = interlock_advice(open);
        sequencer_fail(seq, open->device.name, reason, TRUE);
        return;
    }
    stage_home(seq->stage);
    sequencer_advance(seq); /* a rig without axes is homed immediately */
}

void sequencer_pause(Sequencer *seq) {
    seq->pausing = TRUE;
    gboolean untouched = seq->state == PREPARING && seq->sub == 0 && seq->shot &&
                         (seq->pass.n > 0 ? sequencer_pass_is_untouched(seq)
                                          : camera_set_equal(seq->pending, seq->shot->cameras));
    if (seq->state == HOMING || untouched)
        sequencer_finish(seq);
    else if (seq->state == PASSING)
        sequencer_pass_step(seq);
}

void sequencer_poke(Sequencer *seq) {
    sequencer_advance(seq);
}

const Interlock *sequencer_open_interlock(const Sequencer *seq) {
    return stage_open_interlock(seq->stage);
}

const struct session_shot *sequencer_last_shot(const Sequencer *seq) {
    return seq->last_shot;
}

const struct session_shot *sequencer_shot(const Sequencer *seq, int *ret_sub, int *ret_n) {
    *ret_sub = seq->sub;
    *ret_n = seq->n_subs;
    return seq->shot;
}
