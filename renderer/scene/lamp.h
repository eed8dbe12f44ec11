/* The lamps of a picture's settings, placed around the mesh as shaders and shadow maps need them.
 */
#pragma once

#include "viewer_settings.h"

/* Returns settings with which no near lamp is the first lamp. If the first lamp is near, the result
 * has it as the first of the further lamps, and has no first lamp. Otherwise the settings are
 * returned unchanged. viewer_settings_check() makes sure that there is space for one more lamp. */
struct viewer_settings lamp_settings(const struct viewer_settings *settings);

gboolean lamp_any_near(const struct viewer_settings *settings); /* ignores the first lamp */

/* Places a lamp. radius is the radius of the mesh. */
struct shadow_lamp lamp_placed(const struct viewer_lamp *lamp, double radius);

/* Computes the element of lamp_cones[] (further.glsl) for a lamp. A spot lamp has full strength
 * within inner_deg of its axis, and its light ends at placed->cone_rad. */
void lamp_cone(const struct shadow_lamp *placed, double inner_deg, float ret[4]);
