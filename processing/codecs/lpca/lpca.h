/* Local PCA of a BTF (Schneider 2004 §3, after Müller et al. 2003). The BTF is treated as one BRDF
 * per texel. The texels are clustered, and each cluster has its own mean and eigen-BRDFs:
 *
 *   B(x) ≈ E_{0,k(x)} + Σ_{i=1..c} w_i(x) E_{i,k(x)}
 *
 * E_{0,k} is the mean of cluster k and has the weight 1 (§4 of the paper omits it from its sum).
 * Values contain n·l. The E_{i,k}, i ≥ 1, are orthonormal and sorted by the variance that they
 * explain. The first ones are therefore the best choice for a smaller number of components. The
 * E_{i,k} that a cluster does not need are 0.
 *
 * The texels are clustered in a space of fewer dimensions. In this space, a texel has coordinates
 * along the principal axes of its cluster. The w_i are linear combinations of these coordinates.
 * The E_i have all dimensions, and are the best E_i for these w_i. The BTF is therefore read only
 * twice. For packed local PCAs the BTF is read a third time, and the w_i are those of the paper:
 * w_i(x) = ⟨B(x) − E_{0,k(x)}, E_{i,k(x)}⟩.
 *
 * On disk, one EXR "lpca.exr":
 *   part "clusters"         channel "K", width × height texels, float: k(x)
 *   part "weights"          channels "W01" … "Wcc", width × height texels, half (or float): w_i(x)
 *   part "scales"           channel "S", width n_clusters, height c + 1, float
 *   part "means"            channels B G R, width n_lights, height n_clusters · n_views
 *   part "E01" … "Ecc"      the same shape: line k · n_views + v, column l:
 *                           E_{i,k}(v, l) / (S_{i,k} S_{i,k,l})
 *   part "views", "lights"  channels "phi_deg", "theta_deg", width n, height 1, float
 *   part "weight_scales"    channel "S", width n_clusters, height c, float; only with 8bit-weights
 *   part "light_scales"     channel "S", width n_lights, height n_clusters · (c + 1), half: line
 *                           k · (c + 1) + i, column l: S_{i,k,l}; if missing, 1
 *
 * The attributes of "clusters" are mesorig.kind = "lpca", mesorig.name (string), mesorig.quantise
 * (string: float, half, 8bit, 8bit-weights, packed), mesorig.error (double, see lpca_error()),
 * texel_mm, reference_mm (double), mesorig.grid (int) if n_grid is not 0, and mesorig.colours
 * (string) = "log" for decorrelated colours (see below).
 *
 * Quantised to 8 bits (§6.3), the stored E_i, i ≥ 1, are signed integers −127 … 127. Each E_i
 * has a scale, and each light of an E_i has a further scale: under grazing light all
 * values are dark, and the steps that suit bright light would be visible. (A local PCA on a grid
 * has no scales of lights, because it is drawn with the file's 8 bits.) Means stay halves, because
 * their weight is always 1 and their steps would be visible. With 8bit-weights, weights are also
 * stored as integers −127 … 127, with a scale for each component of each cluster. EXR has no 8-bit
 * channels, so that the integers are stored in halves, without loss. In the other forms all scales
 * are 1.
 *
 * With decorrelated colours (LPCA_LOG), the PCA is not of R, G, B but of ln(Y + ε), (R − Y)/(Y +
 * ε), (B − Y)/(Y + ε), with Y = 0.2126 R + 0.7152 G + 0.0722 B and ε = LPCA_LOG_OFFSET. Dark values
 * then count as much as bright values. */
#pragma once

#include "base/team.h"
#include "btf/btf_checkpoint.h"
#include "btf/btf_matrix.h"

#define LPCA_MAX_CLUSTERS   1024
#define LPCA_MAX_COMPONENTS 64

/* lpca_quantise() accepts the first LPCA_QUANTISE_KINDS. lpca_pack.h makes packed local PCAs. */
enum lpca_quantise { LPCA_FLOAT, LPCA_HALF, LPCA_8BIT, LPCA_8BIT_WEIGHTS, LPCA_PACKED };
#define LPCA_QUANTISE_KINDS 4
/* Convert between a kind and its name, which is mesorig.quantise of the file. lpca_quantise_parse()
 * returns FALSE if no kind has the name. */
const char *lpca_quantise_name(enum lpca_quantise quantise);
gboolean lpca_quantise_parse(const char *name, enum lpca_quantise *ret);

enum lpca_colours { LPCA_RGB, LPCA_LOG };
#define LPCA_LOG_OFFSET 0.01F
/* lpca_to_log() converts n colours R, G, B in place to the decorrelated colours of LPCA_LOG.
 * lpca_from_log() converts them back. */
void lpca_to_log(float *values, gsize n);
void lpca_from_log(float *values, gsize n);

