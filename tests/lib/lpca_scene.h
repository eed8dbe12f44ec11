/* Small local PCAs, and their expected pictures, by a direct evaluation of the formula. */
#pragma once

#include "btf/direction_grid.h"
#include "codecs/lpca/lpca.h"
#include "directions/directions.h"
#include "formula_fixture.h"
#include "rings.h"

#include <math.h>
#include <string.h>

/* Level 0 has W × H texels. */
struct lpca *lpca_scene_level(int level, int n_clusters, int n_components);
struct lpca *lpca_scene_lpca(int n_clusters, int n_components);

struct scene { /* one picture, and the data from which its expected values are computed */
    const struct lpca *lpca;
    Directions *views, *lights;
    float *sky;
    double ambient;
    gboolean nearest;
    int n_grid;       /* 0 means pairs of measured directions */
    gboolean revised; /* lpca is on a grid (lpca_resample.h) */
};

/* Compares a picture of a torus with its expected values. material is a material of the method;
 * NULL fails the test. */
void lpca_scene_compare(const struct scene *scene, const struct method *method, gpointer material);

/* Does the same for a local PCA. If n_grid is 0, method_lpca draws the picture, with pairs of
 * measured directions. Otherwise method_lpca_grid draws the picture, with n_grid samples in each
 * direction. */
void lpca_scene_check(struct lpca *lpca, gboolean nearest, double ambient, int n_grid);

/* Computes the expected value of a pixel from level 0. data is a struct scene. */
gboolean lpca_scene_pixel(gconstpointer data, const float *at, const float *v, const float *l,
                          double ret[3]);

/* A picture between two mip levels, of a plane seen from straight above, where all pixels have the
 * same size. */
struct between {
    struct scene scenes[3];
    double level;
};

void lpca_scene_check_levels(Viewer *view, struct lpca *const *levels, double tiles);
