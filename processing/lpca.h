/*
 * Local PCA of a BTF (seed 000 §3, after Müller et al. 2003). The BTF is understood as one BRDF a
 * texel; texels are clustered, and each cluster has its own mean and eigen-BRDFs:
 *
 *   B(x) ≈ E_{0,k(x)} + Σ_{i=1..c} w_i(x) E_{i,k(x)},   w_i(x) = ⟨B(x) − E_{0,k(x)}, E_{i,k(x)}⟩
 *
 * E_{0,k} is the mean of cluster k, with weight 1 (§4 of the seed leaves it out of its sum). Values
 * hold n·l already. The E_{i,k}, i ≥ 1, are orthonormal and in order of what they explain, so that
 * leaving out the last ones is again the best with fewer; those a cluster has no use for are 0.
 *
 * On disk, one EXR "lpca.exr":
 *   part "clusters"         channel "K", width × height texels, float: k(x)
 *   part "weights"          channels "W01" … "Wcc", width × height texels, half (or float): w_i(x)
 *   part "scales"           channel "S", width n_clusters, height c + 1, float
 *   part "means"            channels B G R, width n_lights, height n_clusters · n_views
 *   part "E01" … "Ecc"      the same shape: line k · n_views + v, column l: E_{i,k}(v, l) / S_{i,k}
 *   part "views", "lights"  channels "phi_deg", "theta_deg", width n, height 1, float
 * Attributes of "clusters": mesorig.kind = "lpca", mesorig.name (string), mesorig.quantise (string:
 * float, half, 8bit), mesorig.error (double, see lpca_error()), texel_mm, reference_mm (double),
 * and mesorig.grid (int) where there is an n_grid, see below.
 *
 * Quantised to 8 bits (§6.3), the stored E_i, i ≥ 1, are integers −127 … 127 (they are signed),
 * each with a scale of its own; means stay halves, since no small weight makes their steps smaller.
 * EXR has no 8-bit channels: the integers lie in halves, without loss. Else all scales are 1.
 */
#pragma once

#include "pipeline.h"

#define LPCA_MAX_CLUSTERS   1024
#define LPCA_MAX_COMPONENTS 32

/* A BTF in memory: one row a texel, row 0 first, of n_views × n_lights × 3 (R, G, B). */
struct btf_matrix {
    char *name;
    int width, height; /* texels */
    double texel_mm, reference_mm;
    int n_views, n_lights;
    float *view_theta_deg, *view_phi_deg;   /* n_views */
    float *light_theta_deg, *light_phi_deg; /* n_lights */
    float *values;                          /* height · width rows */
    gint64 holes;    /* pixels of the rectified pictures that no good frame pixel shows: 0 */
    char *directory; /* of the session */
};

void btf_matrix_free(struct btf_matrix *btf); /* NULL is ignored */

/* Of a session directory, or of its products/btf. Views that are not there are left out; a view
 * whose lights or texels are other than those of the first is refused. Stage "read". */
struct btf_matrix *btf_matrix_read(const char *path, PipelineFunc progress, gpointer data,
                                   GCancellable *cancellable, GError **error);

enum lpca_quantise { LPCA_FLOAT, LPCA_HALF, LPCA_8BIT };

struct lpca {
    char *name;
    int width, height; /* texels */
    double texel_mm, reference_mm;
    int n_views, n_lights, n_clusters, n_components;
    int n_grid; /* 0; or views and lights are the n_grid² samples of resample.h, not measured ones
                 */
    float *view_theta_deg, *view_phi_deg;   /* n_views */
    float *light_theta_deg, *light_phi_deg; /* n_lights */
    int *clusters;                          /* height × width: k(x) */
    float *weights;                         /* height × width × n_components */
    float *brdfs;  /* n_clusters × (n_components + 1) × n_views × n_lights × 3 (R, G, B) */
    float *scales; /* n_clusters × (n_components + 1): steps of brdfs if LPCA_8BIT, else 1 */
    enum lpca_quantise quantise;
    double error; /* as lpca_error() found it; 0 if it was not asked */
};

struct lpca_options {
    int n_clusters, n_components;
    double target;         /* 0, or the error to reach: n_components is then the most it may take */
    int n_threads;         /* 0: one a processor */
    PipelineFunc progress; /* may be NULL; called from the calling thread */
    gpointer data;
    GCancellable *cancellable; /* may be NULL */
};

void lpca_free(struct lpca *lpca); /* NULL is ignored */

/* Of a whole matrix of finite values; LPCA_FLOAT. Clusters that nothing needs are left out: a
 * constant material has one. Bytes do not depend on the number of threads. Stages "reduce",
 * "cluster", "polish". With a target the clustering is made for 1, 2, 4, … components until it is
 * reached; if it cannot be, the error says how near it came. */
struct lpca *lpca_compute(const struct btf_matrix *btf, const struct lpca_options *options,
                          GError **error);

/* The same with fewer components. */
struct lpca *lpca_truncated(const struct lpca *lpca, int n_components);

/* Rounds what is in memory to what a file of that kind gives back. Once, from LPCA_FLOAT. */
void lpca_quantise(struct lpca *lpca, enum lpca_quantise quantise);

/* ‖X − X̂‖_F / ‖X‖_F of what is in memory, also kept in lpca->error; 0 for a black BTF. */
double lpca_error(struct lpca *lpca, const struct btf_matrix *btf, int n_threads);

/* Bytes of index, weights and BRDFs as a renderer holds them. */
gint64 lpca_bytes(const struct lpca *lpca);

/* One texel: n_views × n_lights × 3. */
void lpca_reconstruct(const struct lpca *lpca, int texel, float *ret);

gboolean lpca_write(const char *path, const struct lpca *lpca, GError **error);
struct lpca *lpca_read(const char *path, GError **error);
