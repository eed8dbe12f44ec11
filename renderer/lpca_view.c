#include "lpca_view.h"

#include "direction_table.h"
#include "gpu.h"
#include "lpca_texels.h"

#include <epoxy/gl.h>
#include <string.h>

struct LpcaView {
    struct lpca_texels texels;
    struct lpca_stack stack; /* a row a view and one for the views' pole; columns are lights, the
                                lights' pole and the sky, each with all components */
    guint brdfs;
    int ambient_column;
    struct direction_table views, lights;
};

static const float *values_of(const struct lpca *lpca, int cluster, int component, int view) {
    const gsize row =
        ((gsize)cluster * (lpca->n_components + 1) + component) * lpca->n_views + view;
    return lpca->brdfs + row * lpca->n_lights * 3;
}

/* Adds share × one component of one view to a row: the lights as measured, their pole, the sky. */
static void add_lights(const struct lpca *lpca, const float *values, const float *pole,
                       const float *sky, float share, int component, float *row) {
    const int n = lpca->n_lights, step = 3 * (lpca->n_components + 1);
    float *to = row + 3 * component;
    for (int l = 0; l < n; l++)
        for (int c = 0; c < 3; c++) {
            const float value = share * values[3 * l + c];
            to[(gsize)step * l + c] += value;
            to[(gsize)step * n + c] += pole[l] * value;
            to[(gsize)step * (n + 1) + c] += sky[l] * value;
        }
}

static void fill_cluster(const struct lpca *lpca, const struct lpca_stack *stack, int cluster,
                         const float *view_pole, const float *pole, const float *sky, float *ret) {
    const gsize row = 3 * (gsize)stack->n_columns;
    memset(ret, 0, sizeof(float) * row * stack->n_rows);
    for (int i = 0; i <= lpca->n_components; i++)
        for (int v = 0; v < lpca->n_views; v++) {
            const float *values = values_of(lpca, cluster, i, v);
            add_lights(lpca, values, pole, sky, 1.0f, i, ret + row * v);
            if (view_pole[v] > 0)
                add_lights(lpca, values, pole, sky, view_pole[v], i, ret + row * lpca->n_views);
        }
}

static gboolean upload_brdfs(LpcaView *view, const struct lpca *lpca,
                             const struct lpca_directions *directions, GError **error) {
    const struct lpca_stack *stack = &view->stack;
    g_autofree float *view_pole = g_new0(float, lpca->n_views);
    g_autofree float *pole = g_new0(float, lpca->n_lights);
    g_autofree float *block = g_new(float, 3 * (gsize)stack->n_columns * stack->n_rows);
    direction_table_pole_shares(directions->views, view_pole, lpca->n_views);
    direction_table_pole_shares(directions->lights, pole, lpca->n_lights);
    view->brdfs = lpca_stack_texture(stack, error);
    if (!view->brdfs)
        return FALSE;
    for (int k = 0; k < lpca->n_clusters; k++) {
        fill_cluster(lpca, stack, k, view_pole, pole, directions->sky, block);
        lpca_stack_put(stack, k, block);
    }
    return gpu_check("the eigen-BRDFs' texture", error);
}

static gboolean make(LpcaView *view, const struct lpca_pyramid *pyramid, GError **error) {
    const struct lpca *lpca = pyramid->lpca;
    struct lpca_directions directions;
    if (!lpca_stack_init(&view->stack, lpca->n_clusters,
                         (lpca->n_lights + 2) * (lpca->n_components + 1), lpca->n_views + 1,
                         "compress with fewer components or clusters", error) ||
        !lpca_directions_init(&directions, lpca, error))
        return FALSE;
    view->ambient_column = lpca->n_lights + 1;
    view->views = direction_table_new(directions.views, FALSE);
    view->lights = direction_table_new(directions.lights, TRUE);
    const gboolean ok = lpca_texels_init(&view->texels, pyramid, NULL, error) &&
                        upload_brdfs(view, lpca, &directions, error);
    lpca_directions_clear(&directions);
    return ok;
}

LpcaView *lpca_view_new(struct lpca *const *levels, int n, GError **error) {
    g_autoptr(LpcaView) view = g_new0(LpcaView, 1);
    struct lpca_pyramid pyramid;
    const gboolean ok =
        lpca_pyramid_init(&pyramid, levels, n, error) && make(view, &pyramid, error);
    lpca_pyramid_clear(&pyramid);
    return ok ? g_steal_pointer(&view) : NULL;
}

void lpca_view_free(LpcaView *view) {
    if (view == NULL)
        return;
    glDeleteTextures(1, &view->brdfs);
    lpca_texels_clear(&view->texels);
    direction_table_clear(&view->views);
    direction_table_clear(&view->lights);
    g_free(view);
}

static void set_int(guint program, const char *name, int value) {
    glUniform1i(glGetUniformLocation(program, name), value);
}

static void bind_all(gpointer material, guint program, const struct method_style *style) {
    const LpcaView *view = material;
    lpca_texels_bind(&view->texels, program, style->nearest);
    direction_table_bind(&view->views, program, "view", 3);
    direction_table_bind(&view->lights, program, "light", 5);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D_ARRAY, view->brdfs);
    set_int(program, "brdfs", 0);
    set_int(program, "n_rows", view->stack.n_rows);
    set_int(program, "clusters_a_layer", view->stack.clusters_a_layer);
    set_int(program, "ambient_column", view->ambient_column);
}

static gpointer open_levels(struct lpca *const *levels, int n, GError **error) {
    return lpca_view_new(levels, n, error);
}

static gpointer open_file(const char *path, GError **error) {
    return lpca_open_levels(path, open_levels, error);
}

static void free_view(gpointer material) {
    lpca_view_free(material);
}

static const char *const shader_names[] = {"directions.glsl", "lpca_texel.glsl", "lpca.glsl", NULL};

const struct method method_lpca = {
    .name = "lpca",
    .title = "local PCA",
    .product = "lpca.exr",
    .made_by = "mesorig compress",
    .shaders = shader_names,
    .open = open_file,
    .free = free_view,
    .bind = bind_all,
};
