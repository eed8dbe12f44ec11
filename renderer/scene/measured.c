#include "measured.h"

#include "base/direction.h"
#include "camera.h"

#include <math.h>
#include <string.h>

#define GAIN   4
#define PANELS 3

static int nearest(const float *theta_deg, const float *phi_deg, int n, const float wanted[3]) {
    int best = 0;
    double most = -2.0;
    for (int k = 0; k < n; k++) {
        float d[3];
        direction_from_deg(theta_deg[k], phi_deg[k], d);
        const double dot = d[0] * wanted[0] + d[1] * wanted[1] + d[2] * wanted[2];
        if (dot > most) {
            most = dot;
            best = k;
        }
    }
    return best;
}

/* Reads the measured picture as RGBA, in the form in which the viewer draws. */
static float *read_measured(const Reference *reference, const struct measured *m, GError **error) {
    const struct reference_info info = reference_info(reference);
    const gsize texels = (gsize)info.width * info.height;
    g_autofree float *all = g_try_new(float, 3 * texels * info.n_lights);
    g_autofree float *rgba = g_new(float, 4 * texels);
    if (all == NULL) {
        g_set_error(error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT,
                    "a view of %d lights and %d × %d texels needs %.1f GiB of memory, which the "
                    "system refused; close other programs",
                    info.n_lights, info.width, info.height,
                    3.0 * sizeof(float) * texels * info.n_lights / (1 << 30));
        return NULL;
    }
    if (!reference_read_view(reference, m->view, all, error))
        return NULL;
    for (gsize k = 0; k < texels; k++) {
        memcpy(rgba + 4 * k, all + 3 * (texels * m->light + k), 3 * sizeof(float));
        rgba[4 * k + 3] = 1.0f;
    }
    return g_steal_pointer(&rgba);
}

static double relative_error(const float *drawn, const float *measured, gsize texels) {
    double off = 0.0, all = 0.0;
    for (gsize k = 0; k < 4 * texels; k++) {
        if (k % 4 == 3)
            continue;
        off += ((double)drawn[k] - measured[k]) * ((double)drawn[k] - measured[k]);
        all += (double)measured[k] * measured[k];
    }
    return all > 0.0 ? sqrt(off / all) : 0.0;
}

static void fill(const struct reference_info *info, int scale, const guint8 *measured,
                 const guint8 *drawn, struct measured *ret) {
    const int panel = info->width * scale;
    ret->width = PANELS * panel;
    ret->height = info->height * scale;
    ret->rgb = g_malloc(3 * (gsize)ret->width * ret->height);
    for (int j = 0; j < ret->height; j++)
        for (int i = 0; i < ret->width; i++) {
            const int row = j / scale, column = i % panel / scale;
            const gsize from = 3 * ((gsize)row * info->width + column);
            guint8 *to = ret->rgb + 3 * ((gsize)j * ret->width + i);
            for (int c = 0; c < 3; c++) {
                const int a = measured[from + c], b = drawn[from + c];
                const int values[PANELS] = {a, b, CLAMP(128 + GAIN * (b - a), 0, 255)};
                to[c] = (guint8)values[i / panel];
            }
        }
}

gboolean measured_compare(const Reference *reference, Viewer *viewer,
                          const struct viewer_settings *settings, int width, struct measured *ret,
                          GError **error) {
    const struct reference_info info = reference_info(reference);
    struct viewer_settings s = *settings;
    float to_view[3], to_light[3];
    *ret = (struct measured){0};
    s.samples = 1;
    s.style.nearest = TRUE;
    direction_from_deg(90.0 - s.camera_elevation_deg, s.camera_azimuth_deg, to_view);
    direction_from_deg(s.light_theta_deg, s.light_phi_deg, to_light);
    ret->view = nearest(info.view_theta_deg, info.view_phi_deg, info.n_views, to_view);
    ret->light = nearest(info.light_theta_deg, info.light_phi_deg, info.n_lights, to_light);
    ret->view_theta_deg = info.view_theta_deg[ret->view];
    ret->view_phi_deg = info.view_phi_deg[ret->view];
    ret->light_theta_deg = info.light_theta_deg[ret->light];
    ret->light_phi_deg = info.light_phi_deg[ret->light];
    direction_from_deg(ret->view_theta_deg, ret->view_phi_deg, to_view);
    direction_from_deg(ret->light_theta_deg, ret->light_phi_deg, to_light);
    g_autofree float *measured = read_measured(reference, ret, error);
    g_autofree float *drawn = measured != NULL ? viewer_render_flat(viewer, &s, to_view, to_light,
                                                                    info.width, info.height, error)
                                               : NULL;
    if (drawn == NULL)
        return FALSE;
    ret->error = relative_error(drawn, measured, (gsize)info.width * info.height);
    g_autofree guint8 *a = viewer_resolve(viewer, &s, measured, info.width, info.height, error);
    g_autofree guint8 *b =
        a != NULL ? viewer_resolve(viewer, &s, drawn, info.width, info.height, error) : NULL;
    if (b == NULL)
        return FALSE;
    fill(&info, MAX(1, width / (PANELS * info.width)), a, b, ret);
    return TRUE;
}

void measured_clear(struct measured *measured) {
    g_free(measured->rgb);
    *measured = (struct measured){0};
}
