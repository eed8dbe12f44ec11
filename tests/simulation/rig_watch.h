/*
 * Watches the simulated world while a capture is paused or has ended: lamps and lasers must be off
 * and the axes must stand, as the state says. Reads the state of the world, not of the devices.
 */
#pragma once

#include "rig/devices.h"
#include "scene.h"
#include "world/world.h"

struct rig_watch {
    struct scene *scene;
    const struct life *life;
    struct devices *devices;
    World *world;
    gint64 since_us; /* since when it rests; −1: it does not */
    gboolean still_known;
    gboolean unsafe_told; /* that the rig could not be made safe was an event or a reason */
    double still_deg[2 + WORLD_MAX_LASERS];
    gint64 open_since_us; /* the interlock; −1: closed */
};

/* Calls world_get(). FALSE: the world is not there. */
gboolean rig_watch_begin(struct rig_watch *watch, struct scene *scene, const struct life *life,
                         struct devices *devices);
void rig_watch_look(struct rig_watch *watch, gboolean rests);

/* Everything must be off and stand now. */
void rig_watch_end(struct rig_watch *watch, const char *when);
