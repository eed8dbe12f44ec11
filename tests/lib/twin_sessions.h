/* Sessions in one folder that were captured by different drivers: their differences, and their
 * values. */
#pragma once

#include "session/session.h"
#include "session_difference.h"

#include <gio/gio.h>

extern char *twin_folder;

char *twin_path(const char *name);
struct difference twin_compare(const char *a, const char *b, const char *folder, gboolean holes);
double twin_value(const char *name, const char *key);

/* Captures tests/small with its simulated drivers, with noise of this seed, and processes the
 * session. */
void twin_capture_simulated(const char *name, const char *seed);

/* Checks that a session of tests/small that was captured by other drivers differs from a simulated
 * session only by noise. The function captures two simulated sessions with different noise. The
 * limit of the RMS difference is 1.4 times that of these two sessions. */
void twin_assert_noise_alone(const char *name);

/* Starts mesorigd with a rig file, and returns when it listens at the address of a socket. log is
 * as in process_start(). */
GSubprocess *twin_start_daemon(GSubprocessFlags flags, const char *log, const char *rig,
                               const char *address);
