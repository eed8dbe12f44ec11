/*
 * Light from infinitely far away on all sides: an environment map (scene/environment.h). The
 * radiance is even within a pixel. Directions are drawn in proportion to the light of the pixels.
 */
#pragma once

#include "base/vec.h"
#include "scene/environment.h"

typedef struct TraceSky TraceSky;

/* Makes a sky and copies the environment. turn_deg is a rotation about z, counter-clockwise seen
 * from above. Returns NULL if the environment is black. */
TraceSky *trace_sky_new(const struct environment *environment, double turn_deg);
void trace_sky_free(TraceSky *sky); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TraceSky, trace_sky_free)

/* Sets ret_rgb to the radiance that comes from a direction. towards is the unit vector towards the
 * sky. Any thread may call this function and the next two. */
void trace_sky_radiance(const TraceSky *sky, struct vec3 towards, double ret_rgb[3]);
/* Returns the density per solid angle with which trace_sky_draw() draws a direction. */
double trace_sky_density(const TraceSky *sky, struct vec3 towards);
/* Draws a direction *ret_towards, and sets ret_rgb to the radiance from there. Returns the density
 * per solid angle of the direction. random has two numbers from 0 to 1. */
double trace_sky_draw(const TraceSky *sky, const double random[2], struct vec3 *ret_towards,
                      double ret_rgb[3]);
