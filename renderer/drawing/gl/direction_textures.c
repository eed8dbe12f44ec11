#include "direction_textures.h"

#include "gpu.h"

#include <epoxy/gl.h>

void direction_textures_clear(struct direction_textures *textures) {
    const GLuint both[] = {textures->indices, textures->weights};
    glDeleteTextures(G_N_ELEMENTS(both), both);
    *textures = (struct direction_textures){0};
}

gint64 direction_textures_bytes(const struct direction_textures *textures) {
    return gpu_texture_bytes(textures->target, textures->indices) +
           gpu_texture_bytes(textures->target, textures->weights);
}

void direction_textures_bind(const struct direction_textures *textures, guint program,
                             const char *name, int unit) {
    g_autofree char *indices = g_strconcat(name, "_indices", NULL);
    g_autofree char *weights = g_strconcat(name, "_weights", NULL);
    gpu_bind_texture(program, indices, unit, textures->target, textures->indices);
    gpu_bind_texture(program, weights, unit + 1, textures->target, textures->weights);
}
