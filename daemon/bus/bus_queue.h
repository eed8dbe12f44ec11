/* The queue of calls that wait for the main loop. It passes SafeState to the latch, and refuses a
 * call if too many calls of its client, or of all clients, wait. Owned by the Bus. All functions
 * belong to the main loop's thread. */
#pragma once

#include "bus_latch.h"

struct bus_queue *bus_queue_new(struct bus_latch *latch);
/* Adds the queue to a connection: from now on, every call that arrives on the connection passes
 * through the queue. */
void bus_queue_guard(struct bus_queue *queue, GDBusConnection *connection);
void bus_queue_close(struct bus_queue *queue);
