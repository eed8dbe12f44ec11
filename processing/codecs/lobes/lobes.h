/*
 * These analytic models of a BTF are fitted to each texel, and need only a few numbers for each
 * texel. The models fields, ptm and lafortune describe the luminance Y = 0.2126 R + 0.7152 G +
 * 0.0722 B, which is multiplied by one colour per texel. The models ward and ashikhmin have a
 * diffuse and a specular colour per texel. ⟨x⟩ is max(x, 0). l and v are unit vectors to light and
 * view in the sample frame. Values contain n·l (pipeline.h) and are not multiplied by it again.
 *
 * Models of single views ("reflectance fields"), which are interpolated between views:
 *   fields     Y_v(l) = Σ_{i=1..k} ⟨(X_i, Y_i, Z_i) · l⟩^N_i           (Meseth et al. 2003 eq. 1)
 *   ptm        Y_v(l) = C0 lx² + C1 ly² + C2 lx ly + C3 lx + C4 ly + C5
 *                                                                     (Malzbender et al. 2001)
 * Models of all views together:
 *   lafortune  Y(v, l) = lz · (D + Σ_{i=1..k} ⟨(X_i, Y_i, Z_i) · (vx lx, vy ly, vz lz)⟩^N_i)
 *                                                                     (Lafortune et al. 1997)
 *   ward, ashikhmin  RGB(v, l) = ⟨n·l⟩ · diffuse + specular · s(v, l)
 * with a normal n and a tangent t per texel, b = n × t, and the half vector h, hx = h·t, hy = h·b,
 * hn = h·n. s is 0 where n·l ≤ 0, otherwise:
 *   ward       s = √(n·l / max(n·v, 0.1)) / (4 U V) · exp(−2 ((hx/U)² + (hy/V)²) / (1 + hn))
 *              (Ward 1992; the exponent of Kang & Cho 2011 eq. 3 with its squares)
 *   ashikhmin  s = √((U+1)(V+1)) / 8 · hn^((U hx² + V hy²)/(1 − hn²))
 *                  · n·l / (h·l · max(n·l, n·v, 0.1))
 *              (Ashikhmin & Shirley 2000, without the Fresnel factor)
 * For both models, s is π f_r n·l, because values are relative to a white diffuser.
 *
 * No half float overflows: the exponents N lie in LOBES_MIN_EXPONENT … LOBES_MAX_EXPONENT. The peak
 * of a lobe, |(X, Y, Z)|^N, is at most LOBES_MAX_PEAK and at most four times the brightest value to
 * which the lobe was fitted.
 *
 * On disk, one EXR "fields.exr" (ptm.exr, …) of half floats. Each part is a picture of the texels.
 * For fields and ptm, the pictures of all views are below each other in one part: line v · height +
 * y.
 *   part "colour"              channels B G R, by which Y is multiplied (not ward, ashikhmin)
 *   part "lobe1" … "lobek"     channels N X Y Z (fields, lafortune)
 *   part "diffuse"             channel "D" (lafortune); channels B G R (ward, ashikhmin)
 *   part "polynomial"          channels C0 … C5 (ptm)
 *   part "specular"            channels B G R      |
 *   parts "normal", "tangent"  channels X Y Z      | ward, ashikhmin
 *   part "roughness"           channels U V        |
 *   parts "views", "lights"    channels "phi_deg", "theta_deg", width n, height 1, float
 * Attributes of the first part: mesorig.kind ("fields", "ptm", "lafortune", "ward" or "ashikhmin"),
 * mesorig.name (string); mesorig.lobes, mesorig.slices, mesorig.width, mesorig.height (int);
 * mesorig.error, mesorig.exact_error, mesorig.luminance_error, texel_mm, reference_mm (double).
 */
#pragma once

#include "codecs/lpca/lpca.h"

#define LOBES_MAX_LOBES    3
#define LOBES_MIN_EXPONENT 0.5F
#define LOBES_MAX_EXPONENT 64.0F
#define LOBES_MAX_PEAK     64.0F

enum lobes_model { LOBES_FIELDS, LOBES_PTM, LOBES_LAFORTUNE, LOBES_WARD, LOBES_ASHIKHMIN };
#define LOBES_MODELS 5

/* Convert between a model and its name, which is mesorig.kind of its files. lobes_model_parse()
 * returns FALSE if no model has the name. */
const char *lobes_model_name(enum lobes_model model);
gboolean lobes_model_parse(const char *name, enum lobes_model *ret);

struct lobes {
    enum lobes_model model;
    char *name;
    struct btf_layout layout;
    int n_lobes;  /* k, 1 … LOBES_MAX_LOBES for fields and lafortune; otherwise 0 */
    int n_slices; /* n_views for fields and ptm, otherwise 1 */
    int n_values; /* number of values of each texel in a slice */
    /* n_slices × height × width × n_values, in the order:
     *   fields          R G B of the colour, k × X Y Z N
     *   ptm             R G B of the colour, C0 … C5
     *   lafortune       R G B of the colour, D, k × X Y Z N
     *   ward, ashikhmin R G B diffuse, R G B specular, X Y Z normal, X Y Z tangent, U V */
    float *values;
    /* error            relative RMS error of R, G, B against the encoded BTF
     * luminance_error  mean of |Y − Ŷ| (Meseth et al. 2003, Table 1)
     * exact_error      relative RMS error before the values were rounded to half floats */
    double error, luminance_error, exact_error;
};

struct lobes_options {
    enum lobes_model model;
    /* number of lobes; 0 means 2 (Meseth et al. 2003). Models without lobes ignore the number */
    int n_lobes;
    struct work work;
    /* NULL, or a checkpoint. The checkpoint is saved at intervals and when the work is cancelled. A
     * later call for the same BTF, model and number of lobes continues from the checkpoint and
     * gives the same result as without an interruption. */
    Checkpoint *checkpoint;
};

void lobes_free(struct lobes *lobes); /* NULL is ignored */

/* Fits the luminance by least squares: over all lights of each view for fields and ptm, over all
 * views and lights for the other models. Values of the BTF that are NaN are left out of the fit.
 * Texels without any value become black. The values of the result are rounded to half floats, as in
 * the file. The result does not depend on the number of threads. The progress stage is "fit". Fails
 * if the model or the number of lobes does not exist, if the BTF is empty, too large or has an
 * infinite value, or if the work is cancelled. */
struct lobes *lobes_compute(const struct btf_matrix *btf, const struct lobes_options *options,
                            GError **error);

/* Reconstructs one texel at the measured directions: n_views × n_lights × 3. */
void lobes_reconstruct(const struct lobes *lobes, int texel, float *ret);

/* Evaluates R, G, B of a texel for any view and light. For fields and ptm, slice is the index of a
 * measured view, and view is ignored. For the other models, slice is 0. The result of ptm may be
 * negative. */
void lobes_evaluate(const struct lobes *lobes, int slice, int texel, const float view[3],
                    const float light[3], float ret[3]);

/* Computes error and luminance_error over all values of the BTF that are not NaN, and stores them
 * in lobes. Returns error. */
double lobes_error(struct lobes *lobes, const struct btf_matrix *btf, int n_threads);

/* Returns the bytes of all values as halves, as a renderer holds them. */
gint64 lobes_bytes(const struct lobes *lobes);

/* Reads the model of level 0 of a file (lobes_levels.h). Errors: EXR_ERROR. */
struct lobes *lobes_read(const char *path, GError **error);
