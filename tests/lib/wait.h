/*
 * Waits for an event. The loop runs until the condition holds:
 *
 *     UNTIL (!device_is_unsafe(device))
 *         conformance_pass(clock, 0.01);
 *
 * The test fails if that takes longer than WAIT_S, which is far longer than any event takes on a
 * busy computer. The condition may be evaluated often. Tests check events in this way. They never
 * check the time that an event took, because it depends on the load of the computer.
 */
#pragma once

#include <glib.h>

#define WAIT_S 120

#define UNTIL(condition)                                                                           \
    for (const gint64 wait_begun_us = g_get_monotonic_time(); !(condition);                        \
         wait_check(wait_begun_us, WAIT_S, G_STRLOC, #condition))

/* The same with another limit, for a test of the failure itself. */
#define UNTIL_WITHIN(limit_s, condition)                                                           \
    for (const gint64 wait_begun_us = g_get_monotonic_time(); !(condition);                        \
         wait_check(wait_begun_us, limit_s, G_STRLOC, #condition))

static inline void wait_check(gint64 begun_us, int limit_s, const char *where,
                              const char *condition) {
    if (g_get_monotonic_time() > begun_us + limit_s * G_USEC_PER_SEC)
        g_error("%s: waited %d s for: %s", where, limit_s, condition);
}

/* Lets the default main loop run for a time. */
static inline void wait_ms(int ms) {
    for (int i = 0; i < ms; i += 5) {
        g_main_context_iteration(NULL, FALSE);
        g_usleep(5000);
    }
}
