/*
 * Watches the simulated world while the daemon serves clients: light that nobody wants, light that
 * the daemon calls off, a safe state that does not hold, light that stays when its line is there
 * again, axes that move for nobody. Asks the world for the truth, and the bus for what it says.
 */
#pragma once

#include "bus/bus_private.h"
#include "bus_clients.h"
#include "world/world.h"

struct bus_owners;

/* Calls world_get(); world.conf is in the scene's folder. */
struct bus_owners *bus_owners_new(struct scene *scene, const struct bus_schedule *schedule,
                                  Bus *bus, const struct bus_clients *clients);

/* After each turn of the main loop. */
void bus_owners_look(struct bus_owners *owners);
