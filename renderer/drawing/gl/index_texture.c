#include "index_texture.h"

#include "gpu.h"

#include <epoxy/gl.h>

struct IndexTexture {
    guint texture;
    int n_levels;
    int corners[2 * INDEX_MAP_LEVELS]; /* column and row of the first texel of each level */
    int size[2], sample[2];
};

/* Lays out the levels of the map in one texture: level 0 at the top, and below it all other levels,
 * next to each other. Sets t->corners. ret receives the width and height of the texture in
 * texels. */
static void lay_out(IndexTexture *t, const struct index_map *map, int ret[2]) {
    int column = 0;
    ret[0] = map->width;
    ret[1] = map->height + (map->n_levels > 1 ? index_map_size(map->height, 1) : 0);
    for (int k = 1; k < map->n_levels; k++) {
        t->corners[2 * k] = column;
        t->corners[2 * k + 1] = map->height;
        column += index_map_size(map->width, k);
    }
    ret[0] = MAX(ret[0], column);
}

IndexTexture *index_texture_new(const struct index_map *map, GError **error) {
    g_autoptr(IndexTexture) t = g_new0(IndexTexture, 1);
    GLint most = 0;
    int size[2];
    *t = (IndexTexture){.n_levels = map->n_levels,
                        .size = {map->width, map->height},
                        .sample = {map->sample_width, map->sample_height}};
    lay_out(t, map, size);
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &most);
    if (MAX(size[0], size[1]) > most) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "with its mip levels, the index map of %d × %d texels needs a texture of %d × "
                    "%d texels, but %s supports at most %d × %d; synthesize a smaller index map",
                    map->width, map->height, size[0], size[1], gpu_renderer(), most, most);
        return NULL;
    }
    t->texture = gpu_texture(GL_RG16UI, size[0], size[1], 0);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    for (int k = 0; k < map->n_levels; k++)
        glTexSubImage2D(GL_TEXTURE_2D, 0, t->corners[2 * k], t->corners[2 * k + 1],
                        index_map_size(map->width, k), index_map_size(map->height, k),
                        GL_RG_INTEGER, GL_UNSIGNED_SHORT, map->levels[k]);
    return gpu_check("the index map", error) ? g_steal_pointer(&t) : NULL;
}

void index_texture_free(IndexTexture *t) {
    if (t == NULL)
        return;
    glDeleteTextures(1, &t->texture);
    g_free(t);
}

gint64 index_texture_bytes(const IndexTexture *t) {
    return t != NULL ? gpu_texture_bytes(GL_TEXTURE_2D, t->texture) : 0;
}

void index_texture_bind(const IndexTexture *t, guint program) {
    gpu_bind_texture(program, "index_map", INDEX_TEXTURE_UNIT, GL_TEXTURE_2D, t->texture);
    glUniform2iv(glGetUniformLocation(program, "index_corners"), t->n_levels, t->corners);
    glUniform2iv(glGetUniformLocation(program, "index_size"), 1, t->size);
    glUniform1i(glGetUniformLocation(program, "index_levels"), t->n_levels);
    glUniform2f(glGetUniformLocation(program, "index_sample"), (float)t->sample[0],
                (float)t->sample[1]);
}

void index_texture_period(const IndexTexture *t, double ret[2]) {
    for (int k = 0; k < 2; k++)
        ret[k] = (double)t->size[k] / t->sample[k];
}
