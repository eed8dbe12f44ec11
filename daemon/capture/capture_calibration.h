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

/* The same without open devices: for the rig file at rig_path, whose geometry is given. path: the
 * file to use in place of the one that the rig file names; or NULL. text: of that file, if it is
 * not to be read; or NULL. ret_line (g_free()): the line that tells people which one a capture
 * would use. */
struct calibration *capture_calibration_for(const char *rig_path, const struct rig *geometry,
                                            const char *path, const char *text, char **ret_line,
                                            GError **error);

/* That line for the calibration at path, or NULL: for the one that the rig file names. g_free() */
char *capture_calibration_line(const char *rig_path, const char *path, GError **error);

/* How to give a calibration to a capture; for calibration_line(). */
#define CAPTURE_CALIBRATION_HOW "mesorig calibrate makes one, -c FILE gives it"
