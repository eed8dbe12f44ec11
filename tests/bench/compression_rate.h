/* The part of bench_compression on error against size: local PCAs of a noisy capture, compared with
 * the same capture without noise, beside those as they were published. */
#pragma once

#include <glib.h>

/* sessions: a capture and the same without noise, pair by pair. every: of the views, every so
 * manieth is taken. Returns what a program does. */
int bench_rate(char *const *sessions, int every, gboolean json);
