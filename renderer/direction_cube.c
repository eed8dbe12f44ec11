#include "direction_cube.h"

#include "cube_map.h"
#include "gpu.h"

#include <epoxy/gl.h>

#define SIZE 256

struct filling {
    Directions *directions;
    gboolean fade;
};

static void fill_indices(struct vec3 d, gpointer data, float ret[4]) {
    const struct filling *f = data;
    struct direction_weights w;
    directions_weights(f->directions, d, &w);
    for (int k = 0; k < 4; k++)
        ret[k] = (float)w.index[k] / G_MAXUINT16;
}

static void fill_weights(struct vec3 d, gpointer data, float ret[4]) {
    const struct filling *f = data;
    struct direction_weights w;
    directions_weights(f->directions, d, &w);
    const float faded = f->fade ? (float)directions_fade(f->directions, d) : 1;
    for (int k = 0; k < 4; k++)
        ret[k] = faded * w.weight[k];
}

struct direction_cube direction_cube_new(Directions *directions, gboolean fade) {
    struct filling filling = {directions, fade};
    return (struct direction_cube){cube_map_new(SIZE, FALSE, fill_indices, &filling),
                                   cube_map_new(SIZE, FALSE, fill_weights, &filling)};
}

void direction_cube_clear(struct direction_cube *cube) {
    const GLuint textures[] = {cube->indices, cube->weights};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    *cube = (struct direction_cube){0};
}

gint64 direction_cube_bytes(const struct direction_cube *cube) {
    return gpu_texture_bytes(GL_TEXTURE_CUBE_MAP, cube->indices) +
           gpu_texture_bytes(GL_TEXTURE_CUBE_MAP, cube->weights);
}

static void bind(guint program, const char *name, const char *which, int unit, guint texture) {
    g_autofree char *uniform = g_strconcat(name, which, NULL);
    glActiveTexture(GL_TEXTURE0 + unit);
    glBindTexture(GL_TEXTURE_CUBE_MAP, texture);
    glUniform1i(glGetUniformLocation(program, uniform), unit);
}

void direction_cube_bind(const struct direction_cube *cube, guint program, const char *name,
                         int unit) {
    bind(program, name, "_indices", unit, cube->indices);
    bind(program, name, "_weights", unit + 1, cube->weights);
}
