/* Takes the shots of a pass: the turntable ("table") turns, and each camera is triggered so early
 * that the table reaches the shot's angle in the middle of the exposure. Pictures that were not
 * taken, or were refused, are taken in another turn. That turn starts at the same angle and has the
 * same speed, so that the picture is the same as in the first turn. */
#include "sequencer_private.h"

#include <math.h>

/* Maximum distance of the table from the planned angle in the middle of an exposure. Frames that
 * exceed it are taken again. */
#define MAX_OFF_DEG 0.5

/* Differences from the planned angle are rounded to multiples of 2^−13° = 1/8192°, which is far
 * below the resolution of any axis. Positions that an axis reports are decimal fractions, which are
 * hardly ever in the middle between two such multiples. The same pass therefore gives the same
 * values in spite of rounding errors. */
#define POSE_BITS 13

/* A trigger that is late by more than this is omitted. The picture is then taken in another
 * turn. */
#define LATE_US 1000

struct told_frame { /* a frame whose angle the turntable has not reported yet */
    guint shot;     /* index of the shot in the pass */
    int camera;
    Frame *frame;
};

static void told_free(gpointer data) {
    struct told_frame *told = data;
    frame_unref(told->frame);
    g_free(told);
}

void sequencer_pass_clear(Sequencer *seq) {
    g_queue_clear_full(&seq->pass.told, told_free);
    g_clear_pointer(&seq->pass.shots, g_free);
    seq->pass = (struct sequencer_pass){.told = G_QUEUE_INIT};
}

/* Returns the cameras that still have pictures to take in this pass. */
static struct camera_set pass_pending(const Sequencer *seq) {
    struct camera_set pending = {{0}};
    for (guint i = 0; i < seq->pass.n; i++)
        pending = camera_set_union(pending, seq->pass.shots[i].pending);
    return pending;
}

void sequencer_pass_begin(Sequencer *seq) {
    struct sequencer_pass *pass = &seq->pass;
    const guint first = seq->next - 1;
    guint end = seq->next;
    while (end < seq->shots->len &&
           session_follows_in_pass(seq->shots->pdata[end - 1], seq->shots->pdata[end]))
        end++;
    sequencer_pass_clear(seq);
    pass->n = end - first;
    pass->shots = g_new0(struct pass_shot, pass->n);
    for (guint i = 0; i < pass->n; i++) {
        pass->shots[i].shot = seq->shots->pdata[first + i];
        pass->shots[i].pending = pass->shots[i].shot->cameras;
    }
    seq->next = end;
    seq->pending = pass_pending(seq);
}

static gboolean pass_is_begun(const struct pass_shot *shot) {
    return !camera_set_is_empty(shot->pending) &&
           !camera_set_equal(shot->pending, shot->shot->cameras);
}

gboolean sequencer_pass_is_untouched(const Sequencer *seq) {
    for (guint i = 0; i < seq->pass.n; i++)
        if (!camera_set_equal(seq->pass.shots[i].pending, seq->pass.shots[i].shot->cameras))
            return FALSE;
    return TRUE;
}

/* Returns whether a shot is to be triggered in this turn. After a pause was requested, this is so
 * only for a shot that some of its cameras have taken and others have not. */
static gboolean pass_wants(const Sequencer *seq, const struct pass_shot *shot) {
    return !camera_set_is_empty(shot->pending) && (!seq->pausing || pass_is_begun(shot));
}

static void pass_find_next(Sequencer *seq) {
    struct sequencer_pass *pass = &seq->pass;
    while (pass->next < pass->n && !pass_wants(seq, &pass->shots[pass->next]))
        pass->next++;
    if (pass->next < pass->n)
        seq->shot = seq->last_shot = pass->shots[pass->next].shot;
}

/* Makes all cameras ready before the turn begins, because some cameras need more time for this than
 * there is between two shots. Returns FALSE if a camera does not respond. */
static gboolean pass_arm(Sequencer *seq) {
    for (guint i = 0; i < seq->pass.n; i++)
        for (int c = 0; c < seq->devices->geometry.n_cameras; c++) {
            struct pass_shot *shot = &seq->pass.shots[i];
            g_autoptr(GError) error = NULL;
            if (!pass_wants(seq, shot) || !camera_set_has(shot->pending, c) ||
                camera_is_armed(seq->devices->cameras[c]) ||
                sequencer_make_ready(seq, shot->shot, 0, c, &shot->cameras[c], &error))
                continue;
            sequencer_count_gone(seq, c, &shot->cameras[c], error);
            return FALSE;
        }
    return TRUE;
}

void sequencer_pass_start(Sequencer *seq) {
    struct sequencer_pass *pass = &seq->pass;
    const struct session_pass *way = &pass->shots[0].shot->pass;
    if (!pass_arm(seq)) {
        if (seq->state == PREPARING)
            sequencer_advance(seq);
        return;
    }
    seq->state = PASSING;
    pass->next = 0;
    pass->progress = FALSE;
    pass_find_next(seq);
    stage_turn(seq->stage, way->by_deg, way->speed_deg_s);
}

