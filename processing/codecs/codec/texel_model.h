/* Models that are fitted to each texel separately (hsh/hsh.h, lobes/lobes.h) share these functions.
 * They check the BTF, compute errors, and read and write the head of a file. */
#pragma once

#include "btf/btf_matrix.h"
#include "exr/exr.h"

/* Attributes of a file's first part: mesorig.kind, mesorig.name (string); two numbers of the model
 * (int); mesorig.width, mesorig.height (int); mesorig.error, mesorig.exact_error,
 * mesorig.luminance_error, texel_mm, reference_mm (double).
 *
 * The first of the two numbers is the number of terms or lobes, or 0 if the model has none. The
 * second is the number of pictures in each part, one below the other. */
struct texel_model_head {
    const char *kind, *name;
    const char *names[2]; /* names of the attributes of the two numbers: "mesorig.terms", … */
    /* the two numbers themselves */
    int numbers[2];
    double error, luminance_error, exact_error; /* as in struct hsh (hsh/hsh.h) */
};

/* Writes the head and the parts "views" and "lights" (btf_layout.h). */
void texel_model_write_head(const struct texel_model_head *head, const struct btf_layout *layout,
                            struct exr_file *file);
const char *texel_model_kind(const struct exr_file *file); /* NULL if the file has no kind */
/* Reads and checks the attributes and the layout. path names the file in an error. The caller has
 * set head->names. file owns head->name. Returns FALSE if the file is damaged. If an attribute is
 * missing or has another type, the error is set. For any other damage, *ret_what describes the
 * damage, and the error is not set. */
gboolean texel_model_read_head(const char *path, const struct exr_file *file,
                               struct texel_model_head *head, struct btf_layout *ret_layout,
                               const char **ret_what, GError **error);
/* Makes a text from the headers only, such as "4 × 3 texels, of 5 views × 6 lights; at the measured
 * directions: error 1.00 %, luminance off by 0.0100". Returns NULL if parts are missing.
 * g_free() */
char *texel_model_describe_file(const struct exr_file *file);

/* Returns FALSE if the BTF is empty or too large, or if a value is infinite. */
gboolean texel_model_check(const struct btf_matrix *btf, GError **error);

/* Rounds values to half floats, because a file stores half floats. */
void texel_model_to_halves(float *values, gsize n);

/* Reconstructs one texel at the measured directions: n_views × n_lights × 3. */
typedef void (*TexelModelReconstruct)(gconstpointer model, int texel, float *ret);
/* Computes errors over all values x of the BTF that are not NaN. x̂ is the value of the model, and Y
 * and Ŷ are the luminances of x and x̂. *ret_error is ‖x − x̂‖ / ‖x‖, or 0 if all values of the BTF
 * are 0. *ret_luminance_error is the mean of |Y − Ŷ|. The result does not depend on the number of
 * threads. */
void texel_model_errors(const struct btf_matrix *btf, TexelModelReconstruct reconstruct,
                        gconstpointer model, int n_threads, double *ret_error,
                        double *ret_luminance_error);
