/*
 * Eigen-maps of a BTF (seed 004 §5): A with rows (texel, light, channel) and columns (view) is
 * factored by SVD, BTF(x, y, v, l) ≈ Σ_i W_i(v) E_i(x, y, l).
 *
 * On disk, one EXR "eigenmaps.exr":
 *   part "weights"            channel "W", width n_views, height n_terms, float; row i is W_i(v)
 *   part "views", "lights"    channels "phi_deg","theta_deg", width n, height 1, float
 *   part "E000_light_0000"    channels B G R, half, width × height texels; term, light
 * attributes of "weights": mesorig.kind = "eigenmaps", mesorig.name (string), texel_mm (double),
 * reference_mm (double)
 */
#pragma once

#include <glib.h>

struct eigenmaps {
    char *name;
    int width, height; /* texels */
    double texel_mm, reference_mm;
    int n_views, n_lights, n_terms;
    float *view_theta_deg, *view_phi_deg;   /* n_views */
    float *light_theta_deg, *light_phi_deg; /* n_lights */
    float *weights;                         /* n_terms × n_views */
    float *maps; /* n_terms × n_lights × height × width × 3 (R, G, B) */
};

void eigenmaps_free(struct eigenmaps *maps); /* NULL is ignored */
struct eigenmaps *eigenmaps_read(const char *path, GError **error);
gboolean eigenmaps_write(const char *path, const struct eigenmaps *maps, GError **error);

/* Gives the columns of A one view at a time: n_lights × height × width × 3 floats (R, G, B). */
typedef gboolean (*EigenmapsColumn)(int view, float *ret_column, gpointer data, GError **error);

/* Fills weights and maps (allocated here), everything else being set. Exact: W_i are the unit
 * eigenvectors of AᵀA, in double precision, E_i = A·W_i; the largest entry of each W_i is positive.
 * The result does not depend on the number of threads. ret_error is ‖A − Â‖_F / ‖A‖_F. */
gboolean eigenmaps_compute(struct eigenmaps *maps, EigenmapsColumn column, gpointer data,
                           double *ret_error, GError **error);

/* The same with at most this much memory for columns (two are held at least); eigenmaps_compute()
 * takes EIGENMAPS_MEMORY. Columns that do not fit are asked for again and again. */
#define EIGENMAPS_MEMORY ((gsize)256 << 20)
gboolean eigenmaps_compute_within(gsize memory, struct eigenmaps *maps, EigenmapsColumn column,
                                  gpointer data, double *ret_error, GError **error);
