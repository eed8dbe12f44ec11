/*
 * The safe state of a rig that no daemon holds: lasers and lamps off, axes standing, each device by
 * itself and whatever has become of the others. It needs no valid rig file, but the sections of
 * those devices alone, and of them what says where the device is and what switches it.
 *
 * Devices on different lines are seen to at the same time, each line in a process of its own, so
 * that one that hangs holds up no other. What fails is tried again for some seconds: a line may
 * still be held by a program that ends.
 */
#pragma once

#include <glib.h>

typedef struct SafeState SafeState;

/* Reads the rig file; what is wrong with it is told by safe_state_make(). Fails only if there is no
 * such file, or if it cannot be read. */
SafeState *safe_state_read(const char *rig_path, GError **error);
void safe_state_free(SafeState *state); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(SafeState, safe_state_free)

/* Prints one line a device, and one for the whole. TRUE if all devices were read back and are safe.
 * To be called from a process without other threads. */
gboolean safe_state_make(const SafeState *state);
