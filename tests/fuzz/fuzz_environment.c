/* Environment maps of mesorig-view and mesorig-trace: the lamps that stand for one, and the sky
 * that rays reach. */
#include "fuzz.h"

#include "scene/environment.h"
#include "tracer/trace_sky.h"

#include <math.h>
#include <string.h>

static void check_lamps(const struct environment *environment) {
    static const int numbers[] = {1, 7, VIEWER_MAX_LAMPS};
    for (gsize k = 0; k < G_N_ELEMENTS(numbers); k++) {
        struct viewer_lamp lamps[VIEWER_MAX_LAMPS];
        const int n = environment_lamps(environment->rgb, environment->width, environment->height,
                                        numbers[k], lamps);
        g_assert_cmpint(n, >=, 0);
        g_assert_cmpint(n, <=, numbers[k]);
        for (int i = 0; i < n; i++) {
            g_assert_true(lamps[i].theta_deg >= 0 && lamps[i].theta_deg <= 180);
            g_assert_true(isfinite(lamps[i].phi_deg));
            for (int c = 0; c < 3; c++)
                g_assert_true(isfinite(lamps[i].rgb[c]) && lamps[i].rgb[c] >= 0);
        }
    }
}

static void check_sky(const struct environment *environment) {
    g_autoptr(TraceSky) sky = trace_sky_new(environment, 30);
    for (int i = 0; sky && i < 16; i++) {
        const double random[2] = {(i + 0.5) / 16, fmod(i * 0.618, 1)};
        struct vec3 towards = {0};
        double rgb[3];
        const double density = trace_sky_draw(sky, random, &towards, rgb);
        g_assert_true(isfinite(density) && density >= 0);
        g_assert_true(isfinite(towards.x) && isfinite(towards.y) && isfinite(towards.z));
        for (int c = 0; c < 3; c++)
            g_assert_true(isfinite(rgb[c]) && rgb[c] >= 0);
        g_assert_true(isfinite(trace_sky_density(sky, towards)));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    GError *error = NULL;
    struct environment *environment = environment_read(fuzz_file(data, size), &error);
    fuzz_check(environment != NULL, &error);
    if (!environment)
        return 0;
    g_assert_cmpint(environment->width, ==, 2 * environment->height);
    check_lamps(environment);
    check_sky(environment);
    environment_free(environment);
    return 0;
}
