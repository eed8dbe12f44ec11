#include "lpca_view.h"

#include "drawing/gl/direction_cube.h"
#include "drawing/gl/gpu.h"
#include "lpca_texels.h"

#include <epoxy/gl.h>
#include <string.h>

#define HALF_MAX 65504.0f

struct LpcaView {
    struct lpca_texels texels;
    /* A block has one row per view. Its columns are the lights and the sky, each with all
     * components. */
    struct lpca_stack stack;
    guint brdfs;        /* texture with the layout of stack */
    guint skies;        /* reflectance under an even sky; 0 unless values are logarithms */
    int ambient_column; /* first column of the sky in a block */
    struct direction_textures views, lights;
};

/* Fills one row per view: all components of each measured light, then all components of the sky. */
static void fill_cluster(const struct lpca *lpca, const struct lpca_stack *stack, int cluster,
                         const float *sky, float *ret) {
    const gsize n_lights = lpca->layout.lights.n, row = 3 * (gsize)stack->n_columns;
    const gsize step = 3 * (gsize)(lpca->n_components + 1);
    const float *values = lpca->brdfs + btf_layout_values(&lpca->layout) *
                                            (gsize)(lpca->n_components + 1) * (gsize)cluster;
    memset(ret, 0, sizeof(float) * row * stack->n_rows);
    for (int i = 0; i <= lpca->n_components; i++)
        for (gsize v = 0; v < lpca->layout.views.n; v++) {
            float *to = ret + row * v + 3 * i;
            for (gsize l = 0; l < n_lights; l++, values += 3)
                for (int c = 0; c < 3; c++) {
                    to[step * l + c] = values[c];
                    to[step * n_lights + c] += sky[l] * values[c];
                }
        }
}

static gboolean upload_brdfs(LpcaView *view, const struct lpca *lpca, const float *sky,
                             GError **error) {
    const struct lpca_stack *stack = &view->stack;
    g_autofree float *block = g_new(float, 3 * (gsize)stack->n_columns * stack->n_rows);
    view->brdfs = lpca_stack_texture(stack, error);
    if (!view->brdfs)
        return FALSE;
    for (int k = 0; k < lpca->n_clusters; k++) {
        fill_cluster(lpca, stack, k, sky, block);
        lpca_stack_put(stack, k, block);
    }
    return gpu_check("the eigen-BRDFs' texture", error);
}

/* Uploads one level of each texel's reflectance under an even sky, one layer per view. */
static void put_skies(const struct lpca *lpca, int level, const float *sky) {
    const gsize texels = btf_layout_texels(&lpca->layout);
    const gsize pairs = lpca->layout.views.n * lpca->layout.lights.n;
    g_autofree float *rgb = g_new(float, 3 * pairs);
    g_autofree float *layers = g_new0(float, 3 * texels * lpca->layout.views.n);
    for (gsize x = 0; x < texels; x++) {
        lpca_reconstruct(lpca, (int)x, rgb);
        for (gsize k = 0; k < 3 * pairs; k++) {
            const gsize v = k / 3 / lpca->layout.lights.n, l = k / 3 % lpca->layout.lights.n;
            layers[3 * (v * texels + x) + k % 3] += sky[l] * rgb[k];
        }
    }
    for (gsize k = 0; k < 3 * texels * lpca->layout.views.n; k++)
        layers[k] = CLAMP(layers[k], 0, HALF_MAX);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, level, 0, 0, 0, lpca->layout.width, lpca->layout.height,
                    lpca->layout.views.n, GL_RGB, GL_FLOAT, layers);
}

