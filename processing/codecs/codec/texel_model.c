#include "texel_model.h"
#include "base/plural.h"

#include <math.h>

#include "base/data_error.h"
#include "base/direction.h"
#include "exr/exr_half.h"

#define COLOURS 3
#define BLOCK   16              /* number of texels that a thread compares at a time */
#define MOST    (G_MAXINT / 64) /* maximum number of texels, and of values of a texel */

void texel_model_write_head(const struct texel_model_head *head, const struct btf_layout *layout,
                            struct exr_file *file) {
    struct exr_part *part = g_ptr_array_index(file->parts, 0);
    exr_set_string(part, "mesorig.kind", head->kind);
    exr_set_string(part, "mesorig.name", head->name ? head->name : "");
    for (int i = 0; i < 2; i++)
        exr_set_int(part, head->names[i], head->numbers[i]);
    exr_set_int(part, "mesorig.width", (int)layout->width);
    exr_set_int(part, "mesorig.height", (int)layout->height);
    exr_set_double(part, "mesorig.error", head->error);
    exr_set_double(part, "mesorig.exact_error", head->exact_error);
    exr_set_double(part, "mesorig.luminance_error", head->luminance_error);
    btf_layout_write_sizes(layout, part);
    btf_layout_write_directions(layout, file);
}

static gboolean is_error(double value) {
    return value >= 0 && isfinite(value);
}

const char *texel_model_kind(const struct exr_file *file) {
    const char *ret = NULL;
    if (file->parts->len > 0)
        exr_get_string(g_ptr_array_index(file->parts, 0), "mesorig.kind", &ret, NULL);
    return ret;
}

gboolean texel_model_read_head(const char *path, const struct exr_file *file,
                               struct texel_model_head *head, struct btf_layout *ret_layout,
                               const char **ret_what, GError **error) {
    const struct exr_part *part = g_ptr_array_index(file->parts, 0);
    int width, height;
    *ret_what = NULL;
    if (!exr_get_string(part, "mesorig.name", &head->name, error) ||
        !exr_get_int(part, head->names[0], &head->numbers[0], error) ||
        !exr_get_int(part, head->names[1], &head->numbers[1], error) ||
        !exr_get_int(part, "mesorig.width", &width, error) ||
        !exr_get_int(part, "mesorig.height", &height, error) ||
        !exr_get_double(part, "mesorig.error", &head->error, error) ||
        !exr_get_double(part, "mesorig.exact_error", &head->exact_error, error) ||
        !exr_get_double(part, "mesorig.luminance_error", &head->luminance_error, error)) {
        g_prefix_error(error, "%s: ", path);
        return FALSE;
    }
    *ret_what = btf_layout_read(file, part, ret_layout);
    if (*ret_what)
        return FALSE;
    if (width != part->width || height < 1 || (gint64)height * head->numbers[1] != part->height)
        *ret_what = "mesorig.width or mesorig.height differs from the size of the first part";
    else if (!is_error(head->error) || !is_error(head->exact_error) ||
             !is_error(head->luminance_error))
        *ret_what = "mesorig.error, mesorig.exact_error or mesorig.luminance_error is negative or "
                    "not finite";
    ret_layout->width = (gsize)width;
    ret_layout->height = (gsize)height;
    return *ret_what == NULL;
}

char *texel_model_describe_file(const struct exr_file *file) {
    const struct exr_part *views = exr_file_part(file, "views");
    const struct exr_part *lights = exr_file_part(file, "lights");
    const struct exr_part *first = file->parts->pdata[0];
    int width = 0, height = 0;
    double error = 0, luminance = 0;
    if (!views || !lights)
        return NULL;
    exr_get_int(first, "mesorig.width", &width, NULL);
    exr_get_int(first, "mesorig.height", &height, NULL);
    exr_get_double(first, "mesorig.error", &error, NULL);
    exr_get_double(first, "mesorig.luminance_error", &luminance, NULL);
    return g_strdup_printf("%d × %d texels, of %d %s × %d %s; at the measured directions: "
                           "error %.2f %%, luminance off by %.4f",
                           width, height, PLURAL(views->width, "view"),
                           PLURAL(lights->width, "light"), 100 * error, luminance);
}

