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
    /* whether the targets are the nominal directions, in the same order */
    gboolean own;
    DirectionMesh *from_views, *from_lights; /* meshes of the measured directions */
    /* the targets; their guesses are triangles of from_views and from_lights */
    struct resampler_target *views, *lights;
    DirectionMesh *to_views, *to_lights; /* meshes of the targets */
    /* points of the targets in the stereographic plane, n_views × 2 and n_lights × 2 */
    double *to_view_points, *to_light_points;
    /* guesses of the triangles of to_views and to_lights that contain the measured directions */
    struct direction_guess *back_views, *back_lights;
    /* left_views has one element for each measured view; the mesh of the element lacks this view.
     * left_lights is the same for lights. */
    struct resampler_left_out *left_views, *left_lights;
    /* texels with an index divisible by left_step take part in the leave-one-out test */
    int left_step;
};

void resampler_init(struct resampler *resampler, const struct near_field *near,
                    const struct btf_directions *to, gboolean own);
void resampler_clear(struct resampler *resampler);

/* Sums over texels for a measured view, over R, G, B together.
 *   back        squared differences of the round trip from the measured values
 *   left_view   squared differences in the leave-one-out test of this view
 *   left_light  squared differences in the leave-one-out tests of all lights in this view
 * Each member …_norm is the sum of the squared measured values to which the member without _norm is
 * compared. */
struct resampler_from {
    double back, back_norm, left_view, left_view_norm, left_light, left_light_norm;
};
/* Sums over texels for a target view.
 *   moved_deg      angle to the nearest measured view
 *   max_moved_deg  maximum of this angle over texels, not a sum
 *   nominal        squared differences between the values without correction and the result;
 *                  0 if the targets are not the nominal directions
 *   norm           squared values of the result that are compared in `nominal`
 *   clamped        share of the values that lie beyond the limit of extrapolation */
struct resampler_to {
    double moved_deg, max_moved_deg, nominal, norm, clamped;
};
struct resampler_sums {
    struct resampler_from *from;
    struct resampler_to *to;
    /* Angle to the nearest measured light:
     *   light_moved_deg       mean over the target lights, summed over texels
     *   light_most_moved_deg  maximum over target lights and texels */
    double light_moved_deg, light_most_moved_deg;
    int texels, sampled; /* sampled: number of texels in the leave-one-out test */
};
struct resampler_sums *resampler_sums_new(const struct resampler *resampler);
void resampler_sums_free(struct resampler_sums *sums); /* NULL is ignored */
void resampler_from_add(const struct resampler_from *more, struct resampler_from *to);
void resampler_to_add(const struct resampler_to *more, struct resampler_to *to);
void resampler_sums_add(const struct resampler *resampler, const struct resampler_sums *more,
                        struct resampler_sums *to);

/* Interpolates one texel. values: the measured values, near->views.n × near->lights.n × lanes. ret:
 * the values at the targets, n_views × n_lights × lanes. Adds the errors of the texel to sums. */
void resampler_texel(const struct resampler *resampler, int texel, const float *values, float *ret,
                     struct resampler_sums *sums);
