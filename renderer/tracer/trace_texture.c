#include "trace_texture.h"

#include "trace_scene.h"

#include <math.h>
#include <png.h>

struct trace_texture {
    int size[2];
    enum gltf_wrap wrap[2];
    guint8 *rgba;      /* rows from the top, sRGB */
    float linear[256]; /* of a byte */
};

TraceTexture *trace_texture_new(GBytes *bytes, const enum gltf_wrap wrap[2], GError **error) {
    png_image image = {.version = PNG_IMAGE_VERSION};
    gsize size;
    gconstpointer data = g_bytes_get_data(bytes, &size);
    if (data == NULL || !png_image_begin_read_from_memory(&image, data, size) ||
        image.width > TRACE_TEXTURE_MAX_SIDE || image.height > TRACE_TEXTURE_MAX_SIDE) {
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                    "%s; save it as PNG of at most %d pixels each way",
                    *image.message ? image.message : "it is empty or too large",
                    TRACE_TEXTURE_MAX_SIDE);
        png_image_free(&image);
        return NULL;
    }
    image.format = PNG_FORMAT_RGBA;
    guint8 *rgba = g_try_malloc(PNG_IMAGE_SIZE(image));
    if (rgba == NULL || !png_image_finish_read(&image, NULL, rgba, 0, NULL)) {
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE, "its picture: %s",
                    rgba == NULL ? "there is no memory left" : image.message);
        png_image_free(&image);
        g_free(rgba);
        return NULL;
    }
    TraceTexture *ret = g_new0(TraceTexture, 1);
    *ret = (TraceTexture){
        .size = {(int)image.width, (int)image.height}, .wrap = {wrap[0], wrap[1]}, .rgba = rgba};
    for (int k = 0; k < 256; k++) {
        const double coded = k / 255.0;
        ret->linear[k] =
            (float)(coded <= 0.04045 ? coded / 12.92 : pow((coded + 0.055) / 1.055, 2.4));
    }
    return ret;
}

void trace_texture_free(TraceTexture *texture) {
    if (texture == NULL)
        return;
    g_free(texture->rgba);
    g_free(texture);
}

/* The pixel that stands for number k of a row or column of n. */
static int texture_wrapped(double k, int n, enum gltf_wrap wrap) {
    if (wrap == GLTF_WRAP_CLAMP)
        return (int)CLAMP(k, 0.0, n - 1.0);
    const double period = wrap == GLTF_WRAP_MIRROR ? 2.0 * n : n;
    const int at = CLAMP((int)(k - floor(k / period) * period), 0, (int)period - 1);
    return at < n ? at : 2 * n - 1 - at;
}

void trace_texture_colour(const TraceTexture *texture, double u, double v, double ret_rgb[3]) {
    const double at[2] = {u * texture->size[0] - 0.5, (1.0 - v) * texture->size[1] - 0.5};
    int pixel[2][2];
    double share[2][2];
    ret_rgb[0] = ret_rgb[1] = ret_rgb[2] = 0.0;
    if (!isfinite(at[0]) || !isfinite(at[1]))
        return;
    for (int axis = 0; axis < 2; axis++) {
        const double below = floor(at[axis]);
        share[axis][1] = at[axis] - below;
        share[axis][0] = 1.0 - share[axis][1];
        for (int k = 0; k < 2; k++)
            pixel[axis][k] = texture_wrapped(below + k, texture->size[axis], texture->wrap[axis]);
    }
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) {
            const gsize row = (gsize)pixel[1][j] * (gsize)texture->size[0];
            const guint8 *from = texture->rgba + 4 * (row + (gsize)pixel[0][i]);
            for (int c = 0; c < 3; c++)
                ret_rgb[c] += share[0][i] * share[1][j] * (double)texture->linear[from[c]];
        }
}
