/*
 * Light from all around as lamps: a picture of all directions is cut into parts that give equally
 * much light (median cut, Debevec 2005), and a lamp stands in the middle of the light of each.
 *
 * The picture is an EXR with channels R, G, B of radiance, twice as wide as high: its first row is
 * the zenith, its middle column +x, and φ falls from left to right, as one sees it from inside.
 */
#pragma once

#include "view.h"

/* Of height × width × 3. At most n lamps, 1 … VIEW_MAX_LAMPS; the sum of their light is that of
 * the picture, ∫ L dω / π. Returns how many; black gives none. */
int environment_lamps(const float *rgb, int width, int height, int n,
                      struct view_lamp ret[VIEW_MAX_LAMPS]);

/* Adds the lamps of a file to what there is, in place of the first lamp and the even sky. */
gboolean environment_light(const char *path, struct view_settings *settings, GError **error);
