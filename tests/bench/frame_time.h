/* How long pictures take. */
#pragma once

#include "bench.h"
#include "drawing/gl/gpu.h"
#include "scene/viewer.h"

#include <string.h>
#include <time.h>

/* Time in microseconds. If the CPU draws, this is CPU time, so that other programs do not count. */
static double now_us(void) {
    if (strstr(gpu_renderer(), "llvmpipe"))
        return (double)clock() * 1e6 / CLOCKS_PER_SEC;
    return (double)g_get_monotonic_time();
}

/* Median milliseconds per frame of each view, while camera and light move. The views are drawn
 * alternately, frame by frame, so that other work of the machine affects all of them. settings: one
 * for each view. ret_times: median of how many times as long each takes as the last of them for the
 * same frame; or NULL. */
static inline gboolean time_in_turns(Viewer *const *viewers, const struct viewer_settings *settings,
                                     int n, int frames, double *ret_ms, double *ret_times,
                                     GError **error) {
    g_autofree double *ms = g_new0(double, (gsize)n *frames);
    struct gpu_target target = {0};
    gboolean good = gpu_target_resize(&target, 800, 600, 0x8058 /* GL_RGBA8 */, FALSE, error);
    for (int k = -1; good && k < frames; k++)
        for (int i = 0; good && i < n; i++) {
            const int v = (i + k + 1) % n; /* who comes first finds other things in the caches */
            struct viewer_settings s = settings[v];
            s.camera_azimuth_deg = 40 + 7 * k;
            s.light_phi_deg = 100 - 11 * k;
            const double start = now_us();
            good = viewer_draw(viewers[v], &s, target.framebuffer, 800, 600, error);
            viewer_finish();
            ms[v * frames + MAX(k, 0)] = (now_us() - start) * 1e-3;
        }
    gpu_target_clear(&target);
    for (int v = 0; v < n && ret_times; v++) {
        g_autofree double *times = g_new(double, frames);
        for (int k = 0; k < frames; k++)
            times[k] = ms[v * frames + k] / ms[(n - 1) * frames + k];
        ret_times[v] = bench_time_quantile(times, frames, 0.5);
    }
    for (int v = 0; v < n; v++)
        ret_ms[v] = bench_time_quantile(ms + (gsize)v * frames, frames, 0.5);
    return good;
}
