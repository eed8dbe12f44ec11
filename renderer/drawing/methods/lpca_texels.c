#include "lpca_texels.h"

#include "codecs/lpca/lpca_pack.h"
#include "drawing/gl/gpu.h"

#include <epoxy/gl.h>
#include <math.h>
#include <string.h>

#define HALF_MAX 65504.0f

static gboolean all_finite(const float *values, gsize n, const char *what, GError **error) {
    for (gsize k = 0; k < n; k++)
        if (!isfinite(values[k])) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "%s number %zu (counted from 0) is not finite: the file is damaged; "
                        "compress the material again",
                        what, k);
            return FALSE;
        }
    return TRUE;
}

static gboolean check(const struct lpca *lpca, GError **error) {
    const struct btf_layout *layout = &lpca->layout;
    const gsize texels = btf_layout_texels(layout), brdf = btf_layout_values(layout);
    const char *missing = brdf < 1               ? "directions"
                          : texels < 1           ? "texels"
                          : lpca->n_clusters < 1 ? "clusters"
                                                 : NULL;
    if (missing != NULL) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "the local PCA has no %s: the file is damaged; compress the material again",
                    missing);
        return FALSE;
    }
    for (gsize k = 0; k < texels; k++)
        if (lpca->clusters[k] < 0 || lpca->clusters[k] >= lpca->n_clusters) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "texel (%zu, %zu) is in cluster %d, but the clusters are numbered from 0 "
                        "to %d: the file is damaged; compress the material again",
                        k % layout->width, k / layout->width, lpca->clusters[k],
                        lpca->n_clusters - 1);
            return FALSE;
        }
    return method_check_size(layout, error) &&
           all_finite(lpca->weights, texels * lpca->n_components, "weight", error) &&
           all_finite(lpca->brdfs, brdf * (lpca->n_components + 1) * lpca->n_clusters,
                      "eigen-BRDF value", error);
}

static gboolean check_levels(struct lpca *const *levels, int n, GError **error) {
    for (int k = 0; k < n; k++) {
        if (!check(levels[k], error)) {
            if (k > 0)
                g_prefix_error(error, "mip level %d: ", k);
            return FALSE;
        }
        const struct btf_layout *first = &levels[0]->layout, *layout = &levels[k]->layout;
        if (k > 0 &&
            (layout->width != MAX(1, first->width >> k) ||
             layout->height != MAX(1, first->height >> k) ||
             levels[k]->colours != levels[0]->colours || levels[k]->n_grid != levels[0]->n_grid ||
             !direction_list_equal(&layout->views, &first->views) ||
             !direction_list_equal(&layout->lights, &first->lights))) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "mip level %d of %zu × %zu texels, %zu views and %zu lights does not fit "
                        "level 0 of %zu × %zu texels: it needs %zu × %zu texels and the "
                        "directions, colours and grid of level 0; compress the material again",
                        k, layout->width, layout->height, layout->views.n, layout->lights.n,
                        first->width, first->height, MAX(1, first->width >> k),
                        MAX(1, first->height >> k));
            return FALSE;
        }
    }
    return TRUE;
}

/* Concatenates the eigen-BRDFs of all levels. Components that a level lacks are 0 and have weight
 * 0. */
static void join_brdfs(struct lpca *joined, const struct lpca_pyramid *pyramid) {
    const gsize size = 3 * joined->layout.views.n * joined->layout.lights.n;
    const gsize tables = joined->n_components + 1;
    joined->brdfs = g_new0(float, size *tables * joined->n_clusters);
    joined->scales = g_new(float, tables * joined->n_clusters);
    for (gsize k = 0; k < tables * joined->n_clusters; k++)
        joined->scales[k] = 1;
    for (int n = 0; n < pyramid->n_levels; n++) {
        const struct lpca *level = pyramid->levels[n];
        const gsize own = level->n_components + 1;
        for (int k = 0; k < level->n_clusters; k++) {
            const gsize to = tables * (pyramid->first[n] + k);
            memcpy(joined->brdfs + size * to, level->brdfs + size * own * k,
                   sizeof(float) * size * own);
            memcpy(joined->scales + to, level->scales + own * k, sizeof(float) * own);
        }
    }
}

gboolean lpca_pyramid_init(struct lpca_pyramid *pyramid, struct lpca *const *levels, int n,
                           GError **error) {
    *pyramid = (struct lpca_pyramid){.lpca = levels[0], .n_levels = n};
    if (!check_levels(levels, n, error))
        return FALSE;
    int n_clusters = 0, n_components = 0;
    for (int k = 0; k < n; k++) {
        pyramid->levels[k] = levels[k];
        pyramid->first[k] = n_clusters;
        n_clusters += levels[k]->n_clusters;
        n_components = MAX(n_components, levels[k]->n_components);
    }
    if (n_clusters > G_MAXUINT16) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "all mip levels together have %d clusters, but at most %d can be drawn; "
                    "compress with fewer clusters",
                    n_clusters, G_MAXUINT16);
        return FALSE;
    }
    if (n == 1)
        return TRUE;
    pyramid->lpca = g_memdup2(levels[0], sizeof(struct lpca)); /* all other members are borrowed */
    pyramid->owned = TRUE;
    pyramid->lpca->n_clusters = n_clusters;
    pyramid->lpca->n_components = n_components;
    join_brdfs(pyramid->lpca, pyramid);
    return TRUE;
}

