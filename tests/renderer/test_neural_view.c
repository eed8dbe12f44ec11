/* Pictures of neural planes against neural_formula_point() and libmesorig-material, pixel by pixel.
 */
#include "base/direction.h"
#include "btf/direction_grid.h"
#include "drawing/methods/neural_view.h"
#include "lib/formula_fixture.h"
#include "lib/neural_fixture.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "metrics/delta_e.h"

#include <mesorig/material.h>
#include <string.h>

#define TEXELS 24
#define DEEP   0.8 /* mm; a texel is 0.5 mm */
#define MARGIN 6   /* texels at the edge, at which the even sky is computed without repeats */
#define SKY    16  /* lights of the sky in each of two dimensions */

/* One light, or the mean over an even sky. */
static void expected(const struct neural *neural, const float *at, const float *v, const float *l,
                     gboolean sky, double ret[3]) {
    const double x = ((double)at[0] - floor((double)at[0])) * (double)neural->layout.width;
    const double y = ((double)at[1] - floor((double)at[1])) * (double)neural->layout.height;
    const double view[3] = {(double)v[0], (double)v[1], (double)v[2]};
    memset(ret, 0, 3 * sizeof *ret);
    for (int k = 0; k < (sky ? SKY * SKY : 1); k++) {
        float d[3] = {l[0], l[1], l[2]};
        double rgb[3];
        const int row = k / SKY, column = k % SKY;
        if (sky)
            direction_grid_direction((column + 0.5) / SKY, (row + 0.5) / SKY, d);
        const double light[3] = {(double)d[0], (double)d[1], (double)d[2]};
        neural_formula_point(neural, x, y, view, light, rgb);
        for (int c = 0; c < 3; c++)
            ret[c] += rgb[c] * (sky ? 2.0 / (SKY * SKY) : light[2] > 0);
    }
}

/* Whether the pixel shows a place away from the edges of a tile by a margin, at mip level 0: its
 * neighbours are closer than 2^(1/4) texels. */
static gboolean counts(const float *at, float margin, gsize k) {
    gboolean ret = at[k + 3] > 0;
    for (int c = 0; c < 2; c++) {
        const float place = (at[k + c] - floorf(at[k + c])) * TEXELS;
        ret &= place >= margin && place <= TEXELS - margin;
    }
    const gsize steps[] = {4, 4 * SIZE};
    for (int i = 0; i < 2; i++)
        for (int sign = 0; sign < 2; sign++) {
            const gsize next = sign ? k - steps[i] : k + steps[i];
            const float apart = hypotf(at[next] - at[k], at[next + 1] - at[k + 1]) * TEXELS;
            ret &= at[next + 3] > 0 && apart < 1.18F;
        }
    return ret;
}

/* Draws the model and compares a pixel in every `step`. Returns the largest difference, in ΔE00. */
static double difference(const struct neural *neural, Viewer *view,
                         const struct viewer_settings *settings, int step) {
    g_autofree float *shown = ok(viewer_render_linear(view, settings, SIZE, SIZE, ERR));
    float *given[3];
    double sum = 0, worst = 0;
    int n = 0;
    for (int k = 0; k < 3; k++)
        given[k] =
            ok(viewer_render_geometry(view, settings, (enum viewer_geometry)k, SIZE, SIZE, ERR));
    for (gsize k = 4 * (SIZE + 1); k < 4 * (SIZE - 1) * SIZE; k += 4 * (gsize)step) {
        double want[3], lab[2][3];
        if (shown[k + 3] <= 0 || given[1][k + 2] < 0.2F ||
            !counts(given[0], settings->ambient > 0 ? MARGIN : 0, k))
            continue;
        expected(neural, given[0] + k, given[1] + k, given[2] + k, settings->ambient > 0, want);
        delta_e_lab(shown + k, lab[0]);
        delta_e_lab((float[]){(float)want[0], (float)want[1], (float)want[2]}, lab[1]);
        const double apart = delta_e_2000(lab[0], lab[1]);
        worst = fmax(worst, apart);
        sum += apart;
        n++;
    }
    g_assert_cmpint(n, >, 700 / step);
    g_test_message("%d channels: %d pixels, ΔE00 %.3f on average, at most %.3f", neural->n_channels,
                   n, sum / n, worst);
    for (int k = 0; k < 3; k++)
        g_free(given[k]);
    return worst;
}

/* A view of the model through a file with mip levels, as the viewer opens it. */
static Viewer *open_view(struct neural *neural, const struct mesh *mesh,
                         struct viewer_settings *settings) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "neural.exr", NULL);
    struct neural *levels[] = {neural, neural_halved(neural)};
    Viewer *view = ok(viewer_new(NULL, ERR));
    ok(neural_write(path, levels, 2, ERR));
    ok(viewer_open(view, &method_neural, path, ERR));
    neural_free(levels[1]);
    formula_start_view(view, settings, mesh);
    settings->ambient = 0;
    settings->tiles_u = settings->tiles_v = 1;
    return view;
}

