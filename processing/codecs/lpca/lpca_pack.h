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

/* A copy that is rounded to steps, LPCA_PACKED, without last components that are all 0; it may be
 * written. Error is not set. step > 0, in the units of the BTF. */
struct lpca *lpca_packer_round(const struct lpca_packer *packer, double step);

/* RMS of the first cluster's mean, the average size of a texel's values, from which steps are
 * chosen; 0 for a black material. */
double lpca_mean_size(const struct lpca *lpca);

/* Size of the file that lpca_write() writes, found by writing a temporary one; 0 with an error.
 * LPCA_PACKED. */
gint64 lpca_packed_bytes(const struct lpca *lpca, GError **error);

/* One cluster of as many components as it takes: the coarsest step that reaches the error of
 * target, or the finest that fits into its bytes (of the file); of the other fields of target only
 * n_components is used (at most; 0: LPCA_MAX_PACKED). lpca->error is set. If the target is not
 * reached, the error gives the nearest. */
struct lpca_target;
struct lpca *lpca_pack(const struct btf_matrix *btf, const struct lpca_options *options,
                       const struct lpca_target *target, GError **error);

/* The form for a renderer, with clusters found in the components, at most LPCA_MAX_COMPONENTS of
 * them; LPCA_FLOAT. From one cluster only. */
struct lpca *lpca_regroup(const struct lpca *lpca, const struct lpca_options *options,
                          GError **error);
