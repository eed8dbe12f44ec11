/*
 * The background of a picture: a neutral ground that fades into the distance, or an environment map
 * (environment.h).
 */
#pragma once

#include "drawing/relief/relief.h"
#include "environment.h"

typedef struct Backdrop Backdrop; /* belongs to the thread of the GL context */

Backdrop *backdrop_new(GError **error);
void backdrop_free(Backdrop *backdrop); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Backdrop, backdrop_free)

/* Sets the points of the mesh, n × 3, and its radius. The ground lies at the height of the lowest
 * point, or at 0 if all points are higher. The points are not kept. */
void backdrop_set_points(Backdrop *backdrop, const float *points, guint n, double radius);

/* Copies an environment map to the graphics card. It replaces an earlier map. Fails if the card
 * does not support the size of the map. */
gboolean backdrop_set_environment(Backdrop *backdrop, const struct environment *environment,
                                  GError **error);

/* Draws the background, with alpha 0, at all pixels where nothing was drawn yet. projection and eye
 * are the results of camera_matrix(). relief has the shadow maps for the ground (relief_prepare()).
 * Fails if settings->backdrop is set and backdrop_set_environment() has not been called, or if a
 * program cannot be compiled. */
gboolean backdrop_draw(Backdrop *backdrop, const struct viewer_settings *settings,
                       const Relief *relief, const float projection[16], const float eye[3],
                       GError **error);
