/*
 * Marks the parts of a picture that are not measured yet with fine stripes. A point is marked if
 * the planned view that is nearest to its viewing direction is missing. The value of the point is
 * then interpolated.
 */
#pragma once

#include <glib.h>

struct planned_view {
    double theta_deg, phi_deg;
    gboolean measured;
};

/* Returns whether the view nearest to a direction is planned but not measured yet. Returns FALSE if
 * there are no views. */
gboolean planned_views_missing(const struct planned_view *views, guint n, double theta_deg,
                               double phi_deg);

typedef struct Hatching Hatching; /* belongs to the thread of the GL context */

Hatching *hatching_new(GError **error);
void hatching_free(Hatching *hatching); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Hatching, hatching_free)

/* Sets the views and copies them. n = 0 removes the stripes. */
void hatching_set(Hatching *hatching, const struct planned_view *views, guint n);
gboolean hatching_any(const Hatching *hatching); /* whether a view is missing */

/* Draws the stripes. directions is a texture with the values of VIEWER_GEOMETRY_VIEW
 * (viewer_render_geometry()). The texture has the size of the framebuffer. */
void hatching_draw(const Hatching *hatching, guint directions, guint framebuffer, int width,
                   int height);
