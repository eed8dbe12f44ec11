#include "direction_table.h"

#include "gpu.h"

#include <epoxy/gl.h>

#define SIZE 512

struct direction_textures direction_table_new(Directions *directions, gboolean fade) {
    g_autofree guint16 *indices = g_new(guint16, 4 * SIZE * SIZE);
    g_autofree float *weights = g_new(float, 4 * SIZE * SIZE);
    const double step = 2.0 / SIZE;
    for (int j = 0; j < SIZE; j++)
        for (int i = 0; i < SIZE; i++) {
            gsize at = 4 * ((gsize)j * SIZE + i);
            struct vec3 d =
                directions_from_square(-1.0 + (i + 0.5) * step, -1.0 + (j + 0.5) * step);
            struct direction_weights w;
            directions_weights(directions, d, &w);
            double faded = fade ? directions_fade(directions, d) : 1.0;
            for (int k = 0; k < 4; k++) {
                indices[at + k] = w.index[k];
                weights[at + k] = faded * w.weight[k];
            }
        }
    struct direction_textures table = {.target = GL_TEXTURE_2D};
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    table.indices = gpu_texture(GL_RGBA16UI, SIZE, SIZE, 0);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, SIZE, SIZE, GL_RGBA_INTEGER, GL_UNSIGNED_SHORT,
                    indices);
    table.weights = gpu_texture(GL_RGBA16, SIZE, SIZE, 0);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, SIZE, SIZE, GL_RGBA, GL_FLOAT, weights);
    return table;
}

void direction_table_pole_shares(const Directions *directions, float *ret_shares, int n) {
    int n_members;
    const int *members = directions_pole(directions, &n_members);
    for (int k = 0; k < n; k++)
        ret_shares[k] = 0.0f;
    for (int k = 0; k < n_members; k++)
        ret_shares[members[k]] += 1.0f / n_members;
}
