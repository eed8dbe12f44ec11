#include "import_private.h"

#include <math.h>

#include "bonn/bonn.h"

/* The views of a BDI that are in memory together take at most this memory. */
#define VIEWS_MEMORY ((gsize)576 << 20)
#define MAX_TOGETHER 16

struct imported {
    BonnFile *file;
    BonnViews *views; /* the views in memory, or NULL */
    int n_threads;
};

/* Multiplies the values of a picture by n·l if the file has values without it. */
static void multiply_cosine(const struct bonn_header *header, int light, float *rgb) {
    const gsize n = 3 * (gsize)header->width * (gsize)header->height;
    if (header->cosine)
        return;
    const float cosine = cosf(header->light_theta_deg[light] * (float)(G_PI / 180));
    for (gsize i = 0; i < n; i++)
        rgb[i] *= MAX(cosine, 0);
}

static gboolean give_view(int view, float *ret_rgb, int *ret_holes, gpointer data, GError **error) {
    const struct imported *imported = data;
    const struct bonn_header *header = bonn_header(imported->file);
    const gsize n = 3 * (gsize)header->width * (gsize)header->height;
    if (!bonn_read_view(imported->file, view, ret_rgb, ret_holes, error))
        return FALSE;
    for (int light = 0; light < header->n_lights; light++)
        multiply_cosine(header, light, ret_rgb + n * (gsize)light);
    return TRUE;
}

static gboolean load(int first, int n, gpointer data, GError **error) {
    struct imported *imported = data;
    g_clear_pointer(&imported->views, bonn_views_free);
    imported->views = bonn_views_read(imported->file, first, n, imported->n_threads, error);
    return imported->views != NULL;
}

static gboolean give_picture(int view, int light, const struct import_region *region,
                             float *const *ret_planes, int *ret_holes, gpointer data,
                             GError **error G_GNUC_UNUSED) {
    const struct imported *imported = data;
    const struct bonn_header *header = bonn_header(imported->file);
    const gsize n = 3 * (gsize)header->width * (gsize)header->height;
    g_autofree float *rgb = g_new(float, n);
    *ret_holes = bonn_views_picture(imported->views, view, light, rgb);
    if (!ret_planes)
        return TRUE;
    multiply_cosine(header, light, rgb);
    for (int y = 0; y < region->height; y++)
        for (int x = 0; x < region->width; x++) {
            const gsize from =
                (gsize)(region->y + y) * (gsize)header->width + (gsize)(region->x + x);
            for (gsize c = 0; c < 3; c++)
                ret_planes[c][y * region->width + x] = rgb[3 * from + c];
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
    struct imported imported = {.file = btf, .n_threads = work ? work->n_threads : 0};
    struct import_material material = {
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
        .data = &imported,
    };
    if (header->kind == BONN_BDI || header->kind == BONN_BDI_SPARSE) {
        const gsize view = (gsize)header->width * (gsize)header->height * (gsize)header->n_lights *
                           BONN_CHANNELS * sizeof(guint16);
        material.n_together = (int)CLAMP(VIEWS_MEMORY / MAX(view, 1), 1, MAX_TOGETHER);
        material.load = load;
        material.picture = give_picture;
        material.black_holes = TRUE;
    }
    const gboolean ok = import_material(path, &material, work, ret, error);
    bonn_views_free(imported.views);
    return ok;
}
