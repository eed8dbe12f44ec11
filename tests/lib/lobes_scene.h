/* What pictures of analytic models of texels should be: lobes_evaluate(), plainly filtered. */
#pragma once

#include "btf/direction_grid.h"
#include "formula_fixture.h"
#include "gl/directions.h"
#include "lobes/lobes_levels.h"
#include "methods/lobes_view.h"
#include "methods/microfacet.h"
#include "rings.h"

struct scene {
    const struct lobes *lobes;
    Directions *views;
    double ambient;
    gboolean nearest;
    enum method_rotation rotation; /* of ward and ashikhmin */
};

gboolean lobes_scene_expected(gconstpointer data, const float *at, const float *v, const float *l,
                              double ret[3]);
