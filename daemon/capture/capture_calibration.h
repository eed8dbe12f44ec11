/* Chooses the calibration of a capture. Main loop's thread. */
#pragma once

#include "calibration/calibration.h"
#include "rig/devices.h"

/* Returns the calibration that the rig file names, or the nominal rig if the rig file names none or
 * the named file does not exist yet. Fails if the calibration is damaged or of another rig.
 * ret_warnings (of char *, g_ptr_array_unref()) lists parts whose calibration is old, or says that
 * the named file does not exist. */
struct calibration *capture_calibration(const struct devices *devices, GPtrArray **ret_warnings,
                                        GError **error);

/* The same as capture_calibration() without open devices, for the rig file at rig_path. geometry is
 * that of the rig file. path is a file to use instead of the one that the rig file names, or NULL.
 * text is the content of that file, or NULL to read the file. Parts that are old are not reported.
 * *ret_line (g_free()) is a line for people that names the calibration that a capture would use; it
 * is set only on success. */
struct calibration *capture_calibration_for(const char *rig_path, const struct rig *geometry,
                                            const char *path, const char *text, char **ret_line,
                                            GError **error);

/* Returns a line for people about the calibration at path; g_free(). If path is NULL, it is about
 * the calibration that the rig file names. */
char *capture_calibration_line(const char *rig_path, const char *path, GError **error);

/* Text for calibration_line() that says how to give a calibration to a capture. */
#define CAPTURE_CALIBRATION_HOW "mesorig calibrate makes one, -c FILE gives it"
