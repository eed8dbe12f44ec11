/* The files lobes*.c share the fit, its initial values, the properties of the models and their file
 * in memory. */
#pragma once

#include "base/direction.h"
#include "exr/exr.h"
#include "lobes.h"

#define LOBES_MAX_PARAMETERS (4 * LOBES_MAX_LOBES + 1)

/* Solves many small non-linear least-squares problems of one kind by Levenberg–Marquardt. Eight
 * problems are solved together in the lanes of vectors. Each problem has its own damping and
 * bounds, and ends independently. A lane whose problem is solved takes the next problem. The result
 * of a problem does not depend on the others.
 *
 * Parameters during the fit are chosen so that a lobe of exponent 1 is linear in them:
 *   lobe       g (3), log N:   |g| ⟨g/|g| · w⟩^N,  so that (X, Y, Z) = g/|g| · |g|^(1/N)
 *   fields     k lobes
 *   lafortune  k lobes, D
 *   ward       slopes of the normal (2), angle of the tangent, log U, log V, diffuse, specular
 *   ashikhmin  the same parameters as ward */
struct lobes_fit {
    enum lobes_model model; /* not ptm, which is solved as a linear problem */
    int n_lobes;
    int n_views, n_lights;       /* for fields, n_views is 1, and the view is ignored */
    const float *views, *lights; /* n_views × 3 and n_lights × 3, unit vectors */
};

/* Returns the number of parameters of one problem. */
int lobes_fit_parameters(const struct lobes_fit *fit);

/* Solves n problems. Returns the number of steps in all problems together.
 * - rows: luminances, n × n_views × n_lights; NaN for missing values
 * - parameters: n × lobes_fit_parameters(); the initial values before the call, the result after it
 * - ret_costs: the sum of squared residuals of each problem; may be NULL */
gint64 lobes_fit_rows(const struct lobes_fit *fit, const float *rows, int n, float *parameters,
                      float *ret_costs);

/* Computes the initial values of fits. fit must outlive the struct. */
struct lobes_start;
struct lobes_start *lobes_start_new(const struct lobes_fit *fit);
void lobes_start_free(struct lobes_start *start);
/* variant is 0 … lobes_start_variants() − 1. The caller fits from the initial values of each
 * variant and keeps the best result. lobes_start_rows() gives the initial values, n ×
 * lobes_fit_parameters(), for n rows of luminance. */
int lobes_start_variants(const struct lobes_fit *fit);
void lobes_start_rows(const struct lobes_start *start, int variant, const float *rows, int n,
                      float *ret_parameters);

/* Properties of a model. */
struct lobes_traits {
    const char *name;
    gboolean each_view; /* whether each view has a slice of values */
    gboolean lobed;     /* whether the model has 1 … LOBES_MAX_LOBES lobes of 4 values each */
    /* whether the model has a normal, a tangent and two roughnesses (ward, ashikhmin) */
    gboolean facet;
    int n_values; /* number of values of each texel in a slice, without those of its lobes */
};
extern const struct lobes_traits lobes_traits[LOBES_MODELS];

/* Returns the name of the part that contains value number `value` of each texel (g_free()).
 * *ret_channel is the name of its channel, which is constant. */
char *lobes_value_part(const struct lobes *lobes, int value, const char **ret_channel);

/* Convert between a model and its file in memory, as lobes_write_levels() writes the file and
 * lobes_read() reads it. path is for messages. */
struct exr_file *lobes_to_exr(const struct lobes *lobes);
struct lobes *lobes_from_exr(const struct exr_file *file, const char *path, GError **error);
