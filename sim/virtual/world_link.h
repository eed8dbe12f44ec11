/*
 * Connects the outputs of virtual devices to the simulated world: a relay that powers a lamp or a
 * laser, a motor that turns the table. The same World is read by every virtual camera, so that a
 * lamp switched over one bus is seen by a camera on another.
 *
 * Real time: the world's microseconds are those of g_get_monotonic_time(), as with
 * clock_new_real(). A part is found in the main thread and may then be used from any.
 */
#pragma once

#include "world/world.h"

enum world_part_kind {
    WORLD_PART_NONE, /* not connected: switching and turning do nothing */
    WORLD_PART_TURNTABLE,
    WORLD_PART_ARC,
    WORLD_PART_ARM,
    WORLD_PART_PROBE,
    WORLD_PART_SWEEP, /* of a laser */
    WORLD_PART_LAMP,
    WORLD_PART_LASER,
};

struct world_part {
    World *world; /* a reference; world_part_clear() */
    enum world_part_kind kind;
    int index;
};

/* name: "turntable", "arc", "arm", "probe", "sweep NAME", "lamp NAME" or "laser NAME", with the
 * names of the world file. */
gboolean world_part_find(World *world, const char *name, struct world_part *ret, GError **error);
void world_part_clear(struct world_part *part); /* of zeroes is allowed */

/* Switches a lamp or laser; other parts ignore it. at_us: when the contact closed or opened. */
void world_part_switch(const struct world_part *part, gboolean on, gint64 at_us);

/* Turns a turntable, arc, arm, probe or sweep; other parts ignore it. deg_s: the speed that it has
 * at at_us; 0: it stands. */
void world_part_turn(const struct world_part *part, double deg, double deg_s, gint64 at_us);
