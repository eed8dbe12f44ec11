/* Declarations that the files of the fit share: pairs of directions (maps_pairs.c), lobes
 * (maps_frame.c), the solver of one texel (maps_solver.c), the refinement of a texel
 * (maps_refine.c), and the priors of the refinement (maps_prior.c). */
#pragma once

#include <math.h>

#include "maps_fit.h"

#define MAPS_COLUMNS 3 /* the columns of the linear solution: d, S, e */
/* The shape of a texel's lobes: x and y of the normal, then p, q and r, then w. p, q and r give log
 * αt, log αb = p ± |(q, r)| and the angle ½ atan2(r, q) of t. */
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

/* Returns the pairs of a view and a light that are both at least 1.15° (z = 0.02) above the plane
 * of the sample. If the BTF has more than MAPS_MAX_PAIRS pairs, takes only every second, third, …
 * pair. */
struct maps_pairs *maps_pairs_new(const struct btf_layout *layout, enum maps_model model);
/* Computes the plane E (MAPS_EXTRA) for the layers, with the normal z. */
void maps_pairs_set_layers(struct maps_pairs *pairs, const struct maps_layers *layers);
void maps_pairs_free(struct maps_pairs *pairs); /* NULL is ignored */

#define MAPS_MIN_LOG_ALPHA (-4.60517F) /* logarithm of the minimum α, MAPS_MIN_ROUGHNESS² */
#define MAPS_MAX_NORMAL    0.85F       /* maximum of |(x, y)| of a normal */

/* The frame (n, t, b) of a shape, αt (member at) and αb (member ab). */
struct maps_frame {
    float n[3], t[3], b[3], direction[2], at, ab;
};
struct maps_frame maps_frame_of(const float shape[MAPS_SHAPE]);
/* Computes the lobes of a frame for all pairs: diffuse is n·l, lobe is π D V n·l. */
void maps_frame_lobes(const struct maps_frame *frame, const struct maps_pairs *pairs,
                      float *restrict diffuse, float *restrict lobe);

/* The buffers and weights with which texels are fitted, one after the other. One thread at a
 * time. */
struct maps_solver;
struct maps_solver *maps_solver_new(const struct maps_pairs *pairs);
void maps_solver_free(struct maps_solver *solver);

/* The result of a fit: the shape, the factors d, S and e, and the cost. The cost is Σ u² r² / Σ u²
 * Y², where u are the weights of maps_fit.h and r the residuals. */
struct maps_solution {
    float shape[MAPS_SHAPE], factors[MAPS_COLUMNS];
    double cost;
};
/* Fits one texel. rgb is pairs × 3 and may contain NaN. The fit begins with one of the n_starts
 * shapes in `starts`, the one with the lowest cost. Returns FALSE if the texel has no light. */
gboolean maps_solver_run(struct maps_solver *solver, const float *rgb,
                         float (*const starts)[MAPS_SHAPE], int n_starts,
                         struct maps_solution *ret);
/* Computes all members of ret from the solution of maps_solver_run(). rgb is that of the last call
 * of maps_solver_run() with this solver. */
void maps_solver_colours(struct maps_solver *solver, const float *rgb,
                         const struct maps_layers *layers, const struct maps_solution *solution,
                         struct maps_texel *ret);

/* Refines a fitted texel: all parameters together, by the colour difference that is seen.
 *
 * maps_solver.c fits the luminance first and the colours afterwards. Diffuse and specular parts are
 * then sometimes not separated. For example, a brown diffuse part is attributed to a wide
 * highlight. The refinement minimises
 *   Σ a_i √(|r_i|² + ½²) / Σ a_i  +  Σ_k ((x_k − μ_k) / σ_k)²
 * over the pairs i of a view and a light. r_i is the difference between model and value in L*, a*
 * and b*. The difference in L* is divided by the tolerance S_L of CIEDE2000 at the value, the
 * differences in a* and b* by S_C. (a* has CIEDE2000's factor 1 + G.) |r_i| is therefore about a
 * CIEDE2000. Because of the root, large differences, such as those of shadows, count with their
 * size instead of their square. a_i is v·z, in proportion to the area that the view shows. x are
 * the parameters below, and μ and σ are the prior.
 *
 * The Levenberg–Marquardt method minimises the sum with weights that are renewed in each step
 * (iteratively reweighted least squares). Sheen and clear coat remain as they are. */

/* The parameters of a texel in the refinement, in this order:
 * - the MAPS_SHAPE values of the shape, the last of which is the specular weight w
 * - the base colour
 * - the reflectance of the dielectric, 0.04 specular_colour
 * - metallic */
enum {
    MAPS_REFINE_BASE = MAPS_SHAPE,
    MAPS_REFINE_F0 = MAPS_REFINE_BASE + 3,
    MAPS_REFINE_METALLIC = MAPS_REFINE_F0 + 3,
    MAPS_REFINE_SIZE
};
struct maps_parameters {
    float x[MAPS_REFINE_SIZE];
};

