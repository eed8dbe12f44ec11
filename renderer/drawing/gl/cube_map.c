#include "cube_map.h"

#include <epoxy/gl.h>
#include <math.h>

/* Returns the direction of the centre of texel (i, j) of a face of size × size texels. Faces are in
 * the order of OpenGL: +x, −x, +y, −y, +z, −z. */
static struct vec3 direction(int face, int i, int j, int size) {
    const double s = 2 * (i + 0.5) / size - 1, t = 2 * (j + 0.5) / size - 1;
    const struct vec3 all[6] = {{1, -t, -s}, {-1, -t, s}, {s, 1, t},
                                {s, -1, -t}, {s, -t, 1},  {-s, -t, -1}};
    const double length = sqrt(1 + s * s + t * t);
    return (struct vec3){all[face].x / length, all[face].y / length, all[face].z / length};
}

guint cube_map_new(int size, gboolean filtered, CubeMapFill fill, gpointer data) {
    g_autofree float *values = g_new(float, 4 * (gsize)size * size);
    GLuint texture;
    glGenTextures(1, &texture);
    glBindTexture(GL_TEXTURE_CUBE_MAP, texture);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    for (int face = 0; face < 6; face++) {
        for (int j = 0; j < size; j++)
            for (int i = 0; i < size; i++)
                fill(direction(face, i, j, size), data, values + 4 * ((gsize)j * size + i));
        glTexImage2D(GL_TEXTURE_CUBE_MAP_POSITIVE_X + face, 0, GL_RGBA16, size, size, 0, GL_RGBA,
                     GL_FLOAT, values);
    }
    const GLint filter = filtered ? GL_LINEAR : GL_NEAREST;
    glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MAX_LEVEL, 0);
    glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MIN_FILTER, filter);
    glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MAG_FILTER, filter);
    return texture;
}