/* Computes the time at which the cameras must be triggered for a shot. Returns FALSE if the time is
 * not known yet, or if it is so far away that later reports of the position can make it more
 * accurate. */
static gboolean pass_trigger_at(const Sequencer *seq, const struct pass_shot *shot,
                                gint64 *ret_us) {
    const struct axis_motion *motion = &seq->devices->turntable->motion;
    const double at_deg = passes_at_deg(&shot->shot->pass, shot->shot->turntable_deg);
    /* The plan counts the angle from the planned beginning of the pass, the axis counts it from the
     * angle at which it stood. */
    const double turned = at_deg - shot->shot->pass.from_deg;
    gint64 lead_us = 0, us;
    if (!axis_passes_at(seq->devices->turntable,
                        axis_turned_from_deg(seq->devices->turntable) + turned, &us))
        return FALSE;
    for (int c = 0; c < seq->devices->geometry.n_cameras; c++)
        if (camera_set_has(shot->pending, c))
            lead_us =
                MAX(lead_us, seq->devices->cameras[c]->format.trigger_us +
                                 sequencer_exposure_us(seq, shot->shot, 0, &shot->cameras[c]) / 2);
    *ret_us = us - lead_us;
    /* Wait while at least two more reports of the position will arrive before that time. */
    return *ret_us - clock_now_us(seq->devices->clock) <= (gint64)(2e3 * motion->report_ms);
}

static void pass_trigger(Sequencer *seq, struct pass_shot *shot) {
    for (int c = 0; c < seq->devices->geometry.n_cameras && seq->state == PASSING; c++) {
        g_autoptr(GError) error = NULL;
        if (!camera_set_has(shot->pending, c) || camera_set_has(seq->waiting, c))
            /* This camera has no picture to take, or its last frame has not arrived yet. In the
             * second case, the picture is taken in a later turn of the table. */
            continue;
        if (sequencer_trigger(seq, shot->shot, 0, c, &shot->cameras[c], &error)) {
            camera_set_add(&seq->exposing, c);
            camera_set_add(&seq->waiting, c);
            seq->units[c].passing = seq->pass.next;
            continue;
        }
        if (!sequencer_count_gone(seq, c, &shot->cameras[c], error))
            return;
    }
}

static void pass_on_timer(gpointer data) {
    Sequencer *seq = data;
    seq->timer = 0;
    pass_find_next(seq);
    if (seq->pass.next < seq->pass.n && seq->hooks.may_trigger(seq->hooks.data))
        pass_trigger(seq, &seq->pass.shots[seq->pass.next]);
    seq->pass.next++;
    if (seq->state == PASSING)
        sequencer_pass_step(seq);
}

/* Sets the timer to the trigger time of the next shot if this time is known. Skips shots whose time
 * has passed. */
static void pass_schedule(Sequencer *seq) {
    struct sequencer_pass *pass = &seq->pass;
    gint64 at_us;
    for (pass_find_next(seq); pass->next < pass->n && seq->timer == 0; pass_find_next(seq)) {
        if (!pass_trigger_at(seq, &pass->shots[pass->next], &at_us))
            return;
        if (at_us >= clock_now_us(seq->devices->clock) - LATE_US)
            seq->timer = clock_call_at(seq->devices->clock, at_us, pass_on_timer, seq);
        else
            pass->next++;
    }
}

/* Passes on an accepted frame. off_deg is the difference of the table's angle in the middle of the
 * exposure from the planned angle. */
static void pass_hand_on(Sequencer *seq, const struct told_frame *told, double off_deg) {
    struct pass_shot *shot = &seq->pass.shots[told->shot];
    const double stored_off_deg = ldexp(rint(ldexp(off_deg, POSE_BITS)), -POSE_BITS);
    const struct taken_frame taken = {
        .shot = shot->shot,
        .frame = told->frame,
        .row = {.shot = shot->shot->id,
                .camera = told->camera,
                .retakes = shot->cameras[told->camera].retakes,
                .turned = TRUE,
                .turntable_deg = shot->shot->turntable_deg + stored_off_deg},
    };
    shot->cameras[told->camera].refused = 0;
    camera_set_remove(&shot->pending, told->camera);
    seq->pass.progress = TRUE;
    seq->hooks.frame(&taken, seq->hooks.data);
}

static void pass_refuse(Sequencer *seq, guint shot, int camera, const GError *error) {
    sequencer_count_refusal(seq, camera, &seq->pass.shots[shot].cameras[camera], error);
}

/* Passes on the frames for which the table has reported its angle during the exposure. Refuses
 * frames that were exposed too far from the planned angle, or for which the table has stopped
 * without such a report. */