static gboolean upload_skies(LpcaView *view, const struct lpca_pyramid *pyramid, const float *sky,
                             GError **error) {
    const struct lpca *first = pyramid->levels[0];
    GLint layers = 0;
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    if (first->layout.views.n > (gsize)layers) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "the even sky of a material in logarithms needs a texture layer for each of "
                    "%zu views, but %s supports %d; compress without --colours=log",
                    first->layout.views.n, gpu_renderer(), layers);
        return FALSE;
    }
    view->skies = gpu_texture_levels(GL_RGBA16F, first->layout.width, first->layout.height,
                                     first->layout.views.n, pyramid->n_levels);
    for (int k = 0; k < pyramid->n_levels; k++)
        put_skies(pyramid->levels[k], k, sky);
    return gpu_check("the texture of the even sky", error);
}

static gboolean make(LpcaView *view, const struct lpca_pyramid *pyramid, GError **error) {
    const struct lpca *lpca = pyramid->lpca;
    struct lpca_directions directions;
    if (!lpca_stack_init(
            &view->stack, lpca->n_clusters, (lpca->layout.lights.n + 1) * (lpca->n_components + 1),
            lpca->layout.views.n, "compress with fewer components or clusters", error) ||
        !lpca_directions_init(&directions, lpca, TRUE, error))
        return FALSE;
    view->ambient_column = lpca->layout.lights.n * (lpca->n_components + 1);
    view->views = direction_cube_new(directions.views, FALSE);
    view->lights = direction_cube_new(directions.lights, TRUE);
    const gboolean ok = lpca_texels_init(&view->texels, pyramid, NULL, error) &&
                        upload_brdfs(view, lpca, directions.sky, error) &&
                        (!view->texels.log || upload_skies(view, pyramid, directions.sky, error));
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
    const GLuint textures[] = {view->brdfs, view->skies};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    lpca_texels_clear(&view->texels);
    direction_textures_clear(&view->views);
    direction_textures_clear(&view->lights);
    g_free(view);
}

static void set_int(guint program, const char *name, int value) {
    glUniform1i(glGetUniformLocation(program, name), value);
}

static void bind_all(gpointer material, guint program, const struct method_style *style) {
    const LpcaView *view = material;
    lpca_texels_bind(&view->texels, program);
    direction_textures_bind(&view->views, program, "view", 3);
    direction_textures_bind(&view->lights, program, "light", 5);
    gpu_bind_texture(program, "brdfs", 0, GL_TEXTURE_2D_ARRAY, view->brdfs);
    if (view->texels.log)
        gpu_bind_texture(program, "skies", 7, GL_TEXTURE_2D_ARRAY, view->skies);
    set_int(program, "n_rows", view->stack.n_rows);
    set_int(program, "clusters_a_layer", view->stack.clusters_a_layer);
    set_int(program, "ambient_column", view->ambient_column);
}

static char *constants(gconstpointer material, const struct method_style *style) {
    const LpcaView *view = material;
    g_autofree char *shared = lpca_texels_constants(&view->texels, style);
    return g_strdup_printf("%s#define LOG_OFFSET %f\n", shared, (double)LPCA_LOG_OFFSET);
}

static gboolean lpca_view_texels(gconstpointer material, int ret[2]) {
    return lpca_texels_size(&((const struct LpcaView *)material)->texels, ret);
}

static gint64 bytes(gconstpointer material) {
    const LpcaView *view = material;
    return lpca_texels_bytes(&view->texels) + direction_textures_bytes(&view->views) +
           direction_textures_bytes(&view->lights) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->skies) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->brdfs);
}

static gpointer open_levels(struct lpca *const *levels, int n, GError **error) {
    return lpca_view_new(levels, n, error);
}

static gpointer open_file(const char *path, GError **error) {
    return lpca_open_levels(path, open_levels, error);
}

static const char *const shader_names[] = {"levels.glsl", "lpca_texel.glsl", "lpca.glsl", NULL};

const struct method method_lpca = {
    .name = "lpca",
    .title = "local PCA",
    .product = "lpca.exr",
    .made_by = "mesorig compress",
    .shaders = shader_names,
    .open = open_file,
    .free = (GDestroyNotify)lpca_view_free,
    .constants = constants,
    .bytes = bytes,
    .texels = lpca_view_texels,
    .bind = bind_all,
};
