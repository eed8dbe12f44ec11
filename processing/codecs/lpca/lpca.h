/*
 * Local PCA of a BTF (Schneider 2004 §3, after Müller et al. 2003). The BTF is treated as one
 * BRDF per texel; texels are clustered, and each cluster has its own mean and eigen-BRDFs:
 *
 *   B(x) ≈ E_{0,k(x)} + Σ_{i=1..c} w_i(x) E_{i,k(x)}
 *
 * The w_i span the same space as the texels' coordinates along the principal axes of their cluster
 * in a reduced space, and the E_i are the best for these weights in all dimensions, so that reading
 * the BTF twice gives both. For packed local PCAs, as in the paper, w_i(x) = ⟨B(x) − E_{0,k(x)},
 * E_{i,k(x)}⟩, for which the BTF is read a third time. E_{0,k} is the mean of cluster k, with
 * weight 1 (§4 of the paper leaves it out of its sum). Values hold n·l already. The E_{i,k}, i ≥ 1,
 * are orthonormal and in order of the variance they explain, so that leaving out the last ones is
 * optimal with fewer; those that a cluster does not need are 0.
 *
 * On disk, one EXR "lpca.exr":
 *   part "clusters"         channel "K", width × height texels, float: k(x)
 *   part "weights"          channels "W01" … "Wcc", width × height texels, half (or float): w_i(x)
 *   part "scales"           channel "S", width n_clusters, height c + 1, float
 *   part "means"            channels B G R, width n_lights, height n_clusters · n_views
 *   part "E01" … "Ecc"      the same shape: line k · n_views + v, column l:
 *                           E_{i,k}(v, l) / (S_{i,k} S_{i,k,l})
 *   part "views", "lights"  channels "phi_deg", "theta_deg", width n, height 1, float
 *   part "weight_scales"    channel "S", width n_clusters, height c, float; 8bit-weights alone
 *   part "light_scales"     channel "S", width n_lights, height n_clusters · (c + 1), half: line
 *                           k · (c + 1) + i, column l: S_{i,k,l}; if missing, 1
 *
 * Attributes of "clusters": mesorig.kind = "lpca", mesorig.name (string), mesorig.quantise (string:
 * float, half, 8bit, 8bit-weights, packed), mesorig.error (double, see lpca_error()), texel_mm,
 * reference_mm (double), mesorig.grid (int) where there is an n_grid, and mesorig.colours (string)
 * = "log" for decorrelated colours, see below.
 *
 * Quantised to 8 bits (§6.3), the stored E_i, i ≥ 1, are integers −127 … 127 (they are signed),
 * with a scale for each E_i and a further one for each light of it: under grazing light all values
 * are dark, and steps that suit bright light would be seen. (A local PCA on a grid has no scales of
 * lights, because it is drawn with the file's 8 bits.) Means stay halves, because no small weight
 * makes their steps smaller. With 8bit-weights, weights are such integers, too, with a scale for
 * each component of each cluster. EXR has no 8-bit channels: the integers lie in halves, without
 * loss. In the other forms all scales are 1.
 *
 * Decorrelated colours (LPCA_LOG): in place of R, G, B the sums are of ln(Y + ε), (R − Y)/(Y + ε),
 * (B − Y)/(Y + ε), with Y = 0.2126 R + 0.7152 G + 0.0722 B and ε = LPCA_LOG_OFFSET: dark values
 * then count as much as bright ones.
 */
#pragma once

#include "base/team.h"
#include "btf/btf_checkpoint.h"
#include "btf/btf_matrix.h"

#define LPCA_MAX_CLUSTERS   1024
#define LPCA_MAX_COMPONENTS 64

/* lpca_quantise() takes the first LPCA_QUANTISE_KINDS; lpca_pack.h makes packed ones. */
enum lpca_quantise { LPCA_FLOAT, LPCA_HALF, LPCA_8BIT, LPCA_8BIT_WEIGHTS, LPCA_PACKED };
#define LPCA_QUANTISE_KINDS 4
const char *lpca_quantise_name(enum lpca_quantise quantise);
gboolean lpca_quantise_parse(const char *name, enum lpca_quantise *ret);