void lpca_pyramid_clear(struct lpca_pyramid *pyramid) {
    if (pyramid->owned) {
        g_free(pyramid->lpca->brdfs);
        g_free(pyramid->lpca->scales);
        g_free(pyramid->lpca);
    }
    *pyramid = (struct lpca_pyramid){0};
}

gboolean lpca_pyramid_is_linear(const struct lpca_pyramid *pyramid, GError **error) {
    if (pyramid->lpca->colours == LPCA_RGB)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                "the material is stored as logarithms, which this method cannot interpolate; draw "
                "it with --method lpca, or "
                "compress it without --colours=log");
    return FALSE;
}

/* A packed material of one cluster has too many components to be drawn. Replaces it by a material
 * that is clustered again, with the default numbers of “mesorig compress”, and frees the old one.
 * Does not change any other material. *lpca becomes NULL on error. */
static gboolean make_drawable(struct lpca **lpca, GError **error) {
    const struct lpca_options options = {.n_clusters = 32, .n_components = 8};
    if ((*lpca)->quantise != LPCA_PACKED || (*lpca)->n_clusters > 1)
        return TRUE;
    struct lpca *grouped = lpca_regroup(*lpca, &options, error);
    lpca_free(*lpca);
    *lpca = grouped;
    return grouped != NULL;
}

gpointer lpca_open_levels(const char *path, LpcaMake make, GError **error) {
    struct lpca *levels[LPCA_MAX_LEVELS];
    const int n = lpca_read_levels(path, levels, error);
    gboolean ok = n > 0;
    for (int k = 0; ok && k < n; k++)
        ok = make_drawable(&levels[k], error);
    gpointer view = ok ? make(levels, n, error) : NULL;
    for (int k = 0; k < n; k++)
        lpca_free(levels[k]);
    return view;
}

/* Uploads four clusters for each texel: those of the texel itself, of the texel in the next column,
 * of the texel in the next row, and of the texel in the next column and row. One fetch then reads
 * all four. */
static void upload_clusters(const struct lpca_pyramid *pyramid, int level) {
    const struct lpca *lpca = pyramid->levels[level];
    const int w = lpca->layout.width, h = lpca->layout.height;
    g_autofree guint16 *clusters = g_new(guint16, 4 * (gsize)w * h);
    for (gsize k = 0; k < 4 * (gsize)w * h; k++) {
        const int i = (int)(k / 4 % w + k % 2) % w, j = (int)(k / 4 / w + k / 2 % 2) % h;
        clusters[k] = (guint16)(pyramid->first[level] + lpca->clusters[j * w + i]);
    }
    glTexImage2D(GL_TEXTURE_2D, level, GL_RGBA16UI, w, h, 0, GL_RGBA_INTEGER, GL_UNSIGNED_SHORT,
                 clusters);
}

static void upload_weights(const struct lpca_pyramid *pyramid, const float *scales, int level,
                           int pages) {
    const struct lpca *lpca = pyramid->levels[level];
    const gsize n = btf_layout_texels(&lpca->layout);
    const int tables = pyramid->lpca->n_components + 1;
    g_autofree float *page = g_new(float, 4 * n);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, level, GL_RGBA32F, lpca->layout.width, lpca->layout.height,
                 pages, 0, GL_RGBA, GL_FLOAT, NULL);
    for (int p = 0; p < pages; p++) {
        for (gsize k = 0; k < 4 * n; k++) {
            const int i = 4 * p + (int)(k % 4);
            const int cluster = pyramid->first[level] + lpca->clusters[k / 4];
            page[k] = i < lpca->n_components ? lpca->weights[k / 4 * lpca->n_components + i] : 0;
            page[k] *= scales && i + 1 < tables ? scales[(gsize)cluster * tables + i + 1] : 1;
        }
        glTexSubImage3D(GL_TEXTURE_2D_ARRAY, level, 0, 0, p, lpca->layout.width,
                        lpca->layout.height, 1, GL_RGBA, GL_FLOAT, page);
    }
}

