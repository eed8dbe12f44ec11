/* Positions of the axes and states of the lights. The sequencer sets a goal. The stage moves every
 * axis to its goal, and switches every light that is not in the state of the goal. It commands each
 * device as soon as this device is free. All functions belong to the main loop's thread. */
#pragma once

#include "rig/devices.h"

struct stage_goal {
    double turntable_deg, arc_deg, arm_deg, probe_deg;
    /* Index of the lamp that is lit, and index of the laser that is lit; −1 if none is. For a laser
     * that is mounted by hand, this is the index of its unit. For a lamp on the probe, it is the
     * index of the lamp's first stop. */
    int lamp, laser;
    int sweep; /* the laser whose sweep axis must stand at sweep_deg; −1 if none */
    double sweep_deg;
};

struct stage_hooks {
    /* called when an axis has arrived, is homed or reports its position during stage_turn(), and
     * when a light was switched */
    void (*changed)(gpointer data);
    /* Called on a fault. reason says what happened, on which device, and what to do. May be called
     * from within stage_home() and stage_pursue(). */
    void (*fault)(const char *source, const char *reason, gpointer data);
    /* Called while the stage is inactive, if a light that was commanded off has not confirmed that
     * it is off. */
    void (*unsafe)(const char *source, const char *reason, gpointer data);
    gpointer data;
};

typedef struct Stage Stage;

Stage *stage_new(struct devices *devices, const struct stage_hooks *hooks);
void stage_free(Stage *stage); /* switches and moves nothing; NULL is ignored */

/* Returns an interlock that is open, or NULL if every interlock is closed. */
const Interlock *stage_open_interlock(const Stage *stage);

/* Homes all axes together, each as soon as it stands still. Commands all lights off that may be on.
 * The stage is homed when all axes are homed and all lights are off. */
void stage_home(Stage *stage);
gboolean stage_is_homed(const Stage *stage);

/* Takes the steps towards a goal that are possible now. To be called again whenever something has
 * changed. Lights that must be dark are switched off first. */
void stage_pursue(Stage *stage, const struct stage_goal *goal);

/* Turns the turntable by an angle at a speed (axis_turn()). The turntable must stand still before.
 * The hook `changed` is called for each position that the turntable reports and when it has
 * arrived. Afterwards the position of the turntable counts as unknown, so that the next goal moves
 * it. */
void stage_turn(Stage *stage, double by_deg, double speed_deg_s);

/* Returns whether all axes and lights are as the goal says. *ret_at_us is the time on the rig's
 * clock from which the light is stable, or 0 if the goal has no light. */
gboolean stage_has_reached(const Stage *stage, const struct stage_goal *goal, gint64 *ret_at_us);

/* Commands the safe state immediately, and does not wait for the devices (devices_make_safe()).
 * Returns FALSE with an error if a device could not be commanded. After this, only the hook
 * `unsafe` is called until the next stage_home(). */
gboolean stage_make_safe(Stage *stage, GError **error);

/* Returns a text that tells the user what to do, and ends with "then continue"; g_free(). text is
 * the message of a device error. If the reader already knows the device, text is
 * error_details_text() of that error. If the error contains advice, text contains it too. Otherwise
 * general advice is added. */
char *stage_advise(const char *text, const GError *error);
