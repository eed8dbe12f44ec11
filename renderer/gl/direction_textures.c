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

static void direction_textures_do_bind(guint program, const char *name, const char *which, int unit,
                                       guint target, guint texture) {
    g_autofree char *uniform = g_strconcat(name, which, NULL);
    glActiveTexture(GL_TEXTURE0 + unit);
    glBindTexture(target, texture);
    glUniform1i(glGetUniformLocation(program, uniform), unit);
}

void direction_textures_bind(const struct direction_textures *textures, guint program,
                             const char *name, int unit) {
    direction_textures_do_bind(program, name, "_indices", unit, textures->target,
                               textures->indices);
    direction_textures_do_bind(program, name, "_weights", unit + 1, textures->target,
                               textures->weights);
}
