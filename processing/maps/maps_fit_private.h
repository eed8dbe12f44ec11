/* maps_fit.c, maps_pairs.c and maps_solver.c share the pairs of directions and the solver of one
 * texel. */
#pragma once

#include "maps_fit.h"

#define MAPS_COLUMNS 3 /* the columns of the linear solution: d, S, e */
/* The shape of a texel's lobes: the normal's x and y; p, q, r, with log αt, log αb = p ± |(q, r)|
 * and t at ½ atan2(r, q); and w. */
#define MAPS_SHAPE 6

/* The planes of struct maps_pairs, each of n numbers: x, y, z of the unit vectors of view (V),
 * light (L) and half vector (H), f5, and E. */
enum maps_plane {
    MAPS_VX,
    MAPS_VY,
    MAPS_VZ,
    MAPS_LX,
    MAPS_LY,
    MAPS_LZ,
    MAPS_HX,
    MAPS_HY,
    MAPS_HZ,
    MAPS_F5,
    MAPS_EXTRA,
    MAPS_PLANES
};
struct maps_pairs {
    int n;
    int *index; /* pair: view · n_lights + light */
    float *planes[MAPS_PLANES];
    gboolean extra; /* whether E is not 0 for some pair */
    enum maps_model model;
};

/* Returns the pairs of a view and a light that are both at least 1.2° above the plane of the
 * sample. If the BTF has more than MAPS_MAX_PAIRS pairs, takes only every second, third, … pair. */
struct maps_pairs *maps_pairs_new(const struct btf_layout *layout, enum maps_model model);
/* Computes the plane E (MAPS_EXTRA) for the layers, with the normal z. */
void maps_pairs_set_layers(struct maps_pairs *pairs, const struct maps_layers *layers);
void maps_pairs_free(struct maps_pairs *pairs); /* NULL is ignored */

/* The buffers and weights with which texels are fitted, one after the other. One thread at a
 * time. */
struct maps_solver;
struct maps_solver *maps_solver_new(const struct maps_pairs *pairs);
void maps_solver_free(struct maps_solver *solver);

/* The result of a fit: the shape, the factors of the columns, and the cost, Σ u² r² / Σ u² Y², with
 * the weights u of maps_fit.h and the residuals r. */
struct maps_solution {
    float shape[MAPS_SHAPE], factors[MAPS_COLUMNS];
    double cost;
};
/* Fits one texel. rgb is pairs × 3 and may contain NaN. The fit begins with each of the shapes in
 * starts, and the best result is kept. Returns FALSE if the texel has no light. */
gboolean maps_solver_run(struct maps_solver *solver, const float *rgb,
                         float (*const starts)[MAPS_SHAPE], int n_starts,
                         struct maps_solution *ret);
/* Computes all members of ret from the solution of maps_solver_run(). rgb is that of the last call
 * of maps_solver_run() with this solver. */
void maps_solver_colours(struct maps_solver *solver, const float *rgb,
                         const struct maps_layers *layers, const struct maps_solution *solution,
                         struct maps_texel *ret);
