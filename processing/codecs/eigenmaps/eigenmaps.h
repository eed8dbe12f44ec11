/* Eigen-maps of a BTF (Wang et al. 2005 §5). A matrix A with rows (texel, light, channel) and
 * columns (view) is factored by SVD: BTF(x, y, v, l) ≈ Σ_i W_i(v) E_i(x, y, l).
 *
 * On disk, one EXR "eigenmaps.exr":
 *   part "weights"            channel "W", width n_views, height n_terms, float; row i is W_i(v)
 *   part "views", "lights"    channels "phi_deg","theta_deg", width n, height 1, float
 *   part "E000_light_0000"    one for each term (000) and light (0000): channels B G R, half,
 *                             width × height texels
 * The attributes of "weights" are mesorig.kind = "eigenmaps", mesorig.name (string), texel_mm
 * (double) and reference_mm (double). */
#pragma once

#include "base/scratch_file.h"
#include "btf/btf_layout.h"
#include "exr/exr.h"

struct eigenmaps {
    char *name;
    struct btf_layout layout;
    int n_terms;
    float *weights; /* W_i(v): n_terms × n_views */
    /* E_i(x, y, l): n_terms × n_lights × height × width × 3 (R, G, B). NULL if the maps are in
     * `file`; only eigenmaps_write() and eigenmaps_rounded_error() accept such maps. */
    float *maps;
    ScratchFile *file;
};

void eigenmaps_free(struct eigenmaps *maps); /* NULL is ignored */
/* Read and write the file. Errors are in EXR_ERROR. eigenmaps_write() also fails with G_FILE_ERROR
 * if the file of the maps (member `file`) cannot be read. */
struct eigenmaps *eigenmaps_read(const char *path, GError **error);
gboolean eigenmaps_write(const char *path, const struct eigenmaps *maps, GError **error);
/* Writes the eigen-maps of a BTF of one view. The BTF itself is the only term, with weight 1 and
 * without error. fill() gives the pixels of the part of one light ("E000_light_<light>") just
 * before this part is written, so that memory holds only one part. Of `maps`, only name and layout
 * are used. */
gboolean eigenmaps_write_view(const char *path, const struct eigenmaps *maps, ExrFill fill,
                              gpointer data, GError **error);

/* Callback that gives the column of A for one view: n_lights × height × width × 3 floats (R, G,
 * B). */
typedef gboolean (*EigenmapsColumn)(int view, float *ret_column, gpointer data, GError **error);

/* Callback that gives a part of a column. If `lights` is set in struct eigenmaps_options, the part
 * has n lights from light `first` on (n × height × width × 3). Otherwise, it has n texels from
 * texel `first` on (n_lights × n × 3). */
typedef gboolean (*EigenmapsPart)(int view, gsize first, gsize n, float *ret, gpointer data,
                                  GError **error);

/* Allocates and computes weights and maps. The caller has set all other members. In each W_i, the
 * entry with the largest magnitude is positive. The result does not depend on the number of
 * threads. *ret_error is ‖A − Â‖_F / ‖A‖_F, where Â is the matrix that weights and maps give. If
 * all columns fit into EIGENMAPS_MEMORY the method is exact, otherwise randomised. Fails if n_terms
 * is not 1 … n_views, if column() fails or gives a value that is infinite or NaN, if memory cannot
 * be allocated, or if LAPACK fails. */
#define EIGENMAPS_MEMORY ((gsize)256 << 20)
gboolean eigenmaps_compute(struct eigenmaps *maps, EigenmapsColumn column, gpointer data,
                           double *ret_error, GError **error);

/* Returns ‖A − Â‖_F / ‖A‖_F for the maps as the file stores them, with E_i in half floats. error is
 * *ret_error of eigenmaps_compute(). Returns NaN if the file of the maps cannot be read. */
double eigenmaps_rounded_error(const struct eigenmaps *maps, double error);

/* Exact method: W_i are the unit eigenvectors of AᵀA, in double precision, and E_i = A·W_i. The
 * eigenvalues of the Gram matrix are the squares of the singular values, so that singular values
 * down to 1e-8 of the largest are found. The half floats of the file have a relative precision of
 * only 5e-4. If only m columns fit into memory, each column is requested about n_views / m / 2 + 2
 * times.
 *
 * Randomised method: each column is requested twice. With a target, the number of terms is raised
 * while the error is too large, and each such trial requests each column once more.
 *
 * The range of Aᵀ is approximated by the range of its sketch (SA)ᵀ, n_views × 16384 (Halko,
 * Martinsson and Tropp 2011, algorithm 4.1 for Aᵀ). S is not Gaussian: it adds each row of A, with
 * a random sign, to one of the 16384 rows of SA (Clarkson and Woodruff 2013). A is projected onto
 * the first n_terms right singular vectors of SA, and up to 8 more if memory allows. The best
 * n_terms vectors within their span are then found in double precision (Halko et al. §5.1). The
 * seed is fixed. */
enum eigenmaps_method { EIGENMAPS_AUTO, EIGENMAPS_EXACT, EIGENMAPS_RANDOMISED };

struct eigenmaps_options {
    /* maximum number of bytes for columns in addition to the result; at least one column is in
     * memory. 0 means EIGENMAPS_MEMORY */
    gsize memory;
    /* 0, or the largest error that is allowed. If it is above 0, n_terms is the maximum number of
     * terms. n_terms is then lowered to the smallest number with which the error is at most target.
     * If the error of n_terms terms is above target, the computation fails */
    double target;
    enum eigenmaps_method method;
    /* NULL, or a folder for an unnamed file, in which the maps are kept as floats. The method is
     * then randomised. After the first pass over the columns, maps and columns are computed in
     * blocks, for which `memory` is the limit. The file holds up to 8 maps more than the
     * result. */
    const char *folder;
    /* Used only with `folder`, and then not NULL. */
    EigenmapsPart part;
    /* Used only with `folder`. TRUE: a block is a range of lights; FALSE: a range of texels. */
    gboolean lights;
};
gboolean eigenmaps_compute_with(struct eigenmaps *maps, const struct eigenmaps_options *options,
                                EigenmapsColumn column, gpointer data, double *ret_error,
                                GError **error);
