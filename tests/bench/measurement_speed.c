#include "measurement_parts.h"

#include "exr/exr.h"
#include "frames/rectify.h"

#include <glib/gstdio.h>
#include <unistd.h>

#define FRAMES 12

static double since_ms(gint64 start_us) {
    return (double)(g_get_monotonic_time() - start_us) / 1e3;
}

struct bench_speed bench_speed(const struct bench_setup *setup, int view) {
    struct rig rig;
    bench_rig(setup, &rig);
    struct session_grid grid = bench_grid(setup);
    g_autofree char *path = NULL;
    int file = g_file_open_tmp("mesorig-bench-XXXXXX.exr", &path, NULL);
    g_assert_cmpint(file, >=, 0);
    close(file);
    bench_write_frame(path, &rig.cameras[view]);
    g_autofree float *rgb = g_new(float, 3 * grid.width * grid.height);
    g_autofree float *detail = g_new(float, 3 * grid.width * grid.height);
    g_autofree float *shift = g_new(float, 3 * grid.width * grid.height);
    struct bench_speed speed = {0};
    gint64 start = g_get_monotonic_time();
    g_autoptr(Rectify) rectify = rectify_new(&rig.cameras[view], NULL, "rggb", 0.4, &grid, NULL);
    speed.prepare_ms = since_ms(start);
    for (int i = 0; i < FRAMES; i++) {
        start = g_get_monotonic_time();
        struct exr_file *read = exr_read(path, NULL);
        speed.decode_ms += since_ms(start) / FRAMES;
        const float *mosaic = exr_part_plane(exr_file_part(read, "radiance"), "Y");
        start = g_get_monotonic_time();
        if (i == 0) {
            rectify_guide(rectify, mosaic);
            speed.guide_ms = since_ms(start);
        }
        start = g_get_monotonic_time();
        rectify_apply(rectify, mosaic, rgb, NULL);
        speed.rectify_ms += since_ms(start) / FRAMES;
        start = g_get_monotonic_time();
        rectify_errors(rectify, mosaic, mosaic, rgb, detail, shift);
        speed.errors_ms += since_ms(start) / FRAMES;
        exr_file_free(read);
    }
    g_unlink(path);
    return speed;
}
