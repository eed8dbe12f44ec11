#include "slices.h"

#include "drawing/gl/gpu.h"
#include "method.h"

#include <epoxy/gl.h>
#include <math.h>

#define PAGE SLICES_PAGE

gboolean slices_check_size(const struct slices *slices, const struct btf_layout *layout,
                           const char *advice, GError **error) {
    const int n_layers = slices->n_slices * slices->n_pages;
    GLint size = 0, layers = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    if (layout->width <= (gsize)size && layout->height <= (gsize)size && n_layers <= layers &&
        layout->views.n + 1 <= (gsize)layers)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "the %s: %zu × %zu texels in %d layers, with the even sky of %zu views, do not fit "
                "into textures: %s supports %d texels in each direction and %d layers; %s",
                slices->what, layout->width, layout->height, n_layers, layout->views.n,
                gpu_renderer(), size, layers, advice);
    return FALSE;
}

gboolean slices_check_values(const struct slices *slices, const struct slices_level *level,
                             GError **error) {
    const gsize n = btf_layout_texels(level->layout) * (gsize)slices->n_slices * level->n_values;
    for (gsize k = 0; k < n; k++)
        if (!isfinite(level->values[k])) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "value number %zu (counted from 0) of the %s is not finite: the file is "
                        "damaged; compress the material again",
                        k, slices->what);
            return FALSE;
        }
    return TRUE;
}

static void put_layer(const struct btf_layout *layout, int level, gsize layer, const float *rgba) {
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, level, 0, 0, (GLint)layer, (GLsizei)layout->width,
                    (GLsizei)layout->height, 1, GL_RGBA, GL_FLOAT, rgba);
}

static void upload_values(const struct slices *slices, const struct slices_level *from, int level) {
    const gsize texels = btf_layout_texels(from->layout), n_pages = (gsize)slices->n_pages;
    g_autofree float *layer = g_new(float, PAGE *texels);
    for (gsize n = 0; n < (gsize)slices->n_slices * n_pages; n++) {
        const float *values = from->values + n / n_pages * texels * from->n_values;
        for (gsize k = 0; k < PAGE * texels; k++) {
            const int at = slices->value_at[n % n_pages][k % PAGE];
            layer[k] = at < 0 ? 0 : values[k / PAGE * from->n_values + (gsize)at];
        }
        put_layer(from->layout, level, n, layer);
    }
}

/* Uploads the reflectance under an even sky: one layer per view, then one for the pole. */
static void upload_ambients(const struct slices_level *from, int level, SlicesSky sky,
                            const float *pole_share) {
    const gsize texels = btf_layout_texels(from->layout), n_views = from->layout->views.n;
    g_autofree float *layer = g_new(float, PAGE *texels), *pole = g_new0(float, PAGE *texels);
    for (gsize v = 0; v < n_views; v++) {
        sky(from->model, v, layer);
        for (gsize k = 0; k < PAGE * texels; k++)
            pole[k] += pole_share[v] * layer[k];
        put_layer(from->layout, level, v, layer);
    }
    put_layer(from->layout, level, n_views, pole);
}

gboolean slices_upload(struct slices *slices, const struct slices_level *levels, int n,
                       SlicesSky sky, GError **error) {
    const struct btf_layout *layout = levels[0].layout;
    const int width = (int)layout->width, height = (int)layout->height;
    const int n_views = (int)layout->views.n;
    slices->width = width;
    slices->height = height;
    g_autofree char *what = g_strdup_printf("the texture of the %s", slices->what);
    g_autoptr(Directions) views = method_directions(&layout->views, "views", FALSE, error);
    if (!views)
        return FALSE;
    slices->views = direction_table_new(views, FALSE);
    /* number of views in the mean that stands for the pole */
    int n_members;
    const int *members = directions_pole(views, &n_members);
    g_autofree guint16 *indices = g_new0(guint16, MAX(1, n_members));
    for (int k = 0; k < n_members; k++)
        indices[k] = (guint16)members[k];
    slices->pole = gpu_texture(GL_R16UI, MAX(1, n_members), 1, 0);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, MAX(1, n_members), 1, GL_RED_INTEGER, GL_UNSIGNED_SHORT,
                    indices);
    g_autofree float *shares = g_new0(float, n_views);
    direction_table_pole_shares(views, shares, n_views);
    slices->values = gpu_texture_levels(GL_RGBA16F, width, height,
                                        slices->n_slices * slices->n_pages, slices->n_levels);
    if (!gpu_check(what, error))
        return FALSE;
    for (int k = 0; k < n; k++)
        upload_values(slices, &levels[k], k);
    if (n < slices->n_levels)
        glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    if (!gpu_check(what, error))
        return FALSE;
    slices->ambients = gpu_texture_levels(GL_RGBA16F, width, height, n_views + 1, slices->n_levels);
    if (!gpu_check("the texture of the ambient light", error))
        return FALSE;
    for (int k = 0; k < n; k++)
        upload_ambients(&levels[k], k, sky, shares);
    if (n < slices->n_levels)
        glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    return gpu_check("the texture of the ambient light", error);
}

void slices_clear(struct slices *slices) {
    const GLuint textures[] = {slices->values, slices->ambients, slices->pole};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    direction_textures_clear(&slices->views);
}

gboolean slices_texels(const struct slices *slices, int ret[2]) {
    gpu_texture_size(GL_TEXTURE_2D_ARRAY, slices->values, 0, ret);
    return TRUE;
}

gint64 slices_bytes(const struct slices *slices) {
    return gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, slices->values) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, slices->ambients) +
           gpu_texture_bytes(GL_TEXTURE_2D, slices->pole) +
           direction_textures_bytes(&slices->views);
}

void slices_bind(const struct slices *slices, guint program) {
    gpu_bind_texture(program, "values", 0, GL_TEXTURE_2D_ARRAY, slices->values);
    gpu_bind_texture(program, "ambients", 1, GL_TEXTURE_2D_ARRAY, slices->ambients);
    gpu_bind_texture(program, "pole", 2, GL_TEXTURE_2D, slices->pole);
    direction_textures_bind(&slices->views, program, "view", 3);
    glUniform1i(glGetUniformLocation(program, "n_pages"), slices->n_pages);
    glUniform1i(glGetUniformLocation(program, "n_slices"), slices->n_slices);
}
