/*
 * Connects the outputs of virtual devices to the simulated world, such as a relay that powers a
 * lamp, or a motor that turns the turntable. All virtual cameras see the same World. A camera
 * therefore sees a lamp that is switched over another bus.
 *
 * The world runs in real time. Its times are those of g_get_monotonic_time(), in µs, as with
 * clock_new_real(). A part must be found in the main thread. Any thread may then use it.
 */
#pragma once

#include "world/world.h"

enum world_part_kind {
    WORLD_PART_NONE, /* not connected: switching and turning have no effect */
    WORLD_PART_TURNTABLE,
    WORLD_PART_ARC,
    WORLD_PART_ARM,
    WORLD_PART_PROBE,
    WORLD_PART_SWEEP, /* the sweep of a laser */
    WORLD_PART_LAMP,
    WORLD_PART_LASER,
};

struct world_part {
    World *world; /* a reference, released by world_part_clear() */
    enum world_part_kind kind;
    int index;
};

/* Finds a part. name is "turntable", "arc", "arm", "probe", "sweep NAME", "lamp NAME" or "laser
 * NAME", with the names of the world file. Returns FALSE with an error if the world has no such
 * part. */
gboolean world_part_find(World *world, const char *name, struct world_part *ret, GError **error);
void world_part_clear(struct world_part *part); /* a zeroed part is allowed */

/* Switches a lamp or laser. For other parts, does nothing. at_us is the time at which the contact
 * closed or opened. */
void world_part_switch(const struct world_part *part, gboolean on, gint64 at_us);

/* Turns a turntable, arc, arm, probe or sweep to deg. For other parts, does nothing. deg_s is the
 * speed of the part at the time at_us, or 0 if the part stands still. */
void world_part_turn(const struct world_part *part, double deg, double deg_s, gint64 at_us);
