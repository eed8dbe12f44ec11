/* Interpolates each texel's values at directions that are common to all texels, see
 * near_field_correction.h. */
#pragma once

#include "btf_directions.h"
#include "direction_mesh.h"
#include "near_field.h"

#define RESAMPLER_LANES 4 /* R, G, B, and the flags (enum btf_flag) */

/* A target direction, its stereographic point, and a guess of the triangle of the measured
 * directions that contains it. */
struct resampler_target {
    struct vec3 direction;
    double point[2];
    struct direction_guess guess;
};

/* A mesh without one of its directions, for predicting that direction. */
struct resampler_left_out {
    DirectionMesh *mesh;
    struct direction_guess guess;
};

/* Data that all texels have in common. Immutable; any number of threads. */
struct resampler {
    const struct near_field *near; /* borrowed */
    int n_views, n_lights;         /* number of targets */
    gboolean own;                  /* the targets are the nominal directions, in the same order */
    DirectionMesh *from_views, *from_lights; /* meshes of the measured directions */
    /* targets, with guesses in from_views and from_lights */
    struct resampler_target *views, *lights;
    DirectionMesh *to_views, *to_lights; /* meshes of the targets */
    /* n_views × 2 and n_lights × 2: the points of the targets in the stereographic plane */
    double *to_view_points, *to_light_points;
    /* guesses for the measured directions in to_views and to_lights */
    struct direction_guess *back_views, *back_lights;
    /* one for each measured view and for each measured light, which its mesh lacks */
    struct resampler_left_out *left_views, *left_lights;
    int left_step; /* texels with an index divisible by left_step take part in the leave-one-out
                      test */
};

void resampler_init(struct resampler *resampler, const struct near_field *near,
                    const struct btf_directions *to, gboolean own);
void resampler_clear(struct resampler *resampler);

/* Sums over texels for a measured view: squared differences and squared values (…_norm), R, G, B
 * together, of the round trip (back) and of the leave-one-out tests of views and lights (left). */
struct resampler_from {
    double back, back_norm, left_view, left_view_norm, left_light, left_light_norm;
};
/* Sums over texels for a target view: the angle to the nearest measured view (moved) and its
 * maximum, the squared differences of uncorrected values from the result (nominal), the squared
 * values of the result (norm), and the share of values beyond the limit of extrapolation. */
struct resampler_to {
    double moved_deg, max_moved_deg, nominal, norm, clamped;
};
struct resampler_sums {
    struct resampler_from *from;
    struct resampler_to *to;
    /* mean over the targets of the angle to the nearest measured light, summed over texels, and the
     * maximum angle */
    double light_moved_deg, light_most_moved_deg;
    int texels, sampled; /* number of texels, and number of texels in the leave-one-out test */
};
struct resampler_sums *resampler_sums_new(const struct resampler *resampler);
void resampler_sums_free(struct resampler_sums *sums); /* NULL is ignored */
void resampler_from_add(const struct resampler_from *more, struct resampler_from *to);
void resampler_to_add(const struct resampler_to *more, struct resampler_to *to);
void resampler_sums_add(const struct resampler *resampler, const struct resampler_sums *more,
                        struct resampler_sums *to);

/* Interpolates one texel. values are measured (near->views.n × near->lights.n × lanes), ret is at
 * the targets (n_views × n_lights × lanes). Adds the errors of the texel to sums. */
void resampler_texel(const struct resampler *resampler, int texel, const float *values, float *ret,
                     struct resampler_sums *sums);
