/* A mesostructure distance function (MDF) as a few maps that all views share. The depths below the
 * reference plane (mdf_table.h) form a matrix with one row per view and one column per texel. The
 * mean of each view is subtracted, and the matrix is factored by SVD:
 *
 *   depth(x, v) ≈ W_0(v) + Σ_{i=1..c} W_i(v) M_i(x),   M_i(x) = 0 … 255
 *
 * To first order, the depth of a height field along v is the sum of its height and its two slopes,
 * each times a factor that depends only on v. A few maps are therefore enough. Much of what they
 * cannot represent is noise of the measurement. The maps are rounded to 8 bits, then the weights
 * are fitted again to the rounded maps. Texels that no laser saw get the depths that the factors
 * give.
 *
 * A renderer reads W(v) from a table of directions, and M(x) of four maps with one fetch. Filtering
 * the maps is the same as filtering the depths.
 *
 * On disk, one EXR:
 *   part "maps"     channels "M01" … "Mcc", width × height texels, half: 0 … 255
 *   part "weights"  channel "W", width n_views, height c + 1, float, mm: line 0 is W_0
 *   part "views"    channels "phi_deg", "theta_deg", width n_views, height 1, float
 * The attributes of "maps" are mesorig.kind = "mdf-factors", texel_mm, deepest_mm, mesorig.error_mm
 * (double) and mesorig.measured (int). mesorig.measured is the number of measured views. The views
 * after these were traced along the surface. */
#pragma once

#include "base/work.h"
#include "mdf/mdf_table.h"

#define MDF_FACTORS_KIND      "mdf-factors"
#define MDF_FACTORS_MAX_TERMS 32
#define MDF_FACTORS_MAX_VIEWS 4096

struct mdf_factors {
    int width, height;
    int n_views, n_measured, n_terms;
    double texel_mm, deepest_mm;
    float *theta_deg, *phi_deg; /* direction of each view */
    float *weights;             /* n_views × (n_terms + 1), mm; the first of each view is W_0 */
    guint8 *maps;               /* n_terms × height × width */
    /* RMS error over the visible texels of the measured views (mdf_table_difference()) */
    double error_mm;
};

typedef struct mdf_factors MdfFactors;
void mdf_factors_free(struct mdf_factors *factors); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfFactors, mdf_factors_free)

/* Factors a table. Its first n_measured views were measured. The other views were added by
 * mdf_table_add_grazing(). Computes n_terms maps if target_mm is 0.
 *
 * If target_mm > 0, computes the smallest number of maps whose error_mm is at most target_mm. If
 * even n_terms maps have a larger error, fails, and the message gives this error.
 *
 * A material without relief has one map whose values are 0. Any thread. */
struct mdf_factors *mdf_factors_compute(const struct mdf_table *table, int n_measured, int n_terms,
                                        double target_mm, GCancellable *cancellable,
                                        GError **error);

/* Returns the views that the factors reconstruct, uncompressed. */
struct mdf_table *mdf_factors_table(const struct mdf_factors *factors);

/* Returns the bytes of the maps and weights in the memory of a renderer. */
gint64 mdf_factors_bytes(const struct mdf_factors *factors);

/* Writes or reads a file. Errors are in the domain EXR_ERROR. */
gboolean mdf_factors_write(const char *path, const struct mdf_factors *factors, GError **error);
struct mdf_factors *mdf_factors_read(const char *path, GError **error);
