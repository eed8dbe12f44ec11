/*
 * Light from all directions, as lamps. A picture of all directions is cut into parts that give the
 * same amount of light (median cut, Debevec 2005). Each part becomes a lamp at its centroid.
 *
 * The picture is an EXR with channels R, G, B of radiance. It is twice as wide as high. Its first
 * row is the zenith and its middle column is +x. φ decreases from left to right, as seen from
 * inside.
 */
#pragma once

#include "viewer_settings.h"

struct environment {
    int width, height;
    float *rgb; /* height × width × 3, 0 … 1e30 */
};

/* The names of computed environments, NULL-terminated; see environment_made.h. */
extern const char *const environment_names[];

/* environment_open() opens an environment by its name. name is one of environment_names, or the
 * path of a file. environment_read() opens a file. Both return NULL on error. A file is refused if
 * it has another form than described above, or a radiance outside 0 … 1e30. Free the result with
 * environment_free(). */
struct environment *environment_open(const char *name, GError **error);
struct environment *environment_read(const char *path, GError **error);
void environment_free(struct environment *environment); /* NULL is ignored */

/* Cuts the picture rgb (height × width × 3) by median cut into at most n lamps, and sets `ret` to
 * these lamps. n is from 1 to VIEWER_MAX_LAMPS. All lamps together give the light of the picture, ∫
 * L dω / π. Returns the number of lamps, which is 0 for a black picture. */
int environment_lamps(const float *rgb, int width, int height, int n,
                      struct viewer_lamp ret[VIEWER_MAX_LAMPS]);

/* Adds at most settings->environment_lamps lamps to the settings. Together they give the light of
 * the environment, turned by settings->environment_turn_deg. Fails and changes nothing if the
 * environment is black, or if the settings cannot hold another lamp. */
gboolean environment_light(const struct environment *environment, struct viewer_settings *settings,
                           GError **error);
