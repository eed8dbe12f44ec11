/*
 * A file of nominal values describes a rig by lengths that its builder has measured with a rule. It
 * takes the place of a calibration for pictures of a rig that has none. Each device has a section
 * [camera NAME], [lamp NAME] or [laser NAME], with points x; y; z in the rig frame (rig.h).
 * nominal_template() writes all keys and their meanings. Any thread.
 */
#pragma once

#include "calibration/calibration.h"

#define NOMINAL_RESPONSE 1000 /* response of a camera whose section does not state one */

/* Reads a file of nominal values or a calibration file. Returns NULL with CONFIG_ERROR, which names
 * file, line and key, or with the error of calibration_read(). */
struct calibration *nominal_read(const char *path, GError **error);

/* Returns whether a camera looks straight down, within a degree. The pictures of such a camera show
 * no horizon. The key turn_deg of such a camera is therefore 0 if x points to the right in the
 * pictures, and y to the top. For other cameras, turn_deg is 0 if the horizon in the pictures is
 * level. */
gboolean nominal_looks_down(const struct rig_camera *camera);

/* Returns the text of a file of nominal values to fill in, for the cameras, lamps and lasers in a
 * table of pictures (import_poses.h); g_free(). The size of each camera is that of its first
 * picture. The error is in DATA_ERROR. */
char *nominal_template(const char *table, GError **error);
