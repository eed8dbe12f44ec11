/* The queue of calls that wait for the main loop. It passes SafeState to the latch, and refuses a
 * call with BUS_ERROR_LIMIT if 32 calls of its client, or 128 calls of all clients, wait. The Bus
 * owns the queue. All functions belong to the main loop's thread. */
#pragma once

#include "bus_latch.h"

/* Makes a queue for the calling thread's main context. Takes a reference to the latch. */
struct bus_queue *bus_queue_new(struct bus_latch *latch);
/* Adds the queue to a connection: from now on, every call that arrives on the connection passes
 * through the queue. */
void bus_queue_guard(struct bus_queue *queue, GDBusConnection *connection);
/* Releases the queue. Connections to which the queue was added keep it until they are freed. */
void bus_queue_close(struct bus_queue *queue);
