/* Random directions and lights of plain materials and of the sky. Sums over the drawn directions
 * are compared with sums over evenly distributed ones. */
#include "lib/test.h"
#include "scene/environment_made.h"
#include "tracer/trace_plain.h"
#include "tracer/trace_random.h"
#include "tracer/trace_sky.h"

#include <glib.h>
#include <math.h>

static const struct trace_plain plains[] = {
    {{1, 1, 1}, 0, 1, 0},         {{1, 1, 1}, 0, 1, 1},         {{1, 1, 1}, 0, 0.3, 1},
    {{1, 1, 1}, 1, 0.2, 1},       {{1, 1, 1}, 1, 1, 1},         {{1, 1, 1}, 0.5, 0.5, 1},
    {{0.8, 0.4, 0.1}, 1, 0.6, 1}, {{0.2, 0.5, 0.7}, 0, 0.4, 1},
};

static struct vec3 at_deg(double theta, double phi) {
    theta *= G_PI / 180;
    phi *= G_PI / 180;
    return vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
}

static double numbers(struct trace_random *random, double ret[3]) {
    for (int k = 0; k < 3; k++)
        ret[k] = trace_random_next(random);
    return ret[0];
}

/* Sums over a grid of the hemisphere: the density's, and the albedo in R. */
static void integrate(const struct trace_plain *plain, struct vec3 view, double *ret_density,
                      double *ret_albedo) {
    enum { N = 500 };
    *ret_density = *ret_albedo = 0.0;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            const double z = (i + 0.5) / N, flat = sqrt(1 - z * z), phi = 2 * G_PI * (j + 0.5) / N;
            const struct vec3 light = vec3(flat * cos(phi), flat * sin(phi), z);
            double rgb[3];
            trace_plain_evaluate(plain, view, light, rgb);
            *ret_albedo += rgb[0] * 2 * G_PI / (N * N);
            *ret_density += trace_plain_density(plain, view, light) * 2 * G_PI / (N * N);
        }
}

/* No material reflects more than it receives, and the white diffuser reflects all. Densities sum to
 * 1, less what a microfacet would send below the horizon. */
TEST(energy) {
    for (gsize k = 0; k < G_N_ELEMENTS(plains); k++)
        for (double theta = 5; theta < 89; theta += 14) {
            double density, albedo;
            integrate(&plains[k], at_deg(theta, 30), &density, &albedo);
            g_assert_cmpfloat(albedo, <, 1.001);
            g_assert_cmpfloat(density, <, 1.002);
            if (k == 0) {
                g_assert_cmpfloat_with_epsilon(albedo, 1.0, 1e-5);
                g_assert_cmpfloat_with_epsilon(density, 1.0, 1e-5);
            }
            if (plains[k].roughness < 0.4 && theta < 60)
                g_assert_cmpfloat(density, >, 0.99);
            if (k == 3 && theta < 60) /* a smooth white metal loses little */
                g_assert_cmpfloat(albedo, >, 0.98);
        }
}

/* f (v, l) = f (l, v) */
TEST(reciprocity) {
    for (gsize k = 0; k < G_N_ELEMENTS(plains); k++)
        for (int i = 0; i < 50; i++) {
            const struct vec3 a = at_deg(1.7 * i, 40 * i), b = at_deg(85 - 1.6 * i, 73 * i);
            double there[3], back[3];
            trace_plain_evaluate(&plains[k], a, b, there);
            trace_plain_evaluate(&plains[k], b, a, back);
            for (int c = 0; c < 3; c++)
                g_assert_cmpfloat_with_epsilon(there[c] * a.z, back[c] * b.z,
                                               1e-9 * (1 + there[c]));
        }
}

/* The mean over drawn directions is the integral; the density of each is that which is said. */
TEST(draw) {
    enum { N = 40000 };
    for (gsize k = 0; k < G_N_ELEMENTS(plains); k++)
        for (int i = 0; i < 2; i++) {
            const struct vec3 view = at_deg(i == 0 ? 15 : 65, 200);
            struct trace_random random = trace_random_new(3, k, (guint64)i);
            double density, albedo, sum = 0.0, squares = 0.0, three[3];
            integrate(&plains[k], view, &density, &albedo);
            for (int n = 0; n < N; n++) {
                struct vec3 light;
                double rgb[3];
                numbers(&random, three);
                const double p = trace_plain_draw(&plains[k], view, three, &light);
                if (!(p > 0.0))
                    continue;
                g_assert_cmpfloat_with_epsilon(vec3_length(light), 1.0, 1e-6);
                trace_plain_evaluate(&plains[k], view, light, rgb);
                sum += rgb[0] / p;
                squares += rgb[0] / p * rgb[0] / p;
            }
            const double mean = sum / N, error = sqrt((squares / N - mean * mean) / N);
            g_assert_cmpfloat_with_epsilon(mean, albedo, 4 * error + 1e-3);
        }
}

