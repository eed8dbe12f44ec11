/* Compares pictures of small materials, pixel by pixel, with a direct evaluation of the formula. */
#pragma once

#include "gpu_fixture.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <math.h>

#define SIZE 96

/* Computes the expected value of a pixel. at (texel coordinates), v and l are results of
 * viewer_render_geometry(). Returns FALSE if rounding may select other texels or directions. */
typedef gboolean (*Expected)(gconstpointer data, const float *at, const float *v, const float *l,
                             double ret[3]);
void formula_compare(Expected func, gconstpointer data, Viewer *view,
                     const struct viewer_settings *settings);
/* Sets the mesh of a viewer. Sets `settings` to the defaults, except for a fixed distance of the
 * camera, polar angle of the lamp and numbers of tiles. */
void formula_start_view(Viewer *view, struct viewer_settings *settings, const struct mesh *mesh);
