#include "formula_fixture.h"
#include "lib/ok.h"

void formula_compare(Expected func, gconstpointer data, Viewer *view,
                     const struct viewer_settings *settings) {
    g_autofree float *shown = ok(viewer_render_linear(view, settings, SIZE, SIZE, ERR));
    float *given[3];
    for (int k = 0; k < 3; k++) {
        given[k] =
            ok(viewer_render_geometry(view, settings, (enum viewer_geometry)k, SIZE, SIZE, ERR));
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

void formula_start_view(Viewer *view, struct viewer_settings *settings, const struct mesh *mesh) {
    ok(viewer_set_mesh(view, mesh, ERR));
    *settings = viewer_settings_default;
    settings->camera_distance = 3;
    settings->tiles_u = 3;
    settings->tiles_v = 2;
    settings->light_theta_deg = 30;
}