/* The sky's density sums to 1 over the sphere and is that of drawn directions; its light is that of
 * the formula: the overcast sky gives π on the ground, and half of its ground's on what faces down.
 */
TEST(sky) {
    enum { N = 400, DRAWN = 20000 };
    static const char *const names[] = {"studio", "overcast"};
    for (int k = 0; k < 2; k++) {
        struct environment *made = environment_make(names[k]);
        g_autoptr(TraceSky) sky = trace_sky_new(made, 35.0), straight = trace_sky_new(made, 0.0);
        struct trace_random random = trace_random_new(9, 0, (guint64)k);
        int differ = 0;
        double density = 0.0, sums[3] = {0.0}, drawn[3] = {0.0}, squares = 0.0;
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) {
                const double z = -1 + 2 * (i + 0.5) / N, phi = 2 * G_PI * (j + 0.5) / N;
                const struct vec3 d =
                    vec3(sqrt(1 - z * z) * cos(phi), sqrt(1 - z * z) * sin(phi), z);
                double rgb[3], turned[3];
                trace_sky_radiance(sky, d, rgb);
                density += trace_sky_density(sky, d) * 4 * G_PI / (N * N);
                for (int c = 0; c < 3; c++)
                    sums[c] += rgb[c] * fmax(z, 0) * 4 * G_PI / (N * N);
                const double back = phi - 35 * G_PI / 180;
                trace_sky_radiance(
                    straight, vec3(sqrt(1 - z * z) * cos(back), sqrt(1 - z * z) * sin(back), z),
                    turned);
                differ += rgb[0] != turned[0];
            }
        /* 35° is no whole number of pixels: those at the edges of the boxes may differ. */
        g_assert_cmpint(differ, <, N * N / 100);
        g_assert_cmpfloat_with_epsilon(density, 1.0, k == 0 ? 0.02 : 0.002);
        for (int n = 0; n < DRAWN; n++) {
            const double two[2] = {trace_random_next(&random), trace_random_next(&random)};
            double rgb[3];
            struct vec3 d;
            const double p = trace_sky_draw(sky, two, &d, rgb);
            g_assert_cmpfloat(p, >, 0.0);
            g_assert_cmpfloat_with_epsilon(vec3_length(d), 1.0, 1e-9);
            for (int c = 0; c < 3; c++)
                drawn[c] += rgb[c] * fmax(d.z, 0) / p / DRAWN;
            squares += pow(rgb[1] * fmax(d.z, 0) / p, 2.0) / DRAWN;
        }
        const double error = sqrt((squares - drawn[1] * drawn[1]) / DRAWN);
        g_assert_cmpfloat_with_epsilon(drawn[1], sums[1], 4 * error + 0.01 * sums[1]);
        if (k == 1)
            g_assert_cmpfloat_with_epsilon(drawn[1], G_PI, 4 * error + 0.005);
        environment_free(made);
    }
}

/* Drawn directions lie in the pixel whose radiance and density they come with. */
TEST(sky_pixels) {
    struct environment *made = environment_make("studio");
    g_autoptr(TraceSky) sky = trace_sky_new(made, -71.0);
    struct trace_random random = trace_random_new(4, 5, 6);
    int off = 0;
    for (int n = 0; n < 5000; n++) {
        const double two[2] = {trace_random_next(&random), trace_random_next(&random)};
        double drawn[3], seen[3];
        struct vec3 d;
        const double p = trace_sky_draw(sky, two, &d, drawn);
        trace_sky_radiance(sky, d, seen);
        off += drawn[0] != seen[0] || p != trace_sky_density(sky, d);
    }
    g_assert_cmpint(off, <=, 2); /* on the edge of a pixel rounding decides */
    float black[6] = {0};
    const struct environment none = {2, 1, black};
    g_assert_null(trace_sky_new(&none, 0.0));
    environment_free(made);
}
