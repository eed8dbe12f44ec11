/*
 * Takes shots in order: homes the axes, brings the stage to where each picture is taken, triggers
 * the cameras, and hands on every accepted frame. As soon as the cameras have exposed, the stage
 * goes on to the next picture while frames are read out. Shots of a pass (struct session_pass) are
 * taken while the turntable turns: cameras are triggered such that it passes the shot's angle in
 * the middle of the exposure. A state machine driven by the devices' events; every wait has the
 * deadline of the class it waits for. Main loop's thread.
 */
#pragma once

#include "plan/plan.h"

typedef struct Sequencer Sequencer;

struct sequencer_taken {
    int camera, sub, retakes; /* retakes: of this camera in this shot */
    gboolean turned;          /* it was exposed in a pass: */
    double turntable_deg;     /* where the table was in the middle of the exposure */
};

struct sequencer_hooks {
    void (*homed)(gpointer data);
    /* Asked before cameras are triggered; if FALSE, sequencer_poke() says when to ask again. */
    gboolean (*may_trigger)(gpointer data);
    /* An accepted frame, in order of sub for each camera. Frames of a pass come shot by shot for
     * each camera, but for those that another turn takes. */
    void (*frame)(const struct session_shot *shot, const struct sequencer_taken *taken,
                  Frame *frame, gpointer data);
    /* A picture was refused or lost and is taken again; shortened_us: the exposure that it is taken
     * again with since it was saturated, or 0. */
    void (*retake)(int camera, const char *why, gint64 shortened_us, gpointer data);
    /* All shots are taken, or the one under way after sequencer_pause(). The rig is safe. */
    void (*finished)(gpointer data);
    /* Everything has stopped; the rig is safe, or reason contains DEVICES_UNSAFE. rig: another
     * session would fail, too; FALSE if a camera that is there gave no good picture. */
    void (*fault)(const char *source, const char *reason, gboolean rig, gpointer data);
    /* While nothing runs: a lamp or laser that was commanded off has not confirmed it. */
    void (*unsafe)(const char *source, const char *reason, gpointer data);
    gpointer data;
};

/* Borrows devices and conf. */
Sequencer *sequencer_new(struct devices *devices, const struct session_conf *conf,
                         const struct sequencer_hooks *hooks);
void sequencer_free(Sequencer *sequencer); /* NULL is ignored; does not make the rig safe */

/* Homes, then takes the shots; not while something is under way. Borrows shots, an array of
 * const struct session_shot *, until it is finished, stopped or faulted. */
void sequencer_start(Sequencer *sequencer, const GPtrArray *shots);
void sequencer_pause(Sequencer *sequencer);
void sequencer_poke(Sequencer *sequencer);

/* Now: the rig is made safe, frames on their way are forgotten, no hook is called. */
gboolean sequencer_stop(Sequencer *sequencer, GError **error);

const Interlock *sequencer_open_interlock(const Sequencer *sequencer);

/* The shot under way, or the one before; NULL: none was begun. Borrowed from the shots. */
const struct session_shot *sequencer_last_shot(const Sequencer *sequencer);

/* The shot under way, or NULL; and which of its pictures. */
const struct session_shot *sequencer_shot(const Sequencer *sequencer, int *ret_sub, int *ret_n);
