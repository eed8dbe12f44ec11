/*
 * Where a picture shows what is not measured yet: fine stripes over each point that is seen from a
 * direction whose nearest planned view is not there, so that what is seen is interpolated.
 */
#pragma once

#include "live.h"

typedef struct Marks Marks; /* belongs to the thread of the GL context */

Marks *marks_new(GError **error);
void marks_free(Marks *marks); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Marks, marks_free)

void marks_set(Marks *marks, const struct live_view *views, guint n); /* copies; 0: no marks */
gboolean marks_any(const Marks *marks); /* whether a view is missing */

/* directions: a texture as view_render_geometry() has it for VIEW_GEOMETRY_VIEW, as large as the
 * framebuffer. */
void marks_draw(const Marks *marks, guint directions, guint framebuffer, int width, int height);
