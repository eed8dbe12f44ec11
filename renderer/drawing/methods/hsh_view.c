#include "hsh_view.h"

#include "slices.h"

#include <math.h>

#define COLOURS 3
#define PAGE    SLICES_PAGE

struct HshView {
    struct slices slices;
    int n_terms;
};

/* Computes the reflectance of each texel under an even sky, √(2/π) c_0 (hsh_view.h), or 0 if it is
 * negative. */
static void sky(gconstpointer model, gsize view, float *ret_layer) {
    const struct hsh *hsh = model;
    const gsize texels = btf_layout_texels(&hsh->layout), n_values = (gsize)hsh->n_terms * COLOURS;
    for (gsize k = 0; k < PAGE * texels; k++) {
        const float *values = hsh->values + (view * texels + k / PAGE) * n_values;
        const float sum = k % PAGE < COLOURS ? (float)sqrt(2 / G_PI) * values[k % PAGE] : 0;
        ret_layer[k] = fmaxf(sum, 0);
    }
}

/* Sets the layers of a view. For every four terms there is one layer per colour. If one term is
 * left, an additional layer has the R, G, B of this term. The index of a value of a texel is term ×
 * COLOURS + colour. */
static void set_pages(struct slices *slices, int n_terms) {
    const int whole = n_terms / PAGE;
    slices->n_pages = COLOURS * whole + n_terms % PAGE;
    for (int page = 0; page < slices->n_pages; page++)
        for (int k = 0; k < PAGE; k++) {
            const int left = (whole * PAGE + page - COLOURS * whole) * COLOURS + k;
            slices->value_at[page][k] = page < COLOURS * whole
                                            ? (page / COLOURS * PAGE + k) * COLOURS + page % COLOURS
                                        : k < COLOURS ? left
                                                      : -1;
        }
}

HshView *hsh_view_new(const struct hsh *hsh, GError **error) {
    const struct slices_level level = {&hsh->layout, hsh->values, (gsize)hsh->n_terms * COLOURS,
                                       hsh};
    g_autoptr(HshView) view = g_new0(HshView, 1);
    view->n_terms = hsh->n_terms;
    view->slices.what = "hemispherical harmonics";
    view->slices.n_levels = (int)g_bit_storage(MAX(hsh->layout.width, hsh->layout.height));
    view->slices.n_slices = (int)hsh->layout.views.n;
    set_pages(&view->slices, hsh->n_terms);
    return slices_check_size(&view->slices, &hsh->layout,
                             "compress with fewer --terms, or with another method", error) &&
                   slices_check_values(&view->slices, &level, error) &&
                   slices_upload(&view->slices, &level, 1, sky, error)
               ? g_steal_pointer(&view)
               : NULL;
}

void hsh_view_free(HshView *view) {
    if (view == NULL)
        return;
    slices_clear(&view->slices);
    g_free(view);
}

static gpointer hsh_view_open(const char *path, GError **error) {
    struct hsh *hsh = hsh_read(path, error);
    HshView *view = hsh ? hsh_view_new(hsh, error) : NULL;
    hsh_free(hsh);
    return view;
}

static gboolean hsh_view_texels(gconstpointer material, int ret[2]) {
    return slices_texels(&((const struct HshView *)material)->slices, ret);
}

static gint64 bytes(gconstpointer material) {
    const HshView *view = material;
    return slices_bytes(&view->slices);
}

static char *constants(gconstpointer material, const struct method_style *style) {
    const HshView *view = material;
    return g_strdup_printf("#define N_LEVELS %d\n#define NEAREST %d\n#define SLICED 1\n"
                           "#define N_LOBES 0\n#define N_TERMS %d\n",
                           view->slices.n_levels, style->nearest != 0, view->n_terms);
}

static void hsh_view_bind(gpointer material, guint program, const struct method_style *style) {
    const HshView *view = material;
    slices_bind(&view->slices, program);
}

static const char *const hsh_view_shaders[] = {"levels.glsl", "lobes.glsl", "hsh.glsl", NULL};

const struct method method_hsh = {
    .name = "hsh",
    .title = "Hemispherical harmonics",
    .product = "hsh.exr",
    .made_by = "mesorig compress --method hsh",
    .shaders = hsh_view_shaders,
    .open = hsh_view_open,
    .free = (GDestroyNotify)hsh_view_free,
    .constants = constants,
    .bytes = bytes,
    .texels = hsh_view_texels,
    .bind = hsh_view_bind,
};
