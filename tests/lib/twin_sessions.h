/* Sessions that were captured by different drivers, in one folder: how far they are from each
 * other, and what they say of themselves. */
#pragma once

#include "session/session.h"
#include "session_difference.h"

#include <gio/gio.h>

extern char *twin_folder;

char *twin_path(const char *name);
struct difference twin_compare(const char *a, const char *b, const char *folder, gboolean holes);
double twin_value(const char *name, const char *key);

/* Captures tests/small by its simulated drivers, with noise of a seed, and processes it. */
void twin_capture_simulated(const char *name, const char *seed);

/* A session of tests/small that other drivers have captured differs from the simulated one by other
 * noise only: no more than two simulated ones differ from each other, which are captured here. */
void twin_assert_noise_alone(const char *name);

/* mesorigd with a rig file, once it listens on an address of a socket. log: as process_start(). */
GSubprocess *twin_start_daemon(GSubprocessFlags flags, const char *log, const char *rig,
                               const char *address);
