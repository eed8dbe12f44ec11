/*
 * The safe state of a rig without a daemon: lasers and lamps off, axes standing, each device
 * independently of the others. The rig file need not be valid: only the sections of these devices
 * are used, and in them only the keys that identify the device and switch it.
 *
 * Different lines are handled at the same time, each in a process of its own, so that one that
 * hangs delays no other. Failures are tried again for some seconds: a program that is ending may
 * still hold a line.
 */
#pragma once

#include <glib.h>

typedef struct SafeState SafeState;

/* Reads the rig file; safe_state_make() reports its errors. Fails only if the file does not exist
 * or cannot be read. */
SafeState *safe_state_read(const char *rig_path, GError **error);
void safe_state_free(SafeState *state); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(SafeState, safe_state_free)

/* Prints one line per device, and one for the whole. TRUE if all devices were read back and are
 * safe. To be called from a process without other threads. */
gboolean safe_state_make(const SafeState *state);
