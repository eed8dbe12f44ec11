/*
 * Positions of the axes and states of the lights. The sequencer sets a goal; the stage moves every
 * axis there and switches the lights that differ, as soon as each device is free.
 * Main loop's thread.
 */
#pragma once

#include "rig/devices.h"

struct stage_goal {
    double turntable_deg, arc_deg, arm_deg, probe_deg;
    int lamp, laser; /* which is lit; −1: none. Of a laser that is mounted by hand, its unit; of a
                        lamp on the probe, its first stop */
    int sweep;       /* the laser whose sweep axis is to stand at sweep_deg; −1: none */
    double sweep_deg;
};

struct stage_hooks {
    void (*changed)(gpointer data); /* something has arrived, was switched or is homed */
    /* reason: what happened, on which device, and what to do. May be called within stage_home() and
     * stage_pursue(). */
    void (*fault)(const char *source, const char *reason, gpointer data);
    /* While the stage is inactive: a light that was commanded off has not confirmed it. */
    void (*unsafe)(const char *source, const char *reason, gpointer data);
    gpointer data;
};

typedef struct Stage Stage;

Stage *stage_new(struct devices *devices, const struct stage_hooks *hooks);
void stage_free(Stage *stage); /* NULL is ignored; switches and moves nothing */

/* NULL if every interlock is closed, else one that is open. */
const Interlock *stage_open_interlock(const Stage *stage);

/* Homes all axes at once, each as soon as it stands. Switches off again all lights that may be on;
 * the stage is homed only when all are off. */
void stage_home(Stage *stage);
gboolean stage_is_homed(const Stage *stage);

/* Does what can be done now towards a goal; to be called again whenever something has changed. What
 * must go dark is switched off first. */
void stage_pursue(Stage *stage, const struct stage_goal *goal);

/* The turntable, which stands, turns by an angle at a speed (axis_turn()); its reports and its
 * arrival are changes. Where it stands then is not known as that of a goal. */
void stage_turn(Stage *stage, double by_deg, double speed_deg_s);

/* Whether everything is as the goal says; ret_at_us: from when its light is stable. */
gboolean stage_has_reached(const Stage *stage, const struct stage_goal *goal, gint64 *ret_at_us);

/* The safe state, now. Positions are unknown afterwards, and no hook but unsafe is called until
 * stage_home(). */
gboolean stage_make_safe(Stage *stage, GError **error);

/* A text about a device's error, followed by what to do if the text does not say it already;
 * g_free(). text: the error's message, or error_details_text() where the reader knows the device.
 */
char *stage_advise(const char *text, const GError *error);
