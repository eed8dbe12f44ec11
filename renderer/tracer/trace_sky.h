/*
 * Light from infinitely far away on all sides: an environment map (scene/environment.h) whose
 * pixels are of even radiance each. Directions are drawn in proportion to the pixels' light.
 */
#pragma once

#include "base/vec.h"
#include "scene/environment.h"

typedef struct TraceSky TraceSky;

/* Copies. turn_deg: about z, counter-clockwise seen from above. NULL: it is black. */
TraceSky *trace_sky_new(const struct environment *environment, double turn_deg);
void trace_sky_free(TraceSky *sky); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TraceSky, trace_sky_free)

/* Any thread. towards: unit, towards the sky. */
void trace_sky_radiance(const TraceSky *sky, struct vec3 towards, double ret_rgb[3]);
/* Per solid angle. */
double trace_sky_density(const TraceSky *sky, struct vec3 towards);
/* Returns the density. */
double trace_sky_draw(const TraceSky *sky, const double random[2], struct vec3 *ret_towards,
                      double ret_rgb[3]);
