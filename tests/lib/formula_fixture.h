/* Pictures of small materials against a plain evaluation of the formula, pixel by pixel. */
#pragma once

#include "gpu_fixture.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <math.h>

#define SIZE 96

/* What a pixel should be, from texel coordinates and directions as viewer_render_geometry() gives
 * them; FALSE where rounding may pick other texels or directions. */
typedef gboolean (*Expected)(gconstpointer data, const float *at, const float *v, const float *l,
                             double ret[3]);
void formula_compare(Expected func, gconstpointer data, Viewer *view,
                     const struct viewer_settings *settings);
void formula_start_view(Viewer *view, struct viewer_settings *settings, const struct mesh *mesh);
