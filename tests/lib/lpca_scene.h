/* Small local PCAs, and what pictures of them should be: the formula, plainly. */
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

struct scene { /* one picture, and what is needed to say what it should be */
    const struct lpca *lpca;
    Directions *views, *lights;
    float *sky;
    double ambient;
    gboolean nearest;
    int n_grid;       /* 0: by pairs of measured directions */
    gboolean revised; /* lpca is on a grid of resample.h */
};

struct vec3 lpca_scene_direction(const float *theta_deg, const float *phi_deg, int k);

/* A pixel of a whole scene, of level 0. */
gboolean lpca_scene_pixel(gconstpointer data, const float *at, const float *v, const float *l,
                          double ret[3]);

/* Between two mip levels of a plane seen from straight above, where all pixels are as large. */
struct between {
    struct scene scenes[3];
    double level;
};

void lpca_scene_check_levels(Viewer *view, struct lpca *const *levels, double tiles);
