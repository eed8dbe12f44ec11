/* Packed local PCAs, for storage. A renderer unpacks them before it draws them.
 *
 * The method is Tucker's decomposition. Every dimension of the table of eigen-BRDFs (views, lights,
 * colours) is rotated to its own principal axes, which are stored in the file. The weights are
 * pictures, and are rotated by a cosine transform. Rotations keep lengths, so that rounding with
 * one step has the same effect on all values, provided that all values have the same weight in the
 * error. For this reason E_i is first multiplied by S_i = (Σ w_i²)^½ over its cluster, and the mean
 * by the square root of the number of texels in the cluster. Most of the rounded numbers are 0, and
 * most of the noise of a capture is removed. The whole numbers are compressed with xz, one byte for
 * a small number.
 *
 * On disk: the parts of lpca.h except "weights", "scales", "means" and "E…". The attributes of
 * "clusters" are mesorig.quantise = "packed" and mesorig.step (double). Further parts are:
 *   part "scales"           as in lpca.h: S, with the scale of the mean first
 *   part "view_axes"        channel "A", width n_views, height the number of axes, half
 *   part "light_axes"       the same for lights
 *   part "colour_axes"      the same for colours, 3 × 3, float
 *   parts "tables", "maps"  channel "BITS", float, height 1: four bytes of an xz stream per pixel,
 *                           not numbers. The first mesorig.bytes (int) of them are valid
 * A reader makes the rows of each matrix of axes orthonormal by Gram–Schmidt orthogonalisation,
 * from the first row on.
 *
 * An xz stream contains one byte for each number n. Let m be 2n if n ≥ 0, otherwise −2n − 1. The
 * byte is m if m < 255, otherwise 255. After the bytes of all numbers, the stream contains m − 255
 * in 4 bytes (low byte first) for each m ≥ 255.
 *
 * The numbers of tables are sorted by pairs of a view's axis v and a light's axis l: by (v + 3)(l +
 * 3), then by v. Each pair has the three colours one after another, and each colour the tables of
 * all clusters. The numbers of maps are sorted by component, then by x + y, then by x. */
#pragma once

#include "lpca.h"

/* Maximum number of components of a packed local PCA. Other local PCAs have at most
 * LPCA_MAX_COMPONENTS. */
#define LPCA_MAX_PACKED 512

/* A packer holds the rotated tables and weights of a local PCA, before rounding.
 * lpca_packer_round() does not change them, so that the same packer can give results for several
 * steps. */
struct lpca_packer;
/* Rotates the tables and weights of lpca, which must be LPCA_FLOAT and LPCA_RGB. */
struct lpca_packer *lpca_packer_new(const struct lpca *lpca, int n_threads);
void lpca_packer_free(struct lpca_packer *packer); /* NULL is ignored */

/* Rounds all numbers to whole multiples of step. Returns a local PCA (LPCA_PACKED) that can be
 * written. Components at the end are left out if all their numbers round to 0. The member `error`
 * of the result is not set. step is above 0, in the units of the BTF. */
struct lpca *lpca_packer_round(const struct lpca_packer *packer, double step);

/* Returns the RMS of the values of the first cluster's mean. Steps are chosen relative to this RMS.
 * It is 0 for a black material. */
double lpca_mean_size(const struct lpca *lpca);

/* Writes an LPCA_PACKED local PCA to a temporary file, and returns the size of this file in bytes,
 * or 0 with an error. */
gint64 lpca_packed_bytes(const struct lpca *lpca, GError **error);

/* Computes a packed local PCA of one cluster with as many components as needed. With target->error,
 * the step is the coarsest one with which the error is at most target->error. With target->bytes,
 * the step is the finest one with which the file has at most target->bytes. target->n_components is
 * the maximum number of components (0 means LPCA_MAX_PACKED). Other members of target are ignored.
 * The member `error` of the result is set. If the target is not reached, returns NULL, and the
 * GError describes the result that comes nearest. */
struct lpca_target;
struct lpca *lpca_pack(const struct btf_matrix *btf, const struct lpca_options *options,
                       const struct lpca_target *target, GError **error);

/* Converts a local PCA of one cluster to an LPCA_FLOAT one of several clusters, which a renderer
 * can draw. The texels are clustered by their weights. Each cluster has at most LPCA_MAX_COMPONENTS
 * components. Fails if the work is cancelled. */
struct lpca *lpca_regroup(const struct lpca *lpca, const struct lpca_options *options,
                          GError **error);