static void compare(int n_channels, double deep_mm, const struct mesh *mesh) {
    static const double lights_deg[][2] = {{20, 70}, {55, 200}, {75, 320}};
    struct neural *neural = neural_fixture_new(TEXELS, TEXELS, n_channels, deep_mm, 7);
    struct viewer_settings settings;
    g_autoptr(Viewer) view = open_view(neural, mesh, &settings);
    settings.camera_elevation_deg = 50;
    for (gsize k = 0; k < G_N_ELEMENTS(lights_deg); k++) {
        settings.light_theta_deg = lights_deg[k][0];
        settings.light_phi_deg = lights_deg[k][1];
        g_assert_cmpfloat(difference(neural, view, &settings, 1), <, 0.5);
    }
    neural_free(neural);
}

GPU_TEST(formula) {
    g_autoptr(Mesh) plane = scene_plane();
    compare(12, DEEP, plane);
    compare(4, DEEP, plane);
    compare(8, 0, plane);
    compare(16, DEEP / 4, plane);
}

/* Under an even sky alone. The shader has 16 lights and nine views. */
GPU_TEST(sky) {
    g_autoptr(Mesh) plane = scene_plane();
    struct neural *neural = neural_fixture_new(TEXELS, TEXELS, 12, DEEP, 7);
    struct viewer_settings settings;
    g_autoptr(Viewer) view = open_view(neural, plane, &settings);
    settings.ambient = 1;
    settings.lamp = 0;
    settings.camera_elevation_deg = 50;
    g_assert_cmpfloat(difference(neural, view, &settings, 11), <, 5);
    neural_free(neural);
}

/* The longer side of a pixel, in tiles. at points to the pixel's place in a picture of places. */
static float footprint_of(const float *at) {
    const float *right = at + 4, *below = at + (gsize)4 * SIZE;
    return fmaxf(hypotf(right[0] - at[0], right[1] - at[1]),
                 hypotf(below[0] - at[0], below[1] - at[1]));
}

/* Returns the mean difference between a picture and the library, in ΔE00, and gives the share of
 * the pixels that differ by more than 0.5. */
static double differ(Viewer *view, const struct viewer_settings *settings,
                     const mesorig_material *material, double *ret_share) {
    g_autofree float *shown = ok(viewer_render_linear(view, settings, SIZE, SIZE, ERR));
    float *given[3];
    double sum = 0, pixel_texels = 0;
    int n = 0, above = 0;
    for (int k = 0; k < 3; k++)
        given[k] =
            ok(viewer_render_geometry(view, settings, (enum viewer_geometry)k, SIZE, SIZE, ERR));
    for (gsize k = 4 * (SIZE + 1); k < 4 * (SIZE - 1) * SIZE; k += 4) {
        float rgb[3];
        double lab[2][3];
        if (shown[k + 3] <= 0 || given[0][k + 7] <= 0 || given[0][k + 4 * SIZE + 3] <= 0)
            continue;
        const float footprint = footprint_of(given[0] + k);
        g_assert_cmpint(mesorig_material_evaluate(material, 1, given[0] + k, given[1] + k,
                                                  given[2] + k, &footprint, rgb),
                        ==, MESORIG_OK);
        delta_e_lab(shown + k, lab[0]);
        delta_e_lab(rgb, lab[1]);
        const double apart = delta_e_2000(lab[0], lab[1]);
        above += apart > 0.5;
        pixel_texels += (double)footprint * TEXELS;
        sum += apart;
        n++;
    }
    g_assert_cmpint(n, >, 100);
    *ret_share = (double)above / n;
    g_test_message("pixels of %.2f texels: ΔE00 %.3f on average, above 0.5 in %.2f %%",
                   pixel_texels / n, sum / n, 100 * *ret_share);
    for (int k = 0; k < 3; k++)
        g_free(given[k]);
    return sum / n;
}

/* The library draws as the viewer does: points of the material, and mip levels, which this file
 * lacks. */
GPU_TEST(library) {
    g_autoptr(Mesh) plane = scene_plane();
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "neural.exr", NULL);
    struct neural *neural = neural_fixture_new(TEXELS, TEXELS, 8, DEEP / 2, 7);
    struct viewer_settings settings;
    double share;
    ok(neural_write(path, &neural, 1, ERR));
    g_autoptr(Viewer) view = open_view(neural, plane, &settings);
    mesorig_material *material = mesorig_material_open(path, NULL, NULL);
    g_assert_nonnull(material);
    settings.camera_elevation_deg = 60;
    settings.light_theta_deg = 40;
    settings.light_phi_deg = 110;
    /* A ray that touches an edge may miss it on one of the two. */
    g_assert_cmpfloat(differ(view, &settings, material, &share), <, 0.05);
    g_assert_cmpfloat(share, <, 0.002);
    settings.tiles_u = settings.tiles_v = 6;
    g_assert_cmpfloat(differ(view, &settings, material, &share), <, 0.5);
    mesorig_material_close(material);
    neural_free(neural);
}

GPU_TEST(bad) {
    g_autoptr(GError) error = NULL;
    struct neural *whole = neural_fixture_new(TEXELS, TEXELS, 12, DEEP, 7);
    struct neural *other = neural_fixture_new(TEXELS / 2, TEXELS, 12, DEEP, 7);
    struct neural *const levels[] = {whole, other};
    g_assert_null(neural_view_new(levels, 2, &error));
    g_assert_nonnull(strstr(error->message, "mip level 1 (12 × 24 texels of 12 channels)"));
    neural_free(whole);
    neural_free(other);
}
