/*
 * Light from all around as lamps: a picture of all directions is cut into parts that give equally
 * much light (median cut, Debevec 2005), and each part becomes a lamp at its centroid.
 *
 * The picture is an EXR with channels R, G, B of radiance, twice as wide as high: its first row is
 * the zenith, its middle column +x, and φ falls from left to right, as one sees it from inside.
 */
#pragma once

#include "viewer.h"

struct environment {
    int width, height;
    float *rgb; /* height × width × 3, 0 … 1e30 */
};

/* Environments that are computed, NULL-ended: see environment_made.h. */
extern const char *const environment_names[];

/* One of these names, or the path of a file. */
struct environment *environment_open(const char *name, GError **error);
struct environment *environment_read(const char *path, GError **error);
void environment_free(struct environment *environment); /* NULL is ignored */

/* Median cut of rgb (height × width × 3) into at most n lamps, 1 … VIEWER_MAX_LAMPS. The sum of
 * their light is that of the picture, ∫ L dω / π. Returns the number of lamps; 0 for a black
 * picture. */
int environment_lamps(const float *rgb, int width, int height, int n,
                      struct viewer_lamp ret[VIEWER_MAX_LAMPS]);

/* Adds the environment's lamps to the settings, at most settings' environment_lamps, turned by
 * environment_turn_deg. Fails, and changes nothing, if the environment is black or the settings
 * have no room for a lamp. */
gboolean environment_light(const struct environment *environment, struct viewer_settings *settings,
                           GError **error);
