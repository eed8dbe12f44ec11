#include "import_private.h"

#include <math.h>

#include "bonn/bonn.h"

static gboolean give_view(int view, float *ret_rgb, int *ret_holes, gpointer data, GError **error) {
    const BonnFile *file = data;
    const struct bonn_header *header = bonn_header(file);
    const gsize n = 3 * (gsize)header->width * (gsize)header->height;
    if (!bonn_read_view(file, view, ret_rgb, ret_holes, error))
        return FALSE;
    for (int light = 0; !header->cosine && light < header->n_lights; light++) {
        const float cosine = cosf(header->light_theta_deg[light] * (float)(G_PI / 180));
        for (gsize i = 0; i < n; i++)
            ret_rgb[n * (gsize)light + i] *= MAX(cosine, 0);
    }
    return TRUE;
}

gboolean import_bonn(const char *path, const char *file, const struct import_wish *wish,
                     const struct work *work, struct import_result *ret, GError **error) {
    g_autoptr(BonnFile) btf = bonn_open(file, error);
    if (!btf)
        return FALSE;
    const struct bonn_header *header = bonn_header(btf);
    const double own_mm = header->texels_a_mm > 0 ? 1 / header->texels_a_mm : 1;
    const struct import_material material = {
        .source = file,
        .width = header->width,
        .height = header->height,
        .texel_mm = wish->texel_mm > 0 ? wish->texel_mm : own_mm,
        .region = wish->region,
        .n_views = header->n_views,
        .n_lights = header->n_lights,
        .view_theta_deg = header->view_theta_deg,
        .view_phi_deg = header->view_phi_deg,
        .light_theta_deg = header->light_theta_deg,
        .light_phi_deg = header->light_phi_deg,
        .view = give_view,
        .data = btf,
    };
    return import_material(path, &material, work, ret, error);
}