/* A prior: for each parameter the mean μ and the weight 1/σ². A weight of 0 means that the
 * parameter has no prior. */
struct maps_refine_prior {
    struct maps_parameters mean;
    float weights[MAPS_REFINE_SIZE];
};

/* Buffers of one thread. */
struct maps_refiner;
struct maps_refiner *maps_refiner_new(const struct maps_pairs *pairs,
                                      const struct maps_layers *layers);
void maps_refiner_free(struct maps_refiner *refiner); /* NULL is ignored */

/* Prepares the refinement of a texel: takes its values rgb (pairs × 3), and its sheen or clear
 * coat. If half is TRUE, takes only half of the values. NaN is left out. Returns FALSE if there is
 * no value. rgb is not needed after the call. */
gboolean maps_refiner_take(struct maps_refiner *refiner, const float *rgb,
                           const struct maps_texel *texel, gboolean half);
/* Improves x in at most `steps` steps. A parameter changes only if its bit is set in `moving`.
 * Returns the sum that the refinement minimises (see above). It is about the mean CIEDE2000, and at
 * least ½. */
double maps_refiner_run(struct maps_refiner *refiner, const struct maps_refine_prior *prior,
                        guint moving, int steps, struct maps_parameters *x);

/* Convert between a texel and its parameters. maps_parameters_store() leaves sheen and coat as they
 * are. */
struct maps_parameters maps_parameters_of(const struct maps_texel *texel);
void maps_parameters_store(const struct maps_parameters *from, struct maps_texel *ret);

/* The prior of each texel follows from its cluster and from the texels around it. */

#define MAPS_CLUSTERS 4 /* maximum number of clusters */

/* Clusters of texels that have the same kind of surface, such as the threads of one direction or
 * the grains of one mineral. The clusters are found by k-means from three features of a texel: the
 * share of the diffuse part, the width of the lobe, and the square root of the lobe's
 * reflectance. */
struct maps_clusters {
    int n;
    guint8 *labels;                                /* of each texel, 0 … n − 1 */
    struct maps_parameters medians[MAPS_CLUSTERS]; /* the median of each parameter */
    /* Whether the cluster is a metal. The share of the diffuse part in a texel's reflectance has a
     * median over the cluster. If this median is below MAPS_METAL, the cluster is a metal. Texels
     * of a metal have metallic 1, other texels 0. In the core model no cluster is a metal, because
     * metallic is fitted. */
    gboolean metal[MAPS_CLUSTERS];
};
#define MAPS_METAL 0.08F

/* Finds the clusters of width × height texels. In the core model no cluster is a metal, because the
 * metallic value is fitted. */
struct maps_clusters *maps_clusters_new(const struct maps_parameters *texels, int width, int height,
                                        enum maps_model model);
void maps_clusters_free(struct maps_clusters *clusters); /* NULL is ignored */

/* Changes each of the n texels whose cluster is a metal: its parameters become those of a metal
 * with the same lobe. */
void maps_clusters_set_metals(const struct maps_clusters *clusters, int n,
                              struct maps_parameters *texels);

/* Gives the prior of a texel. The mean μ of the prior is a weighted mean of the texels around it
 * and of the median of its cluster. The weights of the texels depend on their distance and on the
 * difference of their features. For a metal, only metals around it count. For another texel, metals
 * do not count. Normal and base colour have no prior. */
struct maps_refine_prior maps_clusters_prior(const struct maps_clusters *clusters,
                                             const struct maps_parameters *texels, int width,
                                             int height, int texel);

/* Solves A x = b for n unknowns by Cholesky's method. a holds the rows of A; each row begins
 * `stride` values after the beginning of the row before. b becomes x, and A is overwritten. Returns
 * FALSE if A is not positive definite. Inline, because a loop over a constant n is faster. */
static inline gboolean maps_cholesky(int n, int stride, double *a, double *b) {
    for (int j = 0; j < n; j++) {
        double *diagonal = &a[j * stride + j];
        for (int k = 0; k < j; k++)
            *diagonal -= a[j * stride + k] * a[j * stride + k];
        if (!(*diagonal > 0))
            return FALSE;
        *diagonal = sqrt(*diagonal);
        for (int i = j + 1; i < n; i++) {
            for (int k = 0; k < j; k++)
                a[i * stride + j] -= a[i * stride + k] * a[j * stride + k];
            a[i * stride + j] /= *diagonal;
        }
    }
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            b[i] -= a[i * stride + k] * b[k];
        b[i] /= a[i * stride + i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            b[i] -= a[k * stride + i] * b[k];
        b[i] /= a[i * stride + i];
    }
    return TRUE;
}
