/*
 * Marks the parts of a picture that are not measured yet: fine stripes over each point that is seen
 * from a direction whose nearest planned view is missing, so that its value is interpolated.
 */
#pragma once

#include <glib.h>

struct planned_view {
    double theta_deg, phi_deg;
    gboolean measured;
};

/* Whether the view nearest to a direction is planned and not measured yet; FALSE if there are no
 * views. */
gboolean planned_views_missing(const struct planned_view *views, guint n, double theta_deg,
                               double phi_deg);

typedef struct Hatching Hatching; /* belongs to the thread of the GL context */

Hatching *hatching_new(GError **error);
void hatching_free(Hatching *hatching); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Hatching, hatching_free)

/* Copies; n = 0: no stripes. */
void hatching_set(Hatching *hatching, const struct planned_view *views, guint n);
gboolean hatching_any(const Hatching *hatching); /* whether a view is missing */

/* directions: a texture with the values of VIEWER_GEOMETRY_VIEW (viewer_render_geometry()), as
 * large as the framebuffer. */
void hatching_draw(const Hatching *hatching, guint directions, guint framebuffer, int width,
                   int height);
