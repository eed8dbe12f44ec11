/* Chooses the calibration of a capture. All functions belong to the main loop's thread. */
#pragma once

#include "calibration/calibration.h"
#include "rig/devices.h"

/* Returns the calibration that the rig file names. If the rig file names none, or if the named file
 * does not exist yet, returns the nominal rig. Returns NULL with an error if the calibration is
 * damaged or of another rig.
 *
 * *ret_warnings is set to a list of char *, to be freed with g_ptr_array_unref(). The list has the
 * parts whose calibration is old, or says that the named file does not exist. */
struct calibration *capture_calibration(const struct devices *devices, GPtrArray **ret_warnings,
                                        GError **error);

/* The same as capture_calibration(), for a rig whose devices are not open. rig_path is the path of
 * the rig file, and geometry is the rig in it. path is a file to use instead of the one that the
 * rig file names, or NULL. text is the content of that file, or NULL to read it. Parts that are old
 * are not reported.
 *
 * On success, *ret_line is set to a line for people that names the calibration that a capture would
 * use. Free it with g_free(). */
struct calibration *capture_calibration_for(const char *rig_path, const struct rig *geometry,
                                            const char *path, const char *text, char **ret_line,
                                            GError **error);

/* Returns a line for people about the calibration at path or, if path is NULL, about the
 * calibration that the rig file names. Free it with g_free(). */
char *capture_calibration_line(const char *rig_path, const char *path, GError **error);

/* Text for calibration_line() that says how to give a calibration to a capture. */
#define CAPTURE_CALIBRATION_HOW "mesorig calibrate makes one, -c FILE gives it"
