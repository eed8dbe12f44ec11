#include "webgl_neural.h"

#include "codecs/neural/neural_drawing.h"
#include "exr/exr_half.h"

#include <string.h>

#define GROUP 4 /* channels of a layer of a texture */

gint64 webgl_neural_bytes(const struct neural *neural) {
    const gint64 texels = (gint64)btf_layout_texels(&neural->layout);
    g_autofree char *network = neural_shader_network(neural);
    const gint64 sky = 2 * 3 * NEURAL_SKY * NEURAL_SKY; /* of a texel */
    return texels * (neural->n_channels + 4 + sky) +
           (gint64)sizeof(float) * 2 * NEURAL_PLANE_VALUES + (gint64)strlen(network);
}

static gboolean add_surface(WebglFile *file, const struct neural *neural, GError **error) {
    const gsize texels = btf_layout_texels(&neural->layout), n = (gsize)neural->n_channels;
    g_autofree guint8 *layers = g_new(guint8, texels * n);
    for (gsize i = 0; i < texels * n; i++) {
        const gsize layer = i / (texels * GROUP), texel = i / GROUP % texels;
        layers[i] = neural->surface[texel * n + layer * GROUP + i % GROUP];
    }
    return webgl_file_add(file, "surface", layers, texels * n, error) &&
           webgl_file_add(file, "heights", neural->heights, 4 * texels, error);
}

static gboolean add_sky(WebglFile *file, const struct neural *neural, int ret_size[2],
                        GError **error) {
    g_autofree float *sky = neural_shader_sky(neural, &ret_size[0], &ret_size[1]);
    const gsize n = 3 * (gsize)NEURAL_SKY * NEURAL_SKY * (gsize)ret_size[0] * (gsize)ret_size[1];
    g_autofree guint16 *halves = g_new(guint16, n);
    for (gsize i = 0; i < n; i++)
        sky[i] = MIN(sky[i], EXR_HALF_LARGEST);
    exr_half_from_floats(halves, sky, n);
    return webgl_file_add(file, "sky", halves, sizeof *halves * n, error);
}

gboolean webgl_neural_add(WebglFile *file, const struct neural *neural, GVariantDict *info,
                          GError **error) {
    const double texel_mm = neural->layout.texel_mm;
    g_autofree char *network = neural_shader_network(neural);
    float planes[2 * NEURAL_PLANE_VALUES];
    int sky[2];
    neural_shader_planes(neural, planes);
    if (!add_surface(file, neural, error) ||
        !webgl_file_add(file, "planes", planes, sizeof planes, error) ||
        !add_sky(file, neural, sky, error) ||
        !webgl_file_add(file, "network", network, strlen(network), error))
        return FALSE;
    GVariantDict own;
    g_variant_dict_init(&own, NULL);
    g_variant_dict_insert(&own, "channels", "i", neural->n_channels);
    g_variant_dict_insert(&own, "plane", "i", NEURAL_PLANE);
    g_variant_dict_insert_value(&own, "sky", g_variant_new_parsed("[%i, %i]", sky[0], sky[1]));
    g_variant_dict_insert_value(
        &own, "heights",
        g_variant_new_parsed("[%d, %d]", (double)neural->height_scale.minimum / texel_mm,
                             (double)neural->height_scale.step / texel_mm));
    g_variant_dict_insert_value(info, "neural", g_variant_dict_end(&own));
    return TRUE;
}