gboolean texel_model_check(const struct btf_matrix *btf, GError **error) {
    const struct btf_layout *layout = &btf->layout;
    const gsize texels = btf_layout_texels(layout), values = btf_layout_values(layout);
    if (texels < 1 || values < 1 || texels > MOST || values > MOST) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the BTF has %zu × %zu texels, %zu views and %zu lights; a model of each texel "
                    "needs at least one of each and at most %d texels and %d values per texel",
                    layout->width, layout->height, layout->views.n, layout->lights.n, MOST, MOST);
        return FALSE;
    }
    for (gsize i = 0; i < texels * values; i++)
        if (isinf(btf->values[i])) {
            g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                        "a value of view %zu in the texel of column %zu and row %zu, all counted "
                        "from 0, is infinite; make the BTF of this view again",
                        i % values / COLOURS / layout->lights.n, i / values % layout->width,
                        i / values / layout->width);
            return FALSE;
        }
    return TRUE;
}

void texel_model_to_halves(float *values, gsize n) {
    g_autofree guint16 *halves = g_new(guint16, n);
    exr_half_from_floats(halves, values, n);
    exr_half_to_floats(values, halves, n);
}

/* Sums over a block of texels, or over all texels. x is a value of the BTF, and x̂ is the value of
 * the model. Y and Ŷ are the luminances of x and x̂. */
struct texel_model_sums {
    double residual, all;    /* residual: Σ (x − x̂)², all: Σ x², over R, G, B */
    double luminance, count; /* luminance: Σ |Y − Ŷ|, count: its number of terms */
};

struct texel_model_comparison {
    const struct btf_matrix *btf;
    TexelModelReconstruct reconstruct;
    gconstpointer model;
    struct texel_model_sums *blocks;
};

static void compare_block(int block, gpointer data) {
    const struct texel_model_comparison *to = data;
    const gsize n = btf_layout_values(&to->btf->layout);
    const gsize first = (gsize)block * BLOCK;
    const gsize end = MIN(first + BLOCK, btf_layout_texels(&to->btf->layout));
    struct texel_model_sums *sums = &to->blocks[block];
    g_autofree float *values = g_new0(float, n);
    for (gsize texel = first; texel < end; texel++) {
        const float *truth = to->btf->values + texel * n;
        to->reconstruct(to->model, (int)texel, values);
        for (gsize i = 0; i < n; i++) {
            const double residual = (double)truth[i] - values[i];
            sums->residual += isnan(truth[i]) ? 0 : residual * residual;
            sums->all += isnan(truth[i]) ? 0 : (double)truth[i] * truth[i];
        }
        for (gsize i = 0; i < n; i += COLOURS) {
            const float y = rgb_luminance(truth + i), y_hat = rgb_luminance(values + i);
            sums->luminance += isnan(y) ? 0 : fabsf(y - y_hat);
            sums->count += !isnan(y);
        }
    }
}

void texel_model_errors(const struct btf_matrix *btf, TexelModelReconstruct reconstruct,
                        gconstpointer model, int n_threads, double *ret_error,
                        double *ret_luminance_error) {
    const int n_blocks = (int)((btf_layout_texels(&btf->layout) + BLOCK - 1) / BLOCK);
    g_autofree struct texel_model_sums *blocks = g_new0(struct texel_model_sums, n_blocks);
    struct texel_model_comparison to = {btf, reconstruct, model, blocks};
    struct texel_model_sums all = {0};
    work_for_each(n_threads, n_blocks, compare_block, &to);
    for (int i = 0; i < n_blocks; i++) {
        all.residual += blocks[i].residual;
        all.all += blocks[i].all;
        all.luminance += blocks[i].luminance;
        all.count += blocks[i].count;
    }
    *ret_error = all.all > 0 ? sqrt(all.residual / all.all) : 0;
    *ret_luminance_error = all.count > 0 ? all.luminance / all.count : 0;
}
