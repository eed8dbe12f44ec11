#include "lobes_view.h"

#include "base/direction.h"
#include "btf/direction_grid.h"
#include "drawing/gl/gpu.h"
#include "slices.h"

#include <math.h>
#include <string.h>

#define COLOURS  3
#define PAGE     SLICES_PAGE
#define SKY      4 /* an even sky is replaced by SKY × SKY lights */
#define HALF_MAX 65504.0f

struct LobesView {
    struct slices slices;
    int n_lobes;
};

/* Sets which values of a texel (lobes.h) each page contains. The first page has the colour, and for
 * lafortune also the diffuse part. Each further page has the next four values. For ward and
 * ashikhmin, the first two pages have the two colours, with U and V as their fourth values. */
static void lobes_view_set_pages(struct slices *slices, const struct lobes *lobes) {
    static const int facets[4][PAGE] = {
        {0, 1, 2, 12}, {3, 4, 5, 13}, {6, 7, 8, -1}, {9, 10, 11, -1}};
    const gboolean lafortune = lobes->model == LOBES_LAFORTUNE;
    if (lobes->model == LOBES_WARD || lobes->model == LOBES_ASHIKHMIN) {
        slices->n_pages = G_N_ELEMENTS(facets);
        memcpy(slices->value_at, facets, sizeof facets);
        return;
    }
    slices->n_pages = 1 + (lobes->model == LOBES_PTM ? 2 : lobes->n_lobes);
    for (int page = 0; page < slices->n_pages; page++)
        for (int k = 0; k < PAGE; k++) {
            const int value = page == 0 ? k : COLOURS + lafortune + PAGE * (page - 1) + k;
            const int end = page == 0 ? COLOURS + lafortune : lobes->n_values;
            slices->value_at[page][k] = value < end ? value : -1;
        }
}

/* Returns whether lobes can be mip level `number` of the material whose level 0 is first. */
static gboolean lobes_view_belongs(const struct lobes *first, const struct lobes *lobes,
                                   int number) {
    return lobes->model == first->model && lobes->n_lobes == first->n_lobes &&
           lobes->layout.width == MAX(1, first->layout.width >> number) &&
           lobes->layout.height == MAX(1, first->layout.height >> number) &&
           direction_list_equal(&lobes->layout.views, &first->layout.views);
}

/* Computes the reflectance of a texel under an even sky, (1/π) ∫ BTF dω, as the sum over SKY²
 * lights of solid angle 2π / SKY² each. */
static void lobes_view_sky(gconstpointer model, gsize view, float *ret_layer) {
    const struct lobes *lobes = model;
    const gsize texels = btf_layout_texels(&lobes->layout);
    float direction[3];
    direction_from_deg(lobes->layout.views.theta_deg[view], lobes->layout.views.phi_deg[view],
                       direction);
    memset(ret_layer, 0, sizeof(float) * PAGE * texels);
    for (gsize texel = 0; texel < texels; texel++, ret_layer += PAGE)
        for (int k = 0; k < SKY * SKY; k++) {
            const int row = k / SKY;
            float light[3], rgb[3];
            direction_grid_direction((k % SKY + 0.5) / SKY, (row + 0.5) / SKY, light);
            lobes_evaluate(lobes, lobes->n_slices > 1 ? (int)view : 0, (int)texel, direction, light,
                           rgb);
            for (int c = 0; c < COLOURS; c++)
                ret_layer[c] += CLAMP(rgb[c], 0, HALF_MAX / 2) * 2 / (SKY * SKY);
        }
}

