/*
 * Which calibration a capture works with. Main loop's thread.
 */
#pragma once

#include "calibration/calibration.h"
#include "rig/devices.h"

/* That which the rig file names, or the nominal rig if it names none or the file is not there yet.
 * One of another rig, or damaged, is refused. ret_warnings (of char *): what is old, or missing;
 * g_ptr_array_unref(). */
struct calibration *capture_calibration(const struct devices *devices, GPtrArray **ret_warnings,
                                        GError **error);