enum lpca_colours { LPCA_RGB, LPCA_LOG };
#define LPCA_LOG_OFFSET 0.01F
/* n colours of three, in place. */
void lpca_to_log(float *values, gsize n);
void lpca_from_log(float *values, gsize n);

struct lpca {
    char *name;
    struct btf_layout layout;
    int n_clusters, n_components;
    int n_grid; /* 0; or views and lights are the n_grid² samples of resample.h, not measured ones
                 */
    int *clusters;  /* height × width: k(x) */
    float *weights; /* height × width × n_components */
    float *brdfs;   /* n_clusters × (n_components + 1) × n_views × n_lights × 3 (R, G, B) */
    float *scales;  /* n_clusters × (n_components + 1): steps of brdfs if 8 bit, else 1 */
    float *light_scales;  /* n_clusters × (n_components + 1) × n_lights; NULL: all are 1 */
    float *weight_scales; /* n_clusters × n_components: likewise of weights */
    enum lpca_quantise quantise;
    enum lpca_colours colours;
    double error;               /* as lpca_error() found it; 0 if it was not asked */
    struct lpca_packed *packed; /* what its file holds if it is packed, see lpca_pack.h; or NULL */
};

/* The result that came nearest to a target that is not reached. */
struct lpca_nearest {
    int n_clusters, n_components; /* 0: nothing */
    double error;
};

struct lpca_options {
    int n_clusters, n_components;
    double target; /* 0, or the error to reach: n_components is then the maximum */
    struct work work;
    enum lpca_colours colours;
    gint64 memory;           /* 0, or bytes that may be used beside the BTF's values */
    const struct team *team; /* NULL: this process is alone */
    gboolean to_pack;        /* up to LPCA_MAX_PACKED components, which only lpca_pack.h takes */
    /* NULL, or a checkpoint, which is saved from time to time and when the work is cancelled or
     * fails. The same call continues from it, with the same result. Must be NULL with a team. */
    Checkpoint *checkpoint;
    struct lpca_nearest *nearest; /* may be NULL: filled where a target is not reached */
};

typedef struct lpca Lpca;
void lpca_free(struct lpca *lpca); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Lpca, lpca_free)

/* Computes a local PCA (LPCA_FLOAT) of a whole matrix of finite values, in memory or in a file.
 * Clusters that are not needed are left out: a constant material has one. The result does not
 * depend on the number of threads. Progress stages are "reduce", "cluster", "refine", "weights" if
 * it is to be packed, and "check" if errors are measured. With a target, it is computed with 1, 2,
 * 4, … components until the target is reached; if the target cannot be reached, the error says how
 * near the result came.
 *
 * With a team every rank calls this with its own part of the texels (TEAM_ROWS) as the rows of
 * btf->values, and all ranks get the whole result. Clusters do not depend on the number of ranks;
 * other numbers do, since the ranks' sums are rounded differently. */
struct lpca *lpca_compute(const struct btf_matrix *btf, const struct lpca_options *options,
                          GError **error);

/* The same with fewer components. */
struct lpca *lpca_truncated(const struct lpca *lpca, int n_components);

/* Rounds the values in memory to those that a file of this kind gives back. To be called once, on
 * LPCA_FLOAT. */
void lpca_quantise(struct lpca *lpca, enum lpca_quantise quantise);

/* Bytes it takes beside the BTF's values. */
gint64 lpca_memory(const struct btf_matrix *btf, const struct lpca_options *options);

/* ‖X − X̂‖_F / ‖X‖_F of R, G, B, also kept in lpca->error; 0 for a black BTF. */
double lpca_error(struct lpca *lpca, const struct btf_matrix *btf, int n_threads);
/* The same for options' team, with progress. */
gboolean lpca_error_shared(struct lpca *lpca, const struct btf_matrix *btf,
                           const struct lpca_options *options, GError **error);

/* Bytes of index, weights and BRDFs as a renderer holds them; of a packed one as if in halves. */
gint64 lpca_bytes(const struct lpca *lpca);

/* One texel: n_views × n_lights × 3. */
void lpca_reconstruct(const struct lpca *lpca, int texel, float *ret);

gboolean lpca_write(const char *path, const struct lpca *lpca, GError **error);
struct lpca *lpca_read(const char *path, GError **error);
