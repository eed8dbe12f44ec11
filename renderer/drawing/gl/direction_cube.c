#include "direction_cube.h"

#include "cube_map.h"

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

struct direction_textures direction_cube_new(Directions *directions, gboolean fade) {
    struct filling filling = {directions, fade};
    return (struct direction_textures){GL_TEXTURE_CUBE_MAP,
                                       cube_map_new(SIZE, FALSE, fill_indices, &filling),
                                       cube_map_new(SIZE, FALSE, fill_weights, &filling)};
}
