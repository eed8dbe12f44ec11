/* The parts of bench_prediction, a file each. */
#pragma once

#include "selection/prediction.h"
#include "world/world.h"

struct btf_matrix;

/* A session with all pairs, and its truth. Pair (v, l) is v · n_lights + l. */
struct prediction_scene {
    struct btf_matrix *btf;
    GPtrArray *views, *all_shots;
    int n_views, n_lights, n_pairs, n_texels, n_shots;
    struct vec3 *view, *light, *view_mm, *light_mm, *at_mm; /* at_mm: of each texel */
    struct prediction_pairs pairs;
    struct prediction_shot *shots;
    int *groups, *source, *angle; /* of pairs: the shot; of shots: light, and number of the angle */
    int *shot_pairs;
    float *truth; /* as the values of btf */
    World *world;
};

/* Texels that constants are fitted to; fewer where there are fewer. */
#define PREDICTION_PROBES 150

/* The texel of probe i. */
int prediction_bench_probe(const struct prediction_scene *scene, int i);
/* Values of a texel, colour by colour: 3 × n_pairs, those of shots that are not taken NaN. */
void prediction_bench_texel(const struct prediction_scene *scene, int texel, const gboolean *taken,
                            float *ret);

/* Ways that are published (prediction_published.c). Each sets the missing values of a texel. */

/* Marks every part-th light of each turntable angle, another first one at each. */
void prediction_regular(const struct prediction_scene *scene, int part, gboolean *taken);
void prediction_interpolate(const struct prediction_scene *scene, const gboolean *taken,
                            float *values);

struct prediction_completion {
    const struct prediction_scene *scene;
    const gboolean *taken;
    double *lights; /* factors, n_lights × rank; g_free() */
};
void prediction_complete_fit(struct prediction_completion *completion);
void prediction_complete(const struct prediction_completion *completion, float *values);

/* One-dimensional slices of the directions, and radial functions between them
 * (prediction_slices.c). */

/* Adds shots until n are taken; nothing taken: begins. */
void prediction_slices_choose(const struct prediction_scene *scene, int n, gboolean *taken);

struct prediction_radial {
    const struct prediction_scene *scene;
    int n_known, n_missing;
    int *known, *missing; /* pairs */
    double *weights;      /* n_missing × n_known */
    int *nearest;         /* of each missing pair: the nearest known one */
};
struct prediction_radial *prediction_radial_new(const struct prediction_scene *scene,
                                                const gboolean *taken);
void prediction_radial_free(struct prediction_radial *radial); /* NULL is ignored */
void prediction_radial_fill(const struct prediction_radial *radial, float *values);

/* Pictures (prediction_pictures.c). */

typedef void (*PredictionMake)(int texel, float *ret_values, gpointer data); /* 3 × n_pairs */

struct prediction_pictures {
    double full, made; /* mean ΔE2000 against the truth */
};
/* Draws the whole sample under twelve pairs of directions between the measured ones, from the
 * truth, from all that was measured, and from what make returns (called in several threads). write:
 * a PNG of all three, or NULL. */
struct prediction_pictures prediction_pictures_compare(const struct prediction_scene *scene,
                                                       PredictionMake make, gpointer data,
                                                       const char *write);