struct lpca {
    char *name;
    struct btf_layout layout;
    int n_clusters, n_components;
    /* if not 0, views and lights are the n_grid² samples of lpca_resample.h instead of measured
     * directions */
    int n_grid;
    int *clusters;  /* height × width: k(x) */
    float *weights; /* w_i(x): height × width × n_components */
    /* E_i, the mean first: n_clusters × (n_components + 1) × n_views × n_lights × 3 (R, G, B) */
    float *brdfs;
    /* n_clusters × (n_components + 1): steps of brdfs if they have 8 bits, otherwise 1 */
    float *scales;
    float *light_scales; /* n_clusters × (n_components + 1) × n_lights; NULL if all are 1 */
    /* n_clusters × n_components: steps of weights if they have 8 bits, otherwise 1 */
    float *weight_scales;
    enum lpca_quantise quantise;
    enum lpca_colours colours;
    double error; /* relative error from lpca_error(); 0 if it was not called */
    /* content of the file if it is packed, see lpca_pack.h; otherwise NULL */
    struct lpca_packed *packed;
};

/* The result that came nearest to a target that was not reached. */
struct lpca_nearest {
    int n_clusters, n_components; /* 0 if there is no such result */
    double error;
};

struct lpca_options {
    int n_clusters, n_components;
    /* 0, or the relative error (lpca_error()) to reach; n_components is then the maximum number of
     * components */
    double target;
    struct work work;
    enum lpca_colours colours;
    /* maximum bytes of memory in addition to the BTF's values; 0 if not limited */
    gint64 memory;
    /* processes that share the work; NULL if this process works alone */
    const struct team *team;
    /* whether lpca_pack.h will pack the result, which may then have LPCA_MAX_PACKED components */
    gboolean to_pack;
    /* NULL, or a checkpoint. The checkpoint is saved at intervals and when the work is cancelled or
     * fails. A later call with the same arguments continues from the checkpoint and gives the same
     * result. Must be NULL with a team. */
    Checkpoint *checkpoint;
    struct lpca_nearest *nearest; /* filled if a target is not reached; may be NULL */
};

typedef struct lpca Lpca;
void lpca_free(struct lpca *lpca); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Lpca, lpca_free)

/* Computes a local PCA (LPCA_FLOAT) of a whole matrix of finite values, in memory or in a file.
 * Clusters that are not needed are left out: a constant material has one. The result does not
 * depend on the number of threads. Progress stages are "reduce", "cluster", "refine", "weights"
 * (only with to_pack) and "check" (only if errors are measured).
 *
 * With a target, computes local PCAs of 1, 2, 4, … components until one reaches the target. Then
 * finds the smallest number of components that reaches it. If the target is not reached with
 * n_components, returns NULL, and the message says how large the error with n_components is.
 *
 * Also returns NULL with an error if
 * - the BTF is empty, too large or has a value that is not finite
 * - options give impossible numbers or too little memory
 * - the work is cancelled.
 *
 * With a team, every rank calls this function with its own part of the texels (TEAM_ROWS) as the
 * rows of btf->values, and all ranks get the whole result. The clusters do not depend on the number
 * of ranks. The other numbers of the result depend on the number of ranks, because the sums of the
 * ranks are rounded differently. */
struct lpca *lpca_compute(const struct btf_matrix *btf, const struct lpca_options *options,
                          GError **error);

/* Returns a copy with only the first n_components components, which must be from 1 to the number of
 * components of lpca. The member `error` of the copy is 0. Its member `quantise` is that of lpca,
 * or LPCA_FLOAT if lpca is packed. */
struct lpca *lpca_truncated(const struct lpca *lpca, int n_components);

/* Rounds the values in memory as lpca_write() rounds them in a file of the kind `quantise`. The
 * local PCA must be LPCA_FLOAT before the call. Its error becomes 0, because it is not measured
 * again. */
void lpca_quantise(struct lpca *lpca, enum lpca_quantise quantise);

/* Returns the maximum number of bytes of memory that lpca_compute() takes in addition to the BTF's
 * values. */
gint64 lpca_memory(const struct btf_matrix *btf, const struct lpca_options *options);

/* Returns ‖X − X̂‖_F / ‖X‖_F of R, G, B, and stores it in lpca->error. Returns 0 for a black BTF,
 * and NaN if a file of the BTF cannot be read. */
double lpca_error(struct lpca *lpca, const struct btf_matrix *btf, int n_threads);
/* Computes the error of lpca_error(), and stores it in lpca->error. If options->team is not NULL,
 * all its ranks must call this function. The progress stage is "check". Returns FALSE with an error
 * if a file cannot be read or the work is cancelled. */
gboolean lpca_error_shared(struct lpca *lpca, const struct btf_matrix *btf,
                           const struct lpca_options *options, GError **error);

/* Returns the bytes in a renderer's memory: the cluster and the weights of each texel, and the
 * eigen-BRDFs. A packed local PCA counts as if its numbers were halves. */
gint64 lpca_bytes(const struct lpca *lpca);

/* Reconstructs one texel: n_views × n_lights × 3. */
void lpca_reconstruct(const struct lpca *lpca, int texel, float *ret);

/* Errors: EXR_ERROR. */
gboolean lpca_write(const char *path, const struct lpca *lpca, GError **error);
struct lpca *lpca_read(const char *path, GError **error);
