#include "lpca_view.h"

#include "direction_table.h"
#include "gpu.h"

#include <epoxy/gl.h>
#include <math.h>

#define HALF_MAX 65504.0f

struct LpcaView {
    int n_components, n_rows, clusters_a_layer, ambient_column;
    guint brdfs, weights, clusters;
    struct direction_table views, lights;
};

/* How eigen-BRDFs lie in their texture: a row a view and one for the views' pole; columns are
 * lights, the lights' pole, and the sky, each with all components. */
struct layout {
    int n_clusters, n_rows, n_columns, clusters_a_layer, n_layers;
};

static gboolean lay_out(const struct lpca *lpca, struct layout *ret, GError **error) {
    GLint layers = 0, size = 0;
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    *ret = (struct layout){.n_clusters = lpca->n_clusters,
                           .n_rows = lpca->n_views + 1,
                           .n_columns = (lpca->n_lights + 2) * (lpca->n_components + 1)};
    if (ret->n_columns > size || ret->n_rows > size || lpca->width > size || lpca->height > size) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "%d × %d texels, %d views, and %d components of %d lights: %s takes textures "
                    "of %d each way; compress with fewer components, or process with fewer texels",
                    lpca->width, lpca->height, lpca->n_views, lpca->n_components, lpca->n_lights,
                    gpu_renderer(), size);
        return FALSE;
    }
    ret->clusters_a_layer = MIN(lpca->n_clusters, size / ret->n_rows);
    ret->n_layers = (lpca->n_clusters + ret->clusters_a_layer - 1) / ret->clusters_a_layer;
    if (ret->n_layers <= layers)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "%d clusters of %d views need %d layers, %s has %d; compress with fewer clusters",
                lpca->n_clusters, lpca->n_views, ret->n_layers, gpu_renderer(), layers);
    return FALSE;
}

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

static void fill_cluster(const struct lpca *lpca, const struct layout *layout, int cluster,
                         const float *view_pole, const float *pole, const float *sky, float *ret) {
    const gsize row = 3 * (gsize)layout->n_columns;
    for (int i = 0; i <= lpca->n_components; i++)
        for (int v = 0; v < lpca->n_views; v++) {
            const float *values = values_of(lpca, cluster, i, v);
            add_lights(lpca, values, pole, sky, 1.0f, i, ret + row * v);
            if (view_pole[v] > 0)
                add_lights(lpca, values, pole, sky, view_pole[v], i, ret + row * lpca->n_views);
        }
    for (gsize k = 0; k < row * layout->n_rows; k++)
        ret[k] = CLAMP(ret[k], -HALF_MAX, HALF_MAX);
}

static gboolean all_finite(const float *values, gsize n, const char *what, GError **error) {
    for (gsize k = 0; k < n; k++)
        if (!isfinite(values[k])) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "%s number %" G_GSIZE_FORMAT " is not a finite number", what, k);
            return FALSE;
        }
    return TRUE;
}

static gboolean check(const struct lpca *lpca, GError **error) {
    const gsize texels = (gsize)lpca->width * lpca->height;
    const gsize brdf = 3 * (gsize)lpca->n_views * lpca->n_lights;
    if (lpca->n_views < 1 || lpca->n_lights < 1 || texels < 1 || lpca->n_clusters < 1) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED, "the material has no texels or directions");
        return FALSE;
    }
    for (gsize k = 0; k < texels; k++)
        if (lpca->clusters[k] < 0 || lpca->clusters[k] >= lpca->n_clusters) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "texel %" G_GSIZE_FORMAT " is in cluster %d, of %d there are", k,
                        lpca->clusters[k], lpca->n_clusters);
            return FALSE;
        }
    return all_finite(lpca->weights, texels * lpca->n_components, "weight", error) &&
           all_finite(lpca->brdfs, brdf * (lpca->n_components + 1) * lpca->n_clusters,
                      "eigen-BRDF value", error);
}

static gboolean upload_brdfs(LpcaView *view, const struct lpca *lpca, const struct layout *layout,
                             const Directions *views, Directions *lights, GError **error) {
    g_autofree float *view_pole = g_new0(float, lpca->n_views);
    g_autofree float *pole = g_new0(float, lpca->n_lights);
    g_autofree float *sky = g_new0(float, lpca->n_lights);
    const gsize n = 3 * (gsize)layout->n_columns * layout->n_rows;
    g_autofree float *cluster = g_new(float, n);
    direction_table_pole_shares(views, view_pole, lpca->n_views);
    direction_table_pole_shares(lights, pole, lpca->n_lights);
    directions_sky(lights, sky);
    view->brdfs = gpu_texture(GL_RGB16F, layout->n_columns,
                              layout->n_rows * layout->clusters_a_layer, layout->n_layers);
    if (!gpu_check("the eigen-BRDFs' texture", error))
        return FALSE;
    for (int k = 0; k < lpca->n_clusters; k++) {
        for (gsize i = 0; i < n; i++)
            cluster[i] = 0;
        fill_cluster(lpca, layout, k, view_pole, pole, sky, cluster);
        glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, k % layout->clusters_a_layer * layout->n_rows,
                        k / layout->clusters_a_layer, layout->n_columns, layout->n_rows, 1, GL_RGB,
                        GL_FLOAT, cluster);
    }
    return gpu_check("the eigen-BRDFs' texture", error);
}

