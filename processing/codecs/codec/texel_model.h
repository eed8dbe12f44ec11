/*
 * Shared by the models that are fitted to each texel on its own (hsh/hsh.h, lobes/lobes.h): checks
 * of the BTF, errors, and the head of their files.
 */
#pragma once

#include "btf/btf_matrix.h"
#include "exr/exr.h"

/* Attributes of a file's first part: mesorig.kind, mesorig.name (string); two numbers of the model
 * (a model without numbers of its own writes 1; the second is the number of pictures that a part
 * has below each other, 1 for one), mesorig.width, mesorig.height (int); mesorig.error,
 * mesorig.exact_error, mesorig.luminance_error, texel_mm, reference_mm (double). */
struct texel_model_head {
    const char *kind, *name;
    const char *names[2]; /* of the numbers: "mesorig.terms", … */
    int numbers[2];       /* the second: pictures of the texels that a part has below each other */
    double error, luminance_error, exact_error;
};

/* The head, and the parts "views" and "lights" (btf_layout.h). */
void texel_model_write_head(const struct texel_model_head *head, const struct btf_layout *layout,
                            struct exr_file *file);
const char *texel_model_kind(const struct exr_file *file); /* NULL: the file has none */
/* Reads and checks the attributes and the layout. The caller has set head->names; file owns
 * head->name. FALSE with an error, or with *ret_what: what is wrong with the file.
 */
gboolean texel_model_read_head(const struct exr_file *file, struct texel_model_head *head,
                               struct btf_layout *ret_layout, const char **ret_what,
                               GError **error);
/* "4 × 3 texels, of 5 views × 6 lights; error 1.00 %, luminance off by 0.0100", from headers alone;
 * NULL: parts are missing. g_free() */
char *texel_model_describe_file(const struct exr_file *file);

/* FALSE if the BTF is empty or too large, or a value is infinite. */
gboolean texel_model_check(const struct btf_matrix *btf, GError **error);

/* Rounds values to halves, as a file gives them back. */
void texel_model_to_halves(float *values, gsize n);

/* One texel at the measured directions: n_views × n_lights × 3. */
typedef void (*TexelModelReconstruct)(gconstpointer model, int texel, float *ret);
/* Over all values x of the BTF that are not NaN, x̂ being the model's: ‖x − x̂‖ / ‖x‖, and the mean
 * of |Y − Ŷ|. Does not depend on the number of threads. */
void texel_model_errors(const struct btf_matrix *btf, TexelModelReconstruct reconstruct,
                        gconstpointer model, int n_threads, double *ret_error,
                        double *ret_luminance_error);
