#include "lpca_texels.h"

#include "gpu.h"

#include <epoxy/gl.h>
#include <math.h>

#define HALF_MAX 65504.0f

static gboolean all_finite(const float *values, gsize n, const char *what, GError **error) {
    for (gsize k = 0; k < n; k++)
        if (!isfinite(values[k])) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "%s number %" G_GSIZE_FORMAT " is not a finite number", what, k);
            return FALSE;
        }
    return TRUE;
}

gboolean lpca_texels_check(const struct lpca *lpca, GError **error) {
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
    GLint size = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    if (lpca->width > size || lpca->height > size) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "%d × %d texels: %s takes %d each way; process the material with fewer texels",
                    lpca->width, lpca->height, gpu_renderer(), size);
        return FALSE;
    }
    return all_finite(lpca->weights, texels * lpca->n_components, "weight", error) &&
           all_finite(lpca->brdfs, brdf * (lpca->n_components + 1) * lpca->n_clusters,
                      "eigen-BRDF value", error);
}

gboolean lpca_texels_init(struct lpca_texels *texels, const struct lpca *lpca, GError **error) {
    const gsize n = (gsize)lpca->width * lpca->height;
    const int pages = MAX(1, (lpca->n_components + 3) / 4);
    g_autofree guint16 *clusters = g_new(guint16, n);
    g_autofree float *page = g_new(float, 4 * n);
    for (gsize k = 0; k < n; k++)
        clusters[k] = (guint16)lpca->clusters[k];
    texels->n_components = lpca->n_components;
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    texels->clusters = gpu_texture(GL_R16UI, lpca->width, lpca->height, 0);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, lpca->width, lpca->height, GL_RED_INTEGER,
                    GL_UNSIGNED_SHORT, clusters);
    texels->weights = gpu_texture(GL_RGBA32F, lpca->width, lpca->height, pages);
    for (int p = 0; p < pages; p++) {
        for (gsize k = 0; k < 4 * n; k++) {
            const int i = 4 * p + (int)(k % 4);
            page[k] = i < lpca->n_components ? lpca->weights[k / 4 * lpca->n_components + i] : 0;
        }
        glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, p, lpca->width, lpca->height, 1, GL_RGBA,
                        GL_FLOAT, page);
    }
    return gpu_check("the weights' texture", error);
}

void lpca_texels_clear(struct lpca_texels *texels) {
    const GLuint textures[] = {texels->weights, texels->clusters};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    *texels = (struct lpca_texels){0};
}

void lpca_texels_bind(const struct lpca_texels *texels, guint program, gboolean nearest) {
    glActiveTexture(GL_TEXTURE1);
    glBindTexture(GL_TEXTURE_2D_ARRAY, texels->weights);
    glActiveTexture(GL_TEXTURE2);
    glBindTexture(GL_TEXTURE_2D, texels->clusters);
    glUniform1i(glGetUniformLocation(program, "weights"), 1);
    glUniform1i(glGetUniformLocation(program, "clusters"), 2);
    glUniform1i(glGetUniformLocation(program, "n_components"), texels->n_components);
    glUniform1i(glGetUniformLocation(program, "nearest"), nearest);
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
    g_set_error(
        error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
        "%d clusters of %d × %d values are more than %s takes (%d layers of %d each way); %s",
        n_clusters, n_columns, n_rows, gpu_renderer(), layers, size, advice);
    return FALSE;
}

guint lpca_stack_texture(const struct lpca_stack *stack, GError **error) {
    guint texture = gpu_texture(GL_RGB16F, stack->n_columns,
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

static Directions *directions_of(const char *what, const float *theta_deg, const float *phi_deg,
                                 int n, GError **error) {
    Directions *directions = directions_new(theta_deg, phi_deg, n, error);
    if (directions == NULL)
        g_prefix_error(error, "%s: ", what);
    return directions;
}

gboolean lpca_directions_init(struct lpca_directions *directions, const struct lpca *lpca,
                              GError **error) {
    *directions = (struct lpca_directions){0};
    directions->views =
        directions_of("views", lpca->view_theta_deg, lpca->view_phi_deg, lpca->n_views, error);
    if (directions->views)
        directions->lights = directions_of("lights", lpca->light_theta_deg, lpca->light_phi_deg,
                                           lpca->n_lights, error);
    if (!directions->lights) {
        lpca_directions_clear(directions);
        return FALSE;
    }
    directions->sky = g_new0(float, lpca->n_lights);
    directions_sky(directions->lights, directions->sky);
    return TRUE;
}

void lpca_directions_clear(struct lpca_directions *directions) {
    g_clear_pointer(&directions->views, directions_free);
    g_clear_pointer(&directions->lights, directions_free);
    g_clear_pointer(&directions->sky, g_free);
}