static gboolean upload_texels(LpcaView *view, const struct lpca *lpca, GError **error) {
    const gsize texels = (gsize)lpca->width * lpca->height;
    const int pages = MAX(1, (lpca->n_components + 3) / 4);
    g_autofree guint16 *clusters = g_new(guint16, texels);
    g_autofree float *page = g_new(float, 4 * texels);
    for (gsize k = 0; k < texels; k++)
        clusters[k] = (guint16)lpca->clusters[k];
    view->clusters = gpu_texture(GL_R16UI, lpca->width, lpca->height, 0);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, lpca->width, lpca->height, GL_RED_INTEGER,
                    GL_UNSIGNED_SHORT, clusters);
    view->weights = gpu_texture(GL_RGBA32F, lpca->width, lpca->height, pages);
    for (int p = 0; p < pages; p++) {
        for (gsize k = 0; k < 4 * texels; k++) {
            const int i = 4 * p + (int)(k % 4);
            page[k] = i < lpca->n_components ? lpca->weights[k / 4 * lpca->n_components + i] : 0;
        }
        glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, p, lpca->width, lpca->height, 1, GL_RGBA,
                        GL_FLOAT, page);
    }
    return gpu_check("the weights' texture", error);
}

static Directions *directions_of(const char *what, const float *theta_deg, const float *phi_deg,
                                 int n, GError **error) {
    Directions *directions = directions_new(theta_deg, phi_deg, n, error);
    if (directions == NULL)
        g_prefix_error(error, "%s: ", what);
    return directions;
}

LpcaView *lpca_view_new(const struct lpca *lpca, GError **error) {
    struct layout layout;
    if (!check(lpca, error) || !lay_out(lpca, &layout, error))
        return NULL;
    g_autoptr(Directions) views =
        directions_of("views", lpca->view_theta_deg, lpca->view_phi_deg, lpca->n_views, error);
    g_autoptr(Directions) lights = views ? directions_of("lights", lpca->light_theta_deg,
                                                         lpca->light_phi_deg, lpca->n_lights, error)
                                         : NULL;
    if (lights == NULL)
        return NULL;
    g_autoptr(LpcaView) view = g_new0(LpcaView, 1);
    view->n_components = lpca->n_components;
    view->n_rows = layout.n_rows;
    view->clusters_a_layer = layout.clusters_a_layer;
    view->ambient_column = lpca->n_lights + 1;
    view->views = direction_table_new(views, FALSE);
    view->lights = direction_table_new(lights, TRUE);
    if (!upload_brdfs(view, lpca, &layout, views, lights, error) ||
        !upload_texels(view, lpca, error))
        return NULL;
    return g_steal_pointer(&view);
}

void lpca_view_free(LpcaView *view) {
    if (view == NULL)
        return;
    const GLuint textures[] = {view->brdfs, view->weights, view->clusters};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    direction_table_clear(&view->views);
    direction_table_clear(&view->lights);
    g_free(view);
}

static void bind(guint program, const char *name, int unit, GLenum target, guint texture) {
    glActiveTexture(GL_TEXTURE0 + unit);
    glBindTexture(target, texture);
    glUniform1i(glGetUniformLocation(program, name), unit);
}

static void set_int(guint program, const char *name, int value) {
    glUniform1i(glGetUniformLocation(program, name), value);
}

static void bind_all(gpointer material, guint program, gboolean nearest) {
    const LpcaView *view = material;
    bind(program, "brdfs", 0, GL_TEXTURE_2D_ARRAY, view->brdfs);
    bind(program, "weights", 1, GL_TEXTURE_2D_ARRAY, view->weights);
    bind(program, "clusters", 2, GL_TEXTURE_2D, view->clusters);
    direction_table_bind(&view->views, program, "view", 3);
    direction_table_bind(&view->lights, program, "light", 5);
    glActiveTexture(GL_TEXTURE0);
    set_int(program, "n_components", view->n_components);
    set_int(program, "n_rows", view->n_rows);
    set_int(program, "clusters_a_layer", view->clusters_a_layer);
    set_int(program, "ambient_column", view->ambient_column);
    set_int(program, "nearest", nearest);
}

static gpointer open_file(const char *path, GError **error) {
    struct lpca *lpca = lpca_read(path, error);
    LpcaView *view = lpca != NULL ? lpca_view_new(lpca, error) : NULL;
    lpca_free(lpca);
    return view;
}

static void free_view(gpointer material) {
    lpca_view_free(material);
}

static const char *const shader_names[] = {"directions.glsl", "lpca.glsl", NULL};

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
