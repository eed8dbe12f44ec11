/*
 * Which calibration a capture works with. Main loop's thread.
 */
#pragma once

#include "calibration/calibration.h"
#include "rig/devices.h"

/* The calibration that the rig file names, or the nominal rig if it names none or the file does not
 * exist yet. Refuses a damaged one, and one of another rig. ret_warnings (of char *): what is old,
 * or missing; g_ptr_array_unref(). */
struct calibration *capture_calibration(const struct devices *devices, GPtrArray **ret_warnings,
                                        GError **error);
