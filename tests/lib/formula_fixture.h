/* Pictures of small materials against a plain evaluation of the formula, pixel by pixel. */
#pragma once

#include "gpu_fixture.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <math.h>

#define SIZE 96

/* What a pixel should be, from texel coordinates and directions as viewer_render_geometry() gives
 * them; FALSE where rounding may pick other texels or directions. */
typedef gboolean (*Expected)(gconstpointer data, const float *at, const float *v, const float *l,
                             double ret[3]);

static inline void compare_picture(Expected func, gconstpointer data, Viewer *viewer,
                                   const struct viewer_settings *settings) {
    g_autoptr(GError) error = NULL;
    g_autofree float *shown = viewer_render_linear(viewer, settings, SIZE, SIZE, &error);
    g_assert_no_error(error);
    float *given[3];
    for (int k = 0; k < 3; k++) {
        given[k] =
            viewer_render_geometry(viewer, settings, (enum viewer_geometry)k, SIZE, SIZE, &error);
        g_assert_no_error(error);
    }
    int n = 0, wrong = 0;
    double worst = 0;
    for (gsize k = 0; k < 4 * SIZE * SIZE; k += 4) {
        double want[3], off = 0;
        if (shown[k + 3] <= 0 || given[0][k + 2] <= 0 ||
            !func(data, given[0] + k, given[1] + k, given[2] + k, want))
            continue;
        for (int c = 0; c < 3; c++)
            off = fmax(off, fabs(shown[k + c] - want[c]) / fmax(want[c], 1));
        n++;
        wrong += off > 1.0 / 255;
        worst = fmax(worst, off);
    }
    g_test_message("%d pixels, worst error %.4f, beyond a step of 8 bits: %d", n, worst, wrong);
    g_assert_cmpint(n, >, 1000);
    g_assert_cmpint(wrong, ==, 0);
    for (int k = 0; k < 3; k++)
        g_free(given[k]);
}

static void start_view(Viewer *viewer, struct viewer_settings *settings, const struct mesh *mesh) {
    g_autoptr(GError) error = NULL;
    viewer_set_mesh(viewer, mesh, &error);
    g_assert_no_error(error);
    *settings = viewer_settings_default;
    settings->camera_distance = 3;
    settings->tiles_u = 3;
    settings->tiles_v = 2;
    settings->light_theta_deg = 30;
}
