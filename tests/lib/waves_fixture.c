#include "waves_fixture.h"

struct btf_matrix *waves_fixture_new(int width, int height, int n_views, int n_lights, double noise,
                                     gboolean constant) {
    struct btf_matrix *btf = btf_fixture_new("waves", width, height, n_views, n_lights);
    const int values = n_views * n_lights * 3;
    GRand *random = g_rand_new_with_seed(3);
    for (int i = 0; i < width * height * values; i++) {
        const int x = i / values % width, y = i / values / width, c = i % 3;
        const double v = i / (3 * n_lights) % n_views / (double)n_views;
        const double l = i / 3 % n_lights / (double)n_lights;
        const double slope = constant ? 0.1 : 0.4 * sin(0.6 * x) * cos(0.3 * y + 0.5 * v);
        const double light = fmax(0, 0.8 * (1 - 0.5 * l) + slope * (l - 0.3));
        const double gloss = pow(fmax(0, 1 - fabs(v - l - slope)), 12);
        btf->values[i] = (float)(light * (0.5 + 0.2 * c * (x < 12 || constant)) + 0.4 * gloss +
                                 noise * g_rand_double_range(random, -1, 1));
    }
    g_rand_free(random);
    return btf;
}
