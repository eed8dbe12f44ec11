/* Files of reflectance transformation imaging (RTI) contain a picture of the material, seen along
 * the normal. The colours of a texel are functions of the light. A texel's colours are sums of a
 * basis b of the light, f(l) = Σ_j c_j b_j(l), in sRGB with 1 as white. In lrgb the sum is a
 * brightness that multiplies the texel's colour.
 *   .ptm     "PTM_1.2" (Malzbender & Gelb 2001, PTM File Format Version 1.2): text lines with the
 *            version, PTM_FORMAT_RGB or PTM_FORMAT_LRGB, width, height, six scales and six biases;
 *            then bytes. PTM_FORMAT_LRGB: six bytes for each texel, then red, green and blue of
 *            each texel. (In versions before 1.2, red, green and blue of a texel directly follow
 *            the six bytes of this texel.) PTM_FORMAT_RGB: six bytes of red for each texel, then
 *            six of green, then six of blue. The last row of the picture comes first. b = lx², ly²,
 *            lx ly, lx, ly, 1 and 255 c_j = (byte − bias_j) scale_j.
 *   .rti     "#HSH1.2" of RTIBuilder (Cultural Heritage Imaging): lines that begin with #, then
 *            "3", width, height, 3, then the number of terms and two more numbers; f32 scale and
 *            bias of each term; bytes of each texel: the terms of red, of green, of blue. The first
 *            row comes first. b is the basis of hsh.h. c_j = byte / 255 · scale_j + bias_j.
 *   Relight  info.json and planes of coefficients as pictures, see
 *            processing/formats/import_relight.c
 * Any thread. */
#pragma once

#include <glib.h>

#define RTI_PTM_TERMS 6
#define RTI_MAX_TERMS 16

struct rti {
    int width, height; /* row 0 is the top one */
    /* TRUE: the basis is hsh_basis() with 4, 9 or 16 terms. FALSE: it is rti_ptm_basis() with 6
     * terms. */
    gboolean hsh;
    gboolean lrgb;
    int n_terms;
    double scale[RTI_MAX_TERMS], bias[RTI_MAX_TERMS]; /* c_j = (byte − bias_j) · scale_j */
    /* With lrgb height × width × n_terms, otherwise height × width × 3 (R, G, B) × n_terms. The
     * terms of a PTM are in the order of .ptm files. */
    guint8 *bytes;
    guint8 *colours; /* colour of each texel, only for lrgb: height × width × 3 */
};

void rti_free(struct rti *rti); /* NULL is ignored */
typedef struct rti Rti;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Rti, rti_free)

/* Computes the basis lx², ly², lx ly, lx, ly, 1. */
void rti_ptm_basis(const float light[3], float ret[RTI_PTM_TERMS]);

/* Reads a .ptm or .rti. The first bytes of the file tell which of these it is. Errors are
 * DATA_ERROR_INVALID and DATA_ERROR_IO, and name the file. Other forms of PTM (with JPEG, a table
 * of colours, or luminance only) are refused with an error. */
struct rti *rti_read(const char *path, GError **error);

/* Computes R, G, B (sRGB, not limited to 0 … 1) of a texel for these values of the basis. */
void rti_evaluate(const struct rti *rti, gsize texel, const float *basis, float ret[3]);

/* Writes a .ptm. rti must be a PTM, not hsh. */
gboolean rti_write_ptm(const char *path, const struct rti *rti, GError **error);

/* Writes a PTM as a new folder for OpenLIME, with info.json and plane_0.png …. lights (n × 3) are
 * the lights from which the PTM was made. If `replace` is FALSE, the folder appears complete or
 * not at all, and the error is DATA_ERROR_EXISTS if the folder exists already. */
gboolean rti_write_relight(const char *folder, gboolean replace, const struct rti *rti,
                           const float *lights, int n, double texel_mm, GError **error);

/* The result of fitting a PTM to pictures under n lights (Malzbender et al. 2001). The fit is by
 * least squares for each texel and each colour or, with lrgb, for the brightness that multiplies
 * the texel's mean colour. Values that are NaN do not count. A texel with too few values is
 * black. */
struct rti_fit_result {
    /* RMS difference between the values of the PTM and of the pictures (sRGB), over all values that
     * are not NaN */
    double error;
    gint64 clipped; /* number of values of the pictures that are above 1, which viewers clip */
    gint64 holes;   /* number of values that are NaN */
};

/* Fits a PTM. pictures is n × height × width × 3 (R, G, B), sRGB. Returns NULL with
 * DATA_ERROR_INVALID if the lights do not determine six terms. name is for errors. */
struct rti *rti_fit(const char *name, const float *pictures, int width, int height,
                    const float *lights, int n, gboolean lrgb, struct rti_fit_result *ret,
                    GError **error);
