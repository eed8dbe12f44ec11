/* Takes shots in order. The sequencer homes the axes, moves the stage to the pose of each picture,
 * triggers the cameras, and passes on every accepted frame. As soon as the cameras have exposed,
 * the stage moves to the next picture while the frames are read out.
 *
 * Shots of a pass (struct session_pass) are taken while the turntable turns. Each camera is then
 * triggered so that the turntable passes the shot's angle in the middle of the exposure.
 *
 * The sequencer is a state machine driven by the devices' events. Every wait for a device has a
 * deadline, which the class of the device sets. All functions belong to the main loop's thread. */
#pragma once

#include "intake/taken_frame.h"
#include "plan/plan.h"

typedef struct Sequencer Sequencer;

struct sequencer_hooks {
    void (*homed)(gpointer data);
    /* Called before cameras are triggered. If it returns FALSE, the cameras are not triggered until
     * sequencer_poke() makes the sequencer call it again. */
    gboolean (*may_trigger)(gpointer data);
    /* Called with an accepted frame. taken is valid during the call. The frames that one camera
     * takes in a shot come in order of taken->sub. In a pass, the frames of one camera come in the
     * order of the shots. A frame that is taken again in another turn comes later. */
    void (*frame)(const struct taken_frame *taken, gpointer data);
    /* Called when a picture was refused or lost and is repeated. shortened_us is the exposure of
     * the repetition if the picture was saturated, otherwise 0. */
    void (*retake)(int camera, const char *why, gint64 shortened_us, gpointer data);
    /* Called when all shots are taken, or after sequencer_pause() when the shot under way is taken.
     * The rig is safe. */
    void (*finished)(gpointer data);
    /* Called when a fault has stopped everything. source is the name of the device, or "rig". The
     * rig is safe, or reason contains DEVICES_UNSAFE. `rig` is TRUE if another session would fail
     * as well, and FALSE if a camera that is present gave no good picture. */
    void (*fault)(const char *source, const char *reason, gboolean rig, gpointer data);
    /* Called while no shots are being taken, if a lamp or laser that was commanded off has not
     * confirmed that it is off. */
    void (*unsafe)(const char *source, const char *reason, gpointer data);
    gpointer data;
};

/* Creates a sequencer. Borrows devices and conf. */
Sequencer *sequencer_new(struct devices *devices, const struct session_conf *conf,
                         const struct sequencer_hooks *hooks);
void sequencer_free(Sequencer *sequencer); /* NULL is ignored; the rig is not made safe */

/* Homes the axes, then takes the shots. Must not be called while shots are being taken. Borrows
 * shots, an array of const struct session_shot *, until the hook `finished` or the hook `fault` was
 * called, or sequencer_stop() has returned. */
void sequencer_start(Sequencer *sequencer, const GPtrArray *shots);
/* Takes no further shot after the shot under way, and then calls the hook `finished`. Calls it
 * immediately if the axes are being homed, or if no camera has been triggered for that shot yet. */
void sequencer_pause(Sequencer *sequencer);
/* Makes the sequencer call the hook `may_trigger` again. */
void sequencer_poke(Sequencer *sequencer);

/* Stops immediately: commands the safe state, drops the frames under way, and calls no hook. Does
 * not wait for the devices. Returns FALSE with an error if a device could not be commanded. */
gboolean sequencer_stop(Sequencer *sequencer, GError **error);

/* Returns an interlock that is open, or NULL if every interlock is closed. */
const Interlock *sequencer_open_interlock(const Sequencer *sequencer);

/* Returns the shot under way, or the last shot if none is under way. Returns NULL if no shot was
 * begun. Borrowed from the array of shots. */
const struct session_shot *sequencer_last_shot(const Sequencer *sequencer);

/* Returns the shot under way, or NULL. *ret_sub is the index of the picture under way among the
 * *ret_n pictures of the shot. */
const struct session_shot *sequencer_shot(const Sequencer *sequencer, int *ret_sub, int *ret_n);
