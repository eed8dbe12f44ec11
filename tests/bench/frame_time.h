/* How long pictures take. */
#pragma once

#include "quantile.h"
#include "renderer/gpu.h"
#include "renderer/view.h"

#include <string.h>
#include <time.h>

/* Microseconds: of the processor where that draws, so that other programs do not count. */
static double now_us(void) {
    if (strstr(gpu_renderer(), "llvmpipe"))
        return (double)clock() * 1e6 / CLOCKS_PER_SEC;
    return (double)g_get_monotonic_time();
}

/* Median milliseconds a frame, camera and light moving. */
static gboolean time_frames(View *view, const struct view_settings *settings, int frames,
                            double *ret_ms, GError **error) {
    struct view_settings s = *settings;
    g_autofree double *ms = g_new0(double, frames);
    struct gpu_target target = {0};
    gboolean good = gpu_target_resize(&target, 800, 600, 0x8058 /* GL_RGBA8 */, FALSE, error);
    for (int k = -1; good && k < frames; k++) {
        s.camera_azimuth_deg = 40 + 7 * k;
        s.light_phi_deg = 100 - 11 * k;
        const double start = now_us();
        good = view_draw(view, &s, target.framebuffer, 800, 600, error);
        view_finish();
        ms[MAX(k, 0)] = (now_us() - start) * 1e-3;
    }
    gpu_target_clear(&target);
    *ret_ms = quantile(ms, frames, 0.5);
    return good;
}
