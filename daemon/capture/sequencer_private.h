/* The struct and the functions that sequencer.c and sequencer_pass.c share. sequencer.c takes
 * pictures while the turntable stands, and sequencer_pass.c takes the pictures of a pass
 * (plan/passes.h). */
#pragma once

#include "sequencer.h"
#include "stage.h"

enum state { IDLE, HOMING, PREPARING, EXPOSING, PASSING };

struct sequencer_camera { /* state of a camera in a shot */
    int refused;          /* number of refusals in a row */
    int retakes;          /* number of repetitions in this shot */
    /* number of times in this shot that the first exposure, which is the shortest, was shortened to
     * a quarter */
    int shortened;
};

struct sequencer_unit { /* a camera */
    Sequencer *sequencer;
    int camera;
    gint64 rest_until_us;
    guint passing; /* in a pass, the index of the shot that was triggered last */
};

struct pass_shot { /* a shot of the pass that is under way */
    const struct session_shot *shot;
    struct camera_set pending; /* cameras that have not taken the shot yet */
    struct sequencer_camera cameras[RIG_MAX_CAMERAS];
};

/* The pass under way. If a picture of the pass has to be repeated, the turntable turns through the
 * pass again. */
struct sequencer_pass {
    struct pass_shot *shots;
    guint n;           /* 0 if there is no pass */
    guint next;        /* index of the shot that is triggered next in this turn */
    gboolean progress; /* whether a picture was accepted in this turn */
    int fruitless;     /* number of turns in a row without an accepted picture */
    /* of struct told_frame: frames whose poses the turntable has not reported yet */
    GQueue told;
};

struct Sequencer {
    struct devices *devices;
    const struct session_conf *conf;
    struct sequencer_hooks hooks;
    Stage *stage;
    enum state state;
    gboolean pausing;
    const GPtrArray *shots;
    guint next; /* index of the shot after the one under way */
    /* shot is the shot under way, or NULL. last_shot is the shot that was begun last, which may be
     * the one under way. */
    const struct session_shot *shot, *last_shot;
    int sub, n_subs;
    /* cameras that must still be triggered for this picture, or in this pass */
    struct camera_set pending;
    struct camera_set exposing; /* cameras that were triggered; the lamp must stay on */
    struct camera_set waiting;  /* cameras that were triggered and have delivered no frame yet */
    struct sequencer_unit units[RIG_MAX_CAMERAS];
    /* state of each camera in the shot under way; in a pass, pass.shots has these states */
    struct sequencer_camera cameras[RIG_MAX_CAMERAS];
    struct sequencer_pass pass;
    guint timer;
};

/* Stops everything and reports a fault. */
void sequencer_fail(Sequencer *seq, const char *source, const char *reason, gboolean rig);
/* Makes the rig safe and calls the hook `finished`, or the hook `fault` if a device is not safe. To
 * be called when all shots are taken or, if a pause was requested, when the shot under way is
 * taken. */
void sequencer_finish(Sequencer *seq);
/* Takes the next steps that are possible now. */
void sequencer_advance(Sequencer *seq);
/* Moves the stage to the goal that follows the picture under way. */
void sequencer_go_on(Sequencer *seq);
/* Begins the next shot, or finishes if there is none or a pause was requested. To be called when
 * all pictures of the present shot or pass are taken. */
void sequencer_next_shot(Sequencer *seq);

/* sequencer_make_ready() configures and arms a camera for a picture. sequencer_trigger() does the
 * same, and then triggers the camera. Both return FALSE with an error if the camera does not accept
 * this. sequencer_exposure_us() returns the exposure of the picture. sub is the index of the
 * picture in the shot, and state is the camera's state in the shot. */
gboolean sequencer_make_ready(Sequencer *seq, const struct session_shot *shot, int sub, int camera,
                              const struct sequencer_camera *state, GError **error);
gboolean sequencer_trigger(Sequencer *seq, const struct session_shot *shot, int sub, int camera,
                           const struct sequencer_camera *state, GError **error);
gint64 sequencer_exposure_us(const Sequencer *seq, const struct session_shot *shot, int sub,
                             const struct sequencer_camera *state);
/* Counts a refused picture. Returns FALSE if this has stopped everything, because no attempts are
 * left or because the hook `retake` has stopped the sequencer. */
gboolean sequencer_count_refusal(Sequencer *seq, int camera, struct sequencer_camera *state,
                                 const GError *error);
/* Counts a failed trigger of a camera like a refused picture. The camera is triggered again after a
 * pause. Returns what sequencer_count_refusal() returns. */
gboolean sequencer_count_gone(Sequencer *seq, int camera, struct sequencer_camera *state,
                              const GError *error);
/* Returns whether a picture must be repeated with a shorter exposure because it is saturated, and
 * reports that. */
gboolean sequencer_shorten(Sequencer *seq, const struct session_shot *shot, int sub, int camera,
                           struct sequencer_camera *state, const Frame *frame);

/* The following functions are in sequencer_pass.c. sequencer_pass_begin() begins a pass. Its first
 * shot is the shot under way, and its other shots are those that follow in seq->shots and have the
 * same pass. */
void sequencer_pass_begin(Sequencer *seq);
void sequencer_pass_clear(Sequencer *seq);
/* Starts the turn of the turntable. To be called when the stage has reached the angle at which the
 * pass begins. */
void sequencer_pass_start(Sequencer *seq);
/* To be called when the turntable has reported its position or has stopped, and when a camera has
 * answered. */
void sequencer_pass_step(Sequencer *seq);
/* Called when a camera has delivered a frame of the pass, or an error instead of it.
 * sequencer_pass_take() takes a reference of the frame. */
void sequencer_pass_take(Sequencer *seq, int camera, Frame *frame);
void sequencer_pass_refused(Sequencer *seq, int camera, const GError *error);
/* Returns whether no picture of the pass has been taken yet, so that the capture can pause
 * immediately. */
gboolean sequencer_pass_is_untouched(const Sequencer *seq);
