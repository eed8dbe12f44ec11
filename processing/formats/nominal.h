/*
 * A file of nominal values describes a rig as its builder measures it with a rule. It is for
 * pictures of a rig without calibration. Each device has a section [camera NAME], [lamp NAME] or
 * [laser NAME], with points x; y; z in the rig frame (rig.h). nominal_template() writes all keys
 * and their meanings. Any thread.
 */
#pragma once

#include "calibration/calibration.h"

#define NOMINAL_RESPONSE 1000 /* response of a camera whose section does not state one */

/* Reads a file of nominal values or a calibration file. Returns NULL with CONFIG_ERROR, which names
 * file, line and key, or with the error of calibration_read(). */
struct calibration *nominal_read(const char *path, GError **error);

/* Returns whether a camera looks straight down, within a degree. The pictures of such a camera
 * count as level if x points to their right and y to their top, because they have no horizon. The
 * pictures of other cameras are level if the horizon is level. */
gboolean nominal_looks_down(const struct rig_camera *camera);

/* Returns a file to fill in for the cameras, lamps and lasers in a table of pictures
 * (import_poses.h); g_free(). Each camera has the size of its first picture. Returns NULL with
 * DATA_ERROR. */
char *nominal_template(const char *table, GError **error);
