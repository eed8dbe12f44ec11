/* Shared by the files of lobes.h. */
#pragma once

#include "base/direction.h"
#include "exr/exr.h"
#include "lobes.h"

#define LOBES_MAX_PARAMETERS (4 * LOBES_MAX_LOBES + 1)

/*
 * Solves many small non-linear least-squares problems of one kind at once, by Levenberg–Marquardt
 * with eight problems side by side in the lanes of vectors. Each has its own damping and bounds,
 * and ends on its own. A lane whose problem is solved takes the next one. A problem's result does
 * not depend on the others.
 *
 * Parameters while fitting, chosen so that a lobe of exponent 1 is linear in them:
 *   lobe       g (3), log N:   |g| ⟨g/|g| · w⟩^N,  so that (X, Y, Z) = g/|g| · |g|^(1/N)
 *   fields     k lobes
 *   lafortune  k lobes, D
 *   ward       slopes of the normal (2), angle of the tangent, log U, log V, diffuse, specular
 *   ashikhmin  the same
 */
struct lobes_fit {
    enum lobes_model model; /* not ptm, which is linear */
    int n_lobes;
    int n_views, n_lights;       /* fields: one view, which is ignored */
    const float *views, *lights; /* × 3, unit vectors */
};

int lobes_fit_parameters(const struct lobes_fit *fit);

/* rows: n × n_views × n_lights of luminance, NaN where there is none. parameters: n × the
 * parameters of a problem: the start before the call, the result after it. ret_costs: n sums of
 * squares, may be NULL. Returns the number of steps in all problems together. */
gint64 lobes_fit_rows(const struct lobes_fit *fit, const float *rows, int n, float *parameters,
                      float *ret_costs);

/* Initial values: n × parameters for n rows. */
struct lobes_start;
struct lobes_start *lobes_start_new(const struct lobes_fit *fit);
void lobes_start_free(struct lobes_start *start);
/* variant: 0 … lobes_start_variants() − 1; if there are several, the best of their results is
 * kept. */
int lobes_start_variants(const struct lobes_fit *fit);
void lobes_start_rows(const struct lobes_start *start, int variant, const float *rows, int n,
                      float *ret_parameters);

/* Properties of a model. */
struct lobes_traits {
    const char *name;
    gboolean each_view; /* a slice of values for each view */
    gboolean lobed;     /* has 1 … LOBES_MAX_LOBES lobes of 4 values */
    gboolean facet;     /* ward, ashikhmin: a normal, a tangent and two roughnesses */
    int n_values;       /* of a texel of a slice, beside the lobes */
};
extern const struct lobes_traits lobes_traits[LOBES_MODELS];

/* Names of the part and the channel in which a value lies; g_free() that of the part. */
char *lobes_value_part(const struct lobes *lobes, int value, const char **ret_channel);

/* What lobes_write() and lobes_read() have in a file; path is for messages. */
struct exr_file *lobes_to_exr(const struct lobes *lobes);
struct lobes *lobes_from_exr(const struct exr_file *file, const char *path, GError **error);