/* Returns a new texture with n_levels mip levels. Its texels are fetched and never filtered. */
static guint mipmapped(GLenum target, int n_levels) {
    GLuint texture;
    glGenTextures(1, &texture);
    glBindTexture(target, texture);
    glTexParameteri(target, GL_TEXTURE_MAX_LEVEL, n_levels - 1);
    glTexParameteri(target, GL_TEXTURE_MIN_FILTER, GL_NEAREST_MIPMAP_NEAREST);
    glTexParameteri(target, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return texture;
}

gboolean lpca_texels_init(struct lpca_texels *texels, const struct lpca_pyramid *pyramid,
                          const float *scales, GError **error) {
    texels->width = (int)pyramid->levels[0]->layout.width;
    texels->height = (int)pyramid->levels[0]->layout.height;
    texels->n_components = pyramid->lpca->n_components;
    texels->n_levels = pyramid->n_levels;
    texels->log = pyramid->lpca->colours == LPCA_LOG;
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    texels->clusters = mipmapped(GL_TEXTURE_2D, texels->n_levels);
    for (int level = 0; level < texels->n_levels; level++)
        upload_clusters(pyramid, level);
    texels->weights = mipmapped(GL_TEXTURE_2D_ARRAY, texels->n_levels);
    for (int level = 0; level < texels->n_levels; level++)
        upload_weights(pyramid, scales, level, MAX(1, (texels->n_components + 3) / 4));
    return gpu_check("the weights' texture", error);
}

void lpca_texels_clear(struct lpca_texels *texels) {
    const GLuint textures[] = {texels->weights, texels->clusters};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    *texels = (struct lpca_texels){0};
}

char *lpca_texels_constants(const struct lpca_texels *texels, const struct method_style *style) {
    return g_strdup_printf("#define N_COMPONENTS %d\n#define N_LEVELS %d\n#define NEAREST %d\n"
                           "#define LOG %d\n",
                           MAX(1, texels->n_components), texels->n_levels, style->nearest != 0,
                           texels->log);
}

gboolean lpca_texels_size(const struct lpca_texels *texels, int ret[2]) {
    gpu_texture_size(GL_TEXTURE_2D, texels->clusters, 0, ret);
    return TRUE;
}

gint64 lpca_texels_bytes(const struct lpca_texels *texels) {
    return gpu_texture_bytes(GL_TEXTURE_2D, texels->clusters) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, texels->weights);
}

void lpca_texels_bind(const struct lpca_texels *texels, guint program) {
    gpu_bind_texture(program, "weights", 1, GL_TEXTURE_2D_ARRAY, texels->weights);
    gpu_bind_texture(program, "clusters", 2, GL_TEXTURE_2D, texels->clusters);
}

gboolean lpca_stack_init(struct lpca_stack *stack, int n_clusters, int n_columns, int n_rows,
                         const char *advice, GError **error) {
    GLint layers = 0, size = 0;
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    *stack = (struct lpca_stack){.n_columns = n_columns, .n_rows = n_rows};
    if (n_columns <= size && n_rows <= size) {
        stack->clusters_a_layer = MIN(n_clusters, size / n_rows);
        stack->n_layers = (n_clusters + stack->clusters_a_layer - 1) / stack->clusters_a_layer;
    }
    if (stack->n_layers > 0 && stack->n_layers <= layers)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "%d clusters of %d × %d texels do not fit into a texture: %s supports %d layers of "
                "%d texels in each direction; %s",
                n_clusters, n_columns, n_rows, gpu_renderer(), layers, size, advice);
    return FALSE;
}

guint lpca_stack_texture(const struct lpca_stack *stack, GError **error) {
    guint texture = gpu_texture(GL_RGBA16F, stack->n_columns,
                                stack->n_rows * stack->clusters_a_layer, stack->n_layers);
    if (gpu_check("the eigen-BRDFs' texture", error))
        return texture;
    glDeleteTextures(1, &texture);
    return 0;
}

void lpca_stack_put(const struct lpca_stack *stack, int cluster, float *values) {
    for (gsize k = 0; k < 3 * (gsize)stack->n_columns * stack->n_rows; k++)
        values[k] = CLAMP(values[k], -HALF_MAX, HALF_MAX);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, cluster % stack->clusters_a_layer * stack->n_rows,
                    cluster / stack->clusters_a_layer, stack->n_columns, stack->n_rows, 1, GL_RGB,
                    GL_FLOAT, values);
}

gboolean lpca_directions_init(struct lpca_directions *directions, const struct lpca *lpca,
                              gboolean triangulated, GError **error) {
    *directions = (struct lpca_directions){0};
    directions->views = method_directions(&lpca->layout.views, "views", triangulated, error);
    if (directions->views)
        directions->lights = method_directions(&lpca->layout.lights, "lights", triangulated, error);
    if (!directions->lights) {
        lpca_directions_clear(directions);
        return FALSE;
    }
    directions->sky = g_new0(float, lpca->layout.lights.n);
    directions_sky(directions->lights, directions->sky);
    return TRUE;
}

void lpca_directions_clear(struct lpca_directions *directions) {
    g_clear_pointer(&directions->views, directions_free);
    g_clear_pointer(&directions->lights, directions_free);
    g_clear_pointer(&directions->sky, g_free);
}
