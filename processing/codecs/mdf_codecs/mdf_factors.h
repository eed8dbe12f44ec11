/*
 * A mesostructure distance function as few maps that all views share. Depths below the reference
 * plane (mdf_table.h), views as rows and texels as columns, minus each view's mean, are factored by
 * SVD:
 *
 *   depth(x, v) ≈ W_0(v) + Σ_{i=1..c} W_i(v) M_i(x),   M_i(x) = 0 … 255
 *
 * A height field seen along v is, to first order, its height and its slopes, each times a factor
 * that depends on v alone; so a few maps suffice, and much of the remainder is noise of the
 * measurement. Maps are rounded to 8 bits, then the weights are fitted again to the rounded ones.
 * Texels that no laser saw get the values of the factors.
 *
 * A renderer has W(v) from a table of directions, and M(x) of four maps at one fetch: filtering
 * maps is the same as filtering depths.
 *
 * On disk, one EXR:
 *   part "maps"     channels "M01" … "Mcc", width × height texels, half: 0 … 255
 *   part "weights"  channel "W", width n_views, height c + 1, float, mm: line 0 is W_0
 *   part "views"    channels "phi_deg", "theta_deg", width n_views, height 1, float
 * attributes of "maps": mesorig.kind = "mdf-factors", texel_mm, deepest_mm, mesorig.error_mm
 * (double), mesorig.measured (int): the number of measured views; the views after them are traced.
 */
#pragma once

#include <gio/gio.h>

#include "mdf/mdf_table.h"

#define MDF_FACTORS_KIND      "mdf-factors"
#define MDF_FACTORS_MAX_TERMS 32
#define MDF_FACTORS_MAX_VIEWS 4096

struct mdf_factors {
    int width, height;
    int n_views, n_measured, n_terms;
    double texel_mm, deepest_mm;
    float *theta_deg, *phi_deg; /* of each view */
    float *weights;             /* n_views × (n_terms + 1) */
    guint8 *maps;               /* n_terms × height × width */
    double error_mm;            /* RMS of what was measured and seen; mdf_table_difference() */
};

typedef struct mdf_factors MdfFactors;
void mdf_factors_free(struct mdf_factors *factors); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfFactors, mdf_factors_free)

/* The first n_measured views of the table were measured, the others are mdf_table_add_grazing()'s.
 * Computes n_terms maps; or, with target_mm > 0, as few as reach that error, n_terms at most. If
 * they do not reach it, the error gives the least error reached. A material without relief has one
 * map, of 0. Any thread. */
struct mdf_factors *mdf_factors_compute(const struct mdf_table *table, int n_measured, int n_terms,
                                        double target_mm, GCancellable *cancellable,
                                        GError **error);

/* The views that the factors reconstruct, uncompressed. */
struct mdf_table *mdf_factors_table(const struct mdf_factors *factors);

/* Bytes a renderer holds: maps and weights. */
gint64 mdf_factors_bytes(const struct mdf_factors *factors);

gboolean mdf_factors_write(const char *path, const struct mdf_factors *factors, GError **error);
struct mdf_factors *mdf_factors_read(const char *path, GError **error);
