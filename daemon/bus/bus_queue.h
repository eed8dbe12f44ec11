/* The queue of calls that wait for the main loop. It passes SafeState to the latch. If 32 calls of
 * a client, or 128 calls of all clients, are waiting, a further call is refused with
 * BUS_ERROR_LIMIT. The Bus owns the queue. All functions belong to the main loop's thread. */
#pragma once

#include "bus_latch.h"

/* Makes a queue for the calling thread's main context. Takes a reference to the latch. */
struct bus_queue *bus_queue_new(struct bus_latch *latch);
/* Adds the queue to a connection. From now on, every call that arrives on the connection passes
 * through the queue. */
void bus_queue_guard(struct bus_queue *queue, GDBusConnection *connection);
/* Releases the queue. Connections to which the queue was added keep it until they are freed. */
void bus_queue_close(struct bus_queue *queue);
