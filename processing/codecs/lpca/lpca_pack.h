/* Packed local PCAs, for storage. A renderer unpacks them before it draws them.
 *
 * The method follows Tucker. Every dimension of the table of eigen-BRDFs (views, lights,
 * colours) is rotated to its own principal axes, which are stored in the file. The weights are
 * pictures, and are rotated by a cosine transform. Rotations keep lengths, so that rounding with
 * one step has the same effect on all values, provided that all values have the same weight in
 * the error. For this reason E_i is first multiplied by S_i = (Σ w_i²)^½ over its cluster, and
 * the mean by the square root of the number of texels in the cluster. Most of the rounded
 * numbers are 0, and most of the noise of a capture is removed. The whole numbers are compressed
 * with xz, one byte for a small number.
 *
 * On disk: the parts of lpca.h except "weights", "scales", "means" and "E…". The attributes of
 * "clusters" are mesorig.quantise = "packed" and mesorig.step (double). Further parts are:
 *   part "scales"           as in lpca.h: S, with the scale of the mean first
 *   part "view_axes"        channel "A", width n_views, height the number of axes, half
 *   part "light_axes"       the same for lights
 *   part "colour_axes"      the same for colours, 3 × 3, float
 *   parts "tables", "maps"  channel "BITS", float, height 1: four bytes of an xz stream per pixel,
 *                           not numbers. The first mesorig.bytes (int) of them are valid
 * The rows of axes become orthonormal by Gram–Schmidt orthogonalisation in their order.
 *
 * An xz stream contains one byte for each number n: 2n, or −2n − 1 if n < 0, or 255 if that
 * value is 255 or larger. After all of these bytes it contains 4 bytes (low byte first) for each
 * such larger value, minus 255.
 *
 * The numbers of tables are sorted by pairs of a view's axis v and a light's axis l: by (v +
 * 3)(l + 3), then by v. Each pair has the three colours one after another, and each colour the
 * tables of all clusters. The numbers of maps are sorted by component, then by x + y, then by x. */
#pragma once

#include "lpca.h"

/* Maximum number of components of a packed local PCA. Other local PCAs have at most
 * LPCA_MAX_COMPONENTS. */
#define LPCA_MAX_PACKED 512

/* The part of the work that does not depend on the step. A packer can be rounded several times. */
struct lpca_packer;
/* only for LPCA_FLOAT and LPCA_RGB */
struct lpca_packer *lpca_packer_new(const struct lpca *lpca, int n_threads);
void lpca_packer_free(struct lpca_packer *packer); /* NULL is ignored */

/* Returns a copy that is rounded to whole steps (LPCA_PACKED) and can be written. The last
 * components are removed if they are all 0. Its error is not set. step is > 0, in the units of the
 * BTF. */
struct lpca *lpca_packer_round(const struct lpca_packer *packer, double step);

/* Returns the RMS of the first cluster's mean, which is the average size of a texel's values, for
 * the choice of steps. Returns 0 for a black material. */
double lpca_mean_size(const struct lpca *lpca);

/* Returns the size of the file that lpca_write() writes, found by writing a temporary file; 0 with
 * an error. For LPCA_PACKED. */
gint64 lpca_packed_bytes(const struct lpca *lpca, GError **error);

/* Computes one cluster with as many components as needed. It is rounded with the coarsest step that
 * reaches the target's error, or with the finest step whose file fits into the target's bytes. Of
 * the other members of target only n_components is used: the maximum number of components (0 means
 * LPCA_MAX_PACKED). Sets lpca->error. If the target is not reached, the error describes the result
 * that comes nearest. */
struct lpca_target;
struct lpca *lpca_pack(const struct btf_matrix *btf, const struct lpca_options *options,
                       const struct lpca_target *target, GError **error);

/* Makes the form for a renderer (LPCA_FLOAT) from a local PCA of one cluster. The weights of the
 * texels are clustered. Each cluster has at most LPCA_MAX_COMPONENTS components. */
struct lpca *lpca_regroup(const struct lpca *lpca, const struct lpca_options *options,
                          GError **error);
