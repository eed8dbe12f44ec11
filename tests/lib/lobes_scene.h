/* What pictures of models of each texel should be: their values, plainly filtered. */
#pragma once

#include "btf/direction_grid.h"
#include "codecs/lobes/lobes_levels.h"
#include "directions/directions.h"
#include "drawing/methods/lobes_view.h"
#include "drawing/methods/microfacet.h"
#include "formula_fixture.h"
#include "rings.h"

struct scene {
    const struct lobes *lobes;
    Directions *views;
    double ambient;
    gboolean nearest;
    enum method_rotation rotation; /* of ward and ashikhmin */
    /* Of a model that is not a lobes: adds share × a texel of a measured view under light and sky.
     */
    const struct btf_layout *layout;
    gconstpointer model;
    void (*add)(const struct scene *scene, int view, int texel, const float *l, double share,
                double ret[3]);
};

gboolean lobes_scene_expected(gconstpointer data, const float *at, const float *v, const float *l,
                              double ret[3]);

/* Draws the file by the method and compares with the scene, whose views are set here. refuses: a
 * method that must refuse the file, naming the model; may be NULL. */
void lobes_scene_compare(struct scene *scene, const struct method *method, const char *path,
                         const struct method *refuses, const char *model);