LobesView *lobes_view_new(struct lobes *const *levels, int n, GError **error) {
    struct slices_level of[LOBES_MAX_LEVELS];
    g_autoptr(LobesView) view = g_new0(LobesView, 1);
    view->n_lobes = levels[0]->n_lobes;
    view->slices.what = lobes_model_name(levels[0]->model);
    view->slices.n_levels = n;
    view->slices.n_slices = levels[0]->n_slices;
    lobes_view_set_pages(&view->slices, levels[0]);
    if (!slices_check_size(&view->slices, &levels[0]->layout,
                           "compress with fewer lobes, or another model", error))
        return NULL;
    for (int k = 0; k < n; k++) {
        of[k] = (struct slices_level){&levels[k]->layout, levels[k]->values,
                                      (gsize)levels[k]->n_values, levels[k]};
        if (k > 0 && !lobes_view_belongs(levels[0], levels[k], k)) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "mip level %d (%s, %d lobes, %zu × %zu texels, %zu views) does not belong "
                        "to level 0 (%s, %d lobes, %zu × %zu texels, %zu views): the file is "
                        "damaged; compress the material again",
                        k, lobes_model_name(levels[k]->model), levels[k]->n_lobes,
                        levels[k]->layout.width, levels[k]->layout.height,
                        levels[k]->layout.views.n, lobes_model_name(levels[0]->model),
                        levels[0]->n_lobes, levels[0]->layout.width, levels[0]->layout.height,
                        levels[0]->layout.views.n);
            return NULL;
        }
        if (!slices_check_values(&view->slices, &of[k], error)) {
            if (k > 0)
                g_prefix_error(error, "mip level %d: ", k);
            return NULL;
        }
    }
    return slices_upload(&view->slices, of, n, lobes_view_sky, error) ? g_steal_pointer(&view)
                                                                      : NULL;
}

void lobes_view_free(LobesView *view) {
    if (view == NULL)
        return;
    slices_clear(&view->slices);
    g_free(view);
}

static gboolean lobes_view_texels(gconstpointer material, int ret[2]) {
    return slices_texels(&((const struct LobesView *)material)->slices, ret);
}

static gint64 lobes_view_bytes(gconstpointer material) {
    const LobesView *view = material;
    return slices_bytes(&view->slices);
}

static void lobes_view_bind(gpointer material, guint program, const struct method_style *style) {
    const LobesView *view = material;
    slices_bind(&view->slices, program);
}

static char *lobes_view_constants(gconstpointer material, const struct method_style *style) {
    const LobesView *view = material;
    return g_strdup_printf("#define N_LEVELS %d\n#define NEAREST %d\n#define SLICED %d\n"
                           "#define N_LOBES %d\n#define ROTATION %d\n",
                           view->slices.n_levels, style->nearest != 0, view->slices.n_slices > 1,
                           view->n_lobes, (int)style->rotation);
}

static gpointer lobes_view_open(enum lobes_model model, const char *path, GError **error) {
    struct lobes *levels[LOBES_MAX_LEVELS];
    const int n = lobes_read_levels(path, levels, error);
    LobesView *view = NULL;
    if (n > 0 && levels[0]->model != model)
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "%s holds %s, not %s; draw it with --method %s", path,
                    lobes_model_name(levels[0]->model), lobes_model_name(model),
                    lobes_model_name(levels[0]->model));
    else if (n > 0)
        view = lobes_view_new(levels, n, error);
    for (int k = 0; k < n; k++)
        lobes_free(levels[k]);
    return view;
}

#define SHARED "levels.glsl", "lobes.glsl"
static const char *const fields[] = {SHARED, "fields.glsl", NULL};
static const char *const ptm[] = {SHARED, "ptm.glsl", NULL};
static const char *const lafortune[] = {SHARED, "lafortune.glsl", NULL};
static const char *const ward[] = {SHARED, "ward.glsl", "microfacet.glsl", "facets.glsl", NULL};
static const char *const ashikhmin[] = {SHARED, "ashikhmin.glsl", "microfacet.glsl", "facets.glsl",
                                        NULL};

#define OPEN(name, model)                                                                          \
    static gpointer open_##name(const char *path, GError **error) {                                \
        return lobes_view_open(model, path, error);                                                \
    }
OPEN(fields, LOBES_FIELDS)
OPEN(ptm, LOBES_PTM)
OPEN(lafortune, LOBES_LAFORTUNE)
OPEN(ward, LOBES_WARD)
OPEN(ashikhmin, LOBES_ASHIKHMIN)

#define MODEL(model, text)                                                                         \
    {                                                                                              \
        .name = #model, .title = (text), .product = #model ".exr",                                 \
        .made_by = "mesorig compress --method " #model, .shaders = (model), .open = open_##model,  \
        .free = (GDestroyNotify)lobes_view_free, .constants = lobes_view_constants,                \
        .bytes = lobes_view_bytes, .texels = lobes_view_texels, .bind = lobes_view_bind,           \
    }

const struct method methods_lobes[LOBES_MODELS] = {
    MODEL(fields, "reflectance fields"),
    MODEL(ptm, "polynomials of each view"),
    MODEL(lafortune, "Lafortune lobes"),
    MODEL(ward, "Ward's model with normals"),
    MODEL(ashikhmin, "Ashikhmin and Shirley's model with normals"),
};
