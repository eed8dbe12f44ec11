/* The requests of one bus of a recording, and how many of them have come. Only one thread at a time
 * may use a struct steps. */
#pragma once

#include "protocol.h"
#include "recorded.h"

struct steps;

/* Reads the lines of a bus. recorded and protocol must stay valid as long as the steps. */
struct steps *steps_new(const Recorded *recorded, int bus, const struct replay_protocol *protocol);
void steps_free(struct steps *steps); /* NULL is ignored */

/* Returns an array of GBytes: the messages that the device sends before the first request. */
const GPtrArray *steps_greeting(const struct steps *steps);

enum steps_result {
    STEPS_ANSWERED, /* ret has the messages that follow (GBytes), if there are any */
    STEPS_STALLED,  /* the device has refused the request (USB) */
    STEPS_DIFFERS,  /* steps_difference() says how */
};

/* Takes a request that the program has sent. Appends the messages that follow to ret. */
enum steps_result steps_take(struct steps *steps, const guint8 *bytes, gsize n, GPtrArray *ret);

/* Returns whether all requests before a line of the file have come. */
gboolean steps_are_at(const struct steps *steps, int line);

/* These functions return the texts of replay_difference() and replay_missing(), or NULL. The steps
 * own the text of steps_difference(). Free the text of steps_missing() with g_free(). */
const char *steps_difference(const struct steps *steps);
char *steps_missing(const struct steps *steps);
