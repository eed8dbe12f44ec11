/* The expected picture of a material with a model for each texel (lobes.h). The expected value of a
 * pixel is interpolated bilinearly between the values of four texels. */
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
    enum method_rotation rotation; /* for ward and ashikhmin */
    /* For a model other than struct lobes: adds share × the value of a texel of a measured view
     * under the light and the sky. */
    const struct btf_layout *layout;
    gconstpointer model;
    void (*add)(const struct scene *scene, int view, int texel, const float *l, double share,
                double ret[3]);
};

gboolean lobes_scene_expected(gconstpointer data, const float *at, const float *v, const float *l,
                              double ret[3]);

/* Draws the file at `path` with the method, and compares the picture with the expected values of
 * the scene. The function sets scene->views. refuses is NULL, or a method that must refuse the file
 * with an error that contains the text `model`. */
void lobes_scene_compare(struct scene *scene, const struct method *method, const char *path,
                         const struct method *refuses, const char *model);