static void pass_tell(Sequencer *seq) {
    const Axis *table = seq->devices->turntable;
    while (seq->state == PASSING && !g_queue_is_empty(&seq->pass.told)) {
        struct told_frame *told = g_queue_peek_head(&seq->pass.told);
        const struct session_shot *shot = seq->pass.shots[told->shot].shot;
        const Frame *frame = told->frame;
        const gint64 middle_us = (frame->exposure_start_us + frame->exposure_end_us) / 2;
        g_autoptr(GError) error = NULL;
        double deg = NAN;
        const gboolean known = axis_was_at(table, middle_us, &deg);
        if (!known && axis_is_moving(table))
            return;
        const double off = deg - axis_turned_from_deg(table) -
                           (passes_at_deg(&shot->pass, shot->turntable_deg) - shot->pass.from_deg);
        g_queue_pop_head(&seq->pass.told);
        if (!known)
            device_error_set(
                &error, DEVICE_ERROR_TIMEOUT, table->device.who,
                "it did not report its position during the exposure of a frame" ERROR_ADVICE
                "check its cable, and stamp_ms if it has that option");
        else if (fabs(off) > MAX_OFF_DEG)
            device_error_set(&error, DEVICE_ERROR_STALE, table->device.who,
                             "in the middle of an exposure it was %+.2f° from the planned %g°, and "
                             "at most %g° are allowed" ERROR_ADVICE
                             "check trigger_ms of the camera, if it has that option",
                             off, shot->turntable_deg, MAX_OFF_DEG);
        if (error)
            pass_refuse(seq, told->shot, told->camera, error);
        else
            pass_hand_on(seq, told, off);
        told_free(told);
    }
}

/* Returns whether the frame that a camera takes in a shot, or the table's angle during its
 * exposure, is still awaited. */
static gboolean pass_awaits(const Sequencer *seq, guint shot, int camera) {
    if (camera_set_has(seq->waiting, camera) && seq->units[camera].passing == shot)
        return TRUE;
    for (const GList *at = seq->pass.told.head; at; at = at->next) {
        const struct told_frame *told = at->data;
        if (told->shot == shot && told->camera == camera)
            return TRUE;
    }
    return FALSE;
}

/* Returns whether another turn is needed even if all awaited frames are accepted. */
static gboolean pass_needs_more(const Sequencer *seq) {
    for (guint i = 0; i < seq->pass.n; i++) {
        const struct pass_shot *shot = &seq->pass.shots[i];
        int c = pass_wants(seq, shot) ? camera_set_next(shot->pending, -1) : -1;
        for (; c >= 0; c = camera_set_next(shot->pending, c))
            if (!pass_awaits(seq, i, c))
                return TRUE;
    }
    return FALSE;
}

/* Called when the table has stopped and all frames have arrived. Prepares another turn if pictures
 * are missing, continues with the next shot if none are missing, or fails after too many turns
 * without an accepted picture. */
static void pass_end(Sequencer *seq) {
    struct sequencer_pass *pass = &seq->pass;
    const gboolean more = pass_needs_more(seq);
    pass->fruitless = pass->progress ? 0 : pass->fruitless + 1;
    if (!more) {
        sequencer_pass_clear(seq);
        seq->pending = (struct camera_set){{0}};
        sequencer_next_shot(seq);
    } else if (pass->fruitless <= seq->conf->retries) {
        pass->next = 0;
        pass_find_next(seq);
        seq->pending = pass_pending(seq);
        seq->state = PREPARING;
        sequencer_advance(seq);
    } else {
        const char *name = seq->devices->turntable->device.name;
        g_autofree char *reason =
            g_strdup_printf("axis %s: it passed %d times without a good picture. Check that it "
                            "reports its position, or set [capture] motion = standing.",
                            name, pass->fruitless);
        sequencer_fail(seq, name, reason, TRUE);
    }
}

void sequencer_pass_step(Sequencer *seq) {
    const Axis *table = seq->devices->turntable;
    pass_tell(seq);
    if (seq->state != PASSING)
        return;
    pass_schedule(seq);
    if (seq->pass.next < seq->pass.n && axis_is_moving(table))
        return;
    if (camera_set_is_empty(seq->exposing) && !pass_needs_more(seq))
        sequencer_go_on(seq);
    if (seq->state != PASSING || !camera_set_is_empty(seq->waiting) ||
        !g_queue_is_empty(&seq->pass.told))
        return;
    if (!axis_is_moving(table))
        pass_end(seq);
    else if (seq->pausing && !pass_needs_more(seq))
        sequencer_finish(seq); /* which stops the table */
}

void sequencer_pass_take(Sequencer *seq, int camera, Frame *frame) {
    const guint index = seq->units[camera].passing;
    struct pass_shot *shot = &seq->pass.shots[index];
    camera_set_remove(&seq->exposing, camera);
    camera_set_remove(&seq->waiting, camera);
    if (!sequencer_shorten(seq, shot->shot, 0, camera, &shot->cameras[camera], frame)) {
        struct told_frame *told = g_new(struct told_frame, 1);
        *told = (struct told_frame){index, camera, frame_ref(frame)};
        g_queue_push_tail(&seq->pass.told, told);
    } else {
        seq->pass.progress = TRUE;
    }
    if (seq->state == PASSING)
        sequencer_pass_step(seq);
}

void sequencer_pass_refused(Sequencer *seq, int camera, const GError *error) {
    camera_set_remove(&seq->exposing, camera);
    camera_set_remove(&seq->waiting, camera);
    pass_refuse(seq, seq->units[camera].passing, camera, error);
    if (seq->state == PASSING)
        sequencer_pass_step(seq);
}
