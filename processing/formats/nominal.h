/*
 * A file of nominal values: a rig as its builder measures it with a rule, for pictures of a rig
 * that others have built. Each device has a section [camera NAME], [lamp NAME] or [laser NAME],
 * with points x; y; z in the rig frame (rig.h); nominal_template() writes all keys and their
 * meanings. Any thread.
 */
#pragma once

#include "calibration/calibration.h"

#define NOMINAL_RESPONSE 1000 /* of a camera whose section says nothing */

/* Reads such a file, or a calibration file. NULL: CONFIG_ERROR with file, line and key, or the
 * error of calibration_read(). */
struct calibration *nominal_read(const char *path, GError **error);

/* Whether a camera looks straight down, within a degree. Its pictures are level then if x points to
 * their right and y to their top; any other camera's if the horizon is level. */
gboolean nominal_looks_down(const struct rig_camera *camera);

/* A file to fill in for the cameras, lamps and lasers that a table of pictures (import_poses.h)
 * names; sizes are those of each camera's first picture. NULL: DATA_ERROR. g_free() */
char *nominal_template(const char *table, GError **error);
