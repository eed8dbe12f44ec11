#include "mdf_texture.h"

#include "direction_table.h"
#include "gpu.h"

#include <epoxy/gl.h>

struct MdfTexture {
    guint depths; /* a layer a view, and one for the pole */
    struct direction_table views;
    double width_mm, height_mm, deepest_mm;
};

static gboolean check(const struct mdf_table *t, GError **error) {
    GLint layers = 0, size = 0;
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    if (t->n_views + 1 <= layers && t->width <= size && t->height <= size)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "an MDF of %d views of %d × %d texels: %s takes %d views of %d texels each way",
                t->n_views, t->width, t->height, gpu_renderer(), layers - 1, size);
    return FALSE;
}

static void upload_depths(MdfTexture *texture, const struct mdf_table *t,
                          const Directions *directions) {
    gsize n = (gsize)t->width * t->height;
    g_autofree float *shares = g_new0(float, t->n_views), *mean = g_new0(float, n);
    direction_table_pole_shares(directions, shares, t->n_views);
    for (int k = 0; k < t->n_views; k++)
        for (gsize i = 0; shares[k] > 0.0f && i < n; i++)
            mean[i] += t->depth_mm[k * n + i] * shares[k];
    glGenTextures(1, &texture->depths);
    glBindTexture(GL_TEXTURE_2D_ARRAY, texture->depths);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_R16F, t->width, t->height, t->n_views + 1, 0, GL_RED,
                 GL_FLOAT, NULL);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, 0, t->width, t->height, t->n_views, GL_RED,
                    GL_FLOAT, t->depth_mm);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, t->n_views, t->width, t->height, 1, GL_RED,
                    GL_FLOAT, mean);
    glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_NEAREST);
}

MdfTexture *mdf_texture_new(const struct mdf_table *t, GError **error) {
    if (!check(t, error))
        return NULL;
    g_autoptr(Directions) directions = directions_new(t->theta_deg, t->phi_deg, t->n_views, error);
    if (directions == NULL) {
        g_prefix_error(error, "views of the MDF: ");
        return NULL;
    }
    g_autoptr(MdfTexture) texture = g_new0(MdfTexture, 1);
    texture->width_mm = t->width * t->texel_mm;
    texture->height_mm = t->height * t->texel_mm;
    texture->deepest_mm = t->deepest_mm;
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    upload_depths(texture, t, directions);
    texture->views = direction_table_new(directions, FALSE);
    if (!gpu_check("the MDF's texture", error))
        return NULL;
    return g_steal_pointer(&texture);
}

void mdf_texture_free(MdfTexture *texture) {
    if (texture == NULL)
        return;
    glDeleteTextures(1, &texture->depths);
    direction_table_clear(&texture->views);
    g_free(texture);
}

gint64 mdf_texture_bytes(const MdfTexture *texture) {
    return texture == NULL ? 0
                           : gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, texture->depths) +
                                 direction_table_bytes(&texture->views);
}

void mdf_texture_bind(const MdfTexture *texture, guint program) {
    glActiveTexture(GL_TEXTURE0 + MDF_TEXTURE_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, texture->depths);
    glUniform1i(glGetUniformLocation(program, "mdf_depths"), MDF_TEXTURE_UNIT);
    direction_table_bind(&texture->views, program, "mdf", MDF_TEXTURE_UNIT + 1);
    glUniform2f(glGetUniformLocation(program, "mdf_size"), texture->width_mm, texture->height_mm);
    glUniform1f(glGetUniformLocation(program, "mdf_deepest"), texture->deepest_mm);
    glActiveTexture(GL_TEXTURE0);
}
