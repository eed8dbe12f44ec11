/*
 * Packed local PCAs: for storage. A renderer unpacks them before it draws them.
 *
 * After Tucker: every dimension of the table of eigen-BRDFs is rotated to its own principal axes
 * (views, lights, colours; they lie in the file); weights are pictures, and a cosine transform
 * rotates them. Rotations keep lengths, so that rounding with one step has the same effect on all
 * values: E_i is first multiplied with S_i = (Σ w_i²)^½ over its cluster, the mean with the square
 * root of the cluster's texels. Most of what is left is 0, and noise of a capture is mostly lost.
 * The whole numbers are coded by xz, small ones in a byte.
 *
 * On disk: the parts of lpca.h but for "weights", "scales", "means" and "E…", and mesorig.quantise
 * = "packed", mesorig.step (double) of "clusters"; further
 *   part "scales"           as in lpca.h: S, that of the mean first
 *   part "view_axes"        channel "A", width n_views, height those kept, half
 *   part "light_axes"       the same for lights; "colour_axes" is 3 × 3, float. The rows become
 *                           orthonormal by Gram–Schmidt orthogonalisation in this order
 *   parts "tables", "maps"  channel "BITS", float, height 1: four bytes of an xz stream per pixel,
 *                           not numbers; the first mesorig.bytes (int) of them count. The stream
 *                           has one byte for each number n: 2n, or −2n − 1 if n < 0, or 255 for a
 *                           larger value; then 4 bytes (low first) for each larger value, less 255.
 *                           Order of tables: pairs of a view's axis v and a light's axis l by
 *                           (v + 3)(l + 3), then v; in a pair colour by colour, in a colour the
 *                           tables of all clusters. Order of maps: component by component, in each
 *                           by x + y, then x
 */
#pragma once

#include "lpca.h"

/* Limit of components of a packed local PCA; others have LPCA_MAX_COMPONENTS. */
#define LPCA_MAX_PACKED 512

/* The part that does not depend on the step: made once, rounded as often as needed. */
struct lpca_packer;
struct lpca_packer *lpca_packer_new(const struct lpca *lpca, int n_threads); /* LPCA_FLOAT, RGB */
void lpca_packer_free(struct lpca_packer *packer);                           /* NULL is ignored */

/* Returns a copy that is rounded to whole steps (LPCA_PACKED), without the last components if they
 * are all 0; it can be written. Its error is not set. step > 0, in the units of the BTF. */
struct lpca *lpca_packer_round(const struct lpca_packer *packer, double step);

/* Returns the RMS of the first cluster's mean, which is the average size of a texel's values, for
 * the choice of steps; 0 for a black material. */
double lpca_mean_size(const struct lpca *lpca);

/* Size of the file that lpca_write() writes, found by writing a temporary one; 0 with an error.
 * LPCA_PACKED. */
gint64 lpca_packed_bytes(const struct lpca *lpca, GError **error);

/* Computes one cluster with as many components as needed, and rounds it with the coarsest step that
 * reaches the target's error, or with the finest whose file fits into the target's bytes. Of the
 * other members of target only n_components is used: the most components (0: LPCA_MAX_PACKED). Sets
 * lpca->error. If the target is not reached, the error names the result that comes nearest. */
struct lpca_target;
struct lpca *lpca_pack(const struct btf_matrix *btf, const struct lpca_options *options,
                       const struct lpca_target *target, GError **error);

/* Makes the form for a renderer (LPCA_FLOAT) from a local PCA of one cluster: clusters are found
 * among the texels' weights, each with at most LPCA_MAX_COMPONENTS components. */
struct lpca *lpca_regroup(const struct lpca *lpca, const struct lpca_options *options,
                          GError **error);
