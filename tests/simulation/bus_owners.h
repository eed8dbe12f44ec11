/*
 * Watches the simulated world while the daemon serves clients, and compares the truth of the world
 * with the answers of the bus. It finds a light that no client wants, a light that is on although
 * the daemon reports it as off, a safe state that is not kept, a light that stays on when its line
 * works again, and an axis that moves for no client.
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
