/*
 * Shared by sequencer.c, which takes pictures of a table that stands, and sequencer_pass.c, which
 * takes those of a pass (passes/passes.h).
 */
#pragma once

#include "sequencer.h"
#include "stage.h"

enum state { IDLE, HOMING, PREPARING, EXPOSING, PASSING };

struct sequencer_camera { /* state of a camera in a shot */
    int refused;          /* in a row */
    int retakes;          /* in this shot */
    int shortened;        /* in this shot: each time to a quarter of the shortest exposure */
};

struct sequencer_unit { /* a camera */
    Sequencer *sequencer;
    int camera;
    gint64 rest_until_us;
    guint passing; /* in a pass: index of the shot that it takes */
};

struct pass_shot { /* a shot of the pass under way */
    const struct session_shot *shot;
    guint32 pending; /* cameras that have not taken it yet */
    struct sequencer_camera cameras[RIG_MAX_CAMERAS];
};

/* The pass under way. If a picture of it has to be taken again, the table passes again. */
struct sequencer_pass {
    struct pass_shot *shots;
    guint n;           /* 0: there is no pass */
    guint next;        /* which is triggered next, in this turn */
    gboolean progress; /* a picture was accepted in this turn */
    int fruitless;     /* turns in a row without one */
    GQueue told;       /* of struct told_frame: their poses are not told yet */
};

struct Sequencer {
    struct devices *devices;
    const struct session_conf *conf;
    struct sequencer_hooks hooks;
    Stage *stage;
    enum state state;
    gboolean pausing;
    const GPtrArray *shots;
    guint next;                                  /* index of the shot after the one under way */
    const struct session_shot *shot, *last_shot; /* last_shot: the same, or the last one */
    int sub, n_subs;
    guint32 pending;  /* cameras still to be triggered for this picture, or in this pass */
    guint32 exposing; /* triggered; the lamp must stay on */
    guint32 waiting;  /* triggered, no frame yet */
    struct sequencer_unit units[RIG_MAX_CAMERAS];
    struct sequencer_camera cameras[RIG_MAX_CAMERAS]; /* in the shot, unless it is of a pass */
    struct sequencer_pass pass;
    guint timer;
};

/* Everything is stopped: a fault. */
void sequencer_fail(Sequencer *seq, const char *source, const char *reason, gboolean rig);
/* All is taken, or the last before a pause. */
void sequencer_finish(Sequencer *seq);
/* The next steps that are possible now. */
void sequencer_advance(Sequencer *seq);
/* The stage goes on to what follows the picture under way. */
void sequencer_go_on(Sequencer *seq);
/* All pictures of the shot or pass are taken: the next one, or the end. */
void sequencer_next_shot(Sequencer *seq);

/* Sets a camera up for a picture; state: its in the shot. Also triggers it. */
gboolean sequencer_make_ready(Sequencer *seq, const struct session_shot *shot, int sub, int camera,
                              const struct sequencer_camera *state, GError **error);
gboolean sequencer_trigger(Sequencer *seq, const struct session_shot *shot, int sub, int camera,
                           const struct sequencer_camera *state, GError **error);
gint64 sequencer_exposure_us(const Sequencer *seq, const struct session_shot *shot, int sub,
                             const struct sequencer_camera *state);
/* FALSE: no attempts are left, and everything has been stopped. */
gboolean sequencer_count_refusal(Sequencer *seq, int camera, struct sequencer_camera *state,
                                 const GError *error);
/* The same for a camera that cannot be triggered: it is tried again after a pause. */
gboolean sequencer_count_gone(Sequencer *seq, int camera, struct sequencer_camera *state,
                              const GError *error);
/* Whether a picture is to be taken again with a shorter exposure, since it is saturated: tells so.
 */
gboolean sequencer_shorten(Sequencer *seq, const struct session_shot *shot, int sub, int camera,
                           struct sequencer_camera *state, const Frame *frame);

/* sequencer_pass.c: begins with the shot under way, the first of those of its pass that this run
 * takes; takes the others from the shots that follow. */
void sequencer_pass_begin(Sequencer *seq);
void sequencer_pass_clear(Sequencer *seq);
/* The stage has reached the place where the pass begins: the table turns. */
void sequencer_pass_start(Sequencer *seq);
/* The table has told where it is, or stands; a camera has answered. */
void sequencer_pass_step(Sequencer *seq);
/* The frame of a camera, of which this takes a reference, or why there is none. */
void sequencer_pass_take(Sequencer *seq, int camera, Frame *frame);
void sequencer_pass_refused(Sequencer *seq, int camera, const GError *error);
/* Nothing of it has been taken in part, so that it can be left as it is. */
gboolean sequencer_pass_is_untouched(const Sequencer *seq);
