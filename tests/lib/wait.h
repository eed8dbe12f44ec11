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
    for (const gint64 wait_limit_us = g_get_monotonic_time() + WAIT_S * G_USEC_PER_SEC;            \
         !(condition); wait_check(wait_limit_us, G_STRLOC, #condition))

static inline void wait_check(gint64 limit_us, const char *where, const char *condition) {
    if (g_get_monotonic_time() > limit_us)
        g_error("%s: waited %d s for: %s", where, WAIT_S, condition);
}

/* Lets the default main loop run for a time. */
static inline void wait_ms(int ms) {
    for (int i = 0; i < ms; i += 5) {
        g_main_context_iteration(NULL, FALSE);
        g_usleep(5000);
    }
}
