/*
 * The lasers, lamps and axes of a rig file. Each can be made safe independently of the others:
 * lasers and lamps are switched off, and axes are stopped. The rig file need not be valid. Only the
 * sections of these devices are used, and only the keys that identify a device and switch it.
 *
 * safe_work.h makes the whole rig safe. All functions belong to one thread.
 */
#pragma once

#include "base/config.h"

typedef struct SafeState SafeState;

/* Reads the rig file. Fails only if the file does not exist or cannot be read. */
SafeState *safe_state_read(const char *rig_path, GError **error);
void safe_state_free(SafeState *state); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(SafeState, safe_state_free)

/* The devices: lasers first, then lamps, then axes. Names are like "laser top". safe_state_line()
 * names the line (bus, port, address, USB device or program) through which a device is reached.
 * Devices on the same line cannot be reached at the same time. The SafeState owns the strings and
 * the Config. */
int safe_state_n(const SafeState *state);
const char *safe_state_name(const SafeState *state, int index);
const char *safe_state_line(const SafeState *state, int index);
const Config *safe_state_config(const SafeState *state);

/* Returns whether every device of a known driver is simulated. */
gboolean safe_state_is_simulated(const SafeState *state);

enum safe_try {
    /* The device has confirmed the safe state: it is off, or it stands still. If
     * driver_info.confirmed of its driver is NULL, the state was read back. */
    SAFE_TRY_SAFE,
    SAFE_TRY_AGAIN, /* the attempt failed; another attempt may succeed */
    /* A mesorigd has the device open and is responsible for it as long as it runs. */
    SAFE_TRY_OTHER,
    /* No attempt can succeed, because the section of the device is wrong, or may name another
     * device.
     *
     * A guardian also gets this result if a mesorigd has the device open and the attempt fails for
     * a reason other than a busy device. The device is then left to that mesorigd. */
    SAFE_TRY_NEVER,
};

#define SAFE_STATE_TEXT 1500

/* Opens the device, makes it safe and closes it. If quick is TRUE, each request is sent only once,
 * without the retries of its section. ret_text, of SAFE_STATE_TEXT bytes, receives the result as a
 * text that begins with the name of the device. Runs the default main context. */
enum safe_try safe_state_try(const SafeState *state, int index, gboolean quick, char *ret_text);
