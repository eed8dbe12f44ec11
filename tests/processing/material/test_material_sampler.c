/* Light directions drawn from a material: their density is a density, they follow it, and what is
 * estimated with them is right. The material is a formula, so that nothing depends on files. */
#include "lib/test.h"
#include "material/material_sampler.h"

#include <math.h>
#include <string.h>

#define N_RINGS  5
#define A_RING   12
#define N_ALL    (N_RINGS * A_RING + 1)
#define SIDE     4
#define GRID     9
#define EXPONENT 60.0 /* of the highlight: 9° half width */

struct fixture {
    struct btf_layout layout;
    Directions *views, *lights;
    float *vectors;
    MaterialSampler *sampler;
};

/* A highlight around a normal that tilts to the left in half of the texels and to the right in the
 * others, above a weak diffuser. */
static double fixture_value(int texel, const float v[3], const float l[3]) {
    const double tilt = texel % SIDE < SIDE / 2 ? -0.3 : 0.3;
    double h[3], length = 0.0;
    for (int c = 0; c < 3; c++) {
        h[c] = (double)v[c] + (double)l[c];
        length += h[c] * h[c];
    }
    const double cosine = (h[0] * sin(tilt) + h[2] * cos(tilt)) / sqrt(length);
    return (double)l[2] * (0.05 + 4.0 * pow(fmax(cosine, 0.0), EXPONENT));
}

static void fixture_reconstruct(gconstpointer model, int texel, float *ret) {
    const struct fixture *f = model;
    const gsize n = f->layout.views.n;
    for (gsize v = 0; v < n; v++)
        for (gsize l = 0; l < n; l++)
            for (gsize c = 0; c < 3; c++)
                ret[3 * (v * n + l) + c] =
                    (float)fixture_value(texel, f->vectors + 3 * v, f->vectors + 3 * l);
}

static void fixture_init(struct fixture *f, gboolean grid) {
    memset(f, 0, sizeof *f);
    f->layout.width = f->layout.height = SIDE;
    if (grid) {
        f->layout.views = direction_grid_samples(GRID);
        f->layout.lights = direction_grid_samples(GRID);
    } else {
        f->layout.views = direction_list_new(N_ALL);
        f->layout.lights = direction_list_new(N_ALL);
        for (int k = 1; k < N_ALL; k++) {
            const int ring = (k - 1) / A_RING + 1;
            const float theta = 15.0F * (float)ring;
            const float phi = 360.0F / A_RING * (float)((k - 1) % A_RING);
            f->layout.views.theta_deg[k] = f->layout.lights.theta_deg[k] = theta;
            f->layout.views.phi_deg[k] = f->layout.lights.phi_deg[k] = phi;
        }
        f->views = directions_new(f->layout.views.theta_deg, f->layout.views.phi_deg, N_ALL, NULL);
        f->lights =
            directions_new(f->layout.lights.theta_deg, f->layout.lights.phi_deg, N_ALL, NULL);
    }
    f->vectors = direction_list_vectors(&f->layout.views);
}

static void fixture_sampler(struct fixture *f, gboolean grid) {
    fixture_init(f, grid);
    const struct material_sampler_source source = {
        &f->layout, f->views, f->lights, grid ? GRID : 0, fixture_reconstruct, f, NULL, NULL};
    f->sampler = material_sampler_new(&source);
}

static void fixture_clear(struct fixture *f) {
    material_sampler_free(f->sampler);
    direction_list_clear(&f->layout.views);
    direction_list_clear(&f->layout.lights);
    directions_free(f->views);
    directions_free(f->lights);
    g_free(f->vectors);
}

static void direction_of(double theta, double phi, float ret[3]) {
    ret[0] = (float)(sin(theta) * cos(phi));
    ret[1] = (float)(sin(theta) * sin(phi));
    ret[2] = (float)cos(theta);
}

static const double views_deg[][2] = {{0, 0}, {20, 40}, {45, 200}, {75, 310}, {85, 100}};

/* ∫ p dω over rings and sectors of polar angles. */
static double integrate(const struct fixture *f, const float uv[2], const float view[3],
                        float footprint, double z0, double z1, double phi0, double phi1, int n) {
    double sum = 0.0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double z = z0 + (z1 - z0) * (i + 0.5) / n;
            float light[3];
            direction_of(acos(z), phi0 + (phi1 - phi0) * (j + 0.5) / n, light);
            sum += (double)material_sampler_density(f->sampler, uv, view, light, footprint);
        }
    return sum * (z1 - z0) * (phi1 - phi0) / (n * n);
}

static void check_unity(gboolean grid) {
    static const float uv[][3] = {{0.1F, 0.1F, 0.0F}, {0.9F, 0.4F, 0.0F}, {-3.4F, 7.7F, 2.0F}};
    struct fixture f;
    fixture_sampler(&f, grid);
    for (gsize k = 0; k < G_N_ELEMENTS(views_deg); k++) {
        float view[3];
        direction_of(views_deg[k][0] * G_PI / 180, views_deg[k][1] * G_PI / 180, view);
        for (gsize i = 0; i < G_N_ELEMENTS(uv); i++)
            g_assert_cmpfloat_with_epsilon(
                integrate(&f, uv[i], view, uv[i][2], 0.0, 1.0, 0.0, 2 * G_PI, 400), 1.0, 2e-3);
    }
    fixture_clear(&f);
}

TEST(unity) {
    check_unity(FALSE);
    check_unity(TRUE);
}

/* Pearson's χ² of drawn directions against the density's integral over 8 × 16 bins of equal solid
 * angle. Its mean is the number of bins less 1, its standard deviation √(2 · that). The seed is
 * fixed, so that the outcome is. */
TEST(chi_square) {
    enum { RINGS_Z = 8, SECTORS = 16, N = 40000 };
    struct fixture f;
    g_autoptr(GRand) random = g_rand_new_with_seed(5);
    const float uv[2] = {0.8F, 0.3F};
    fixture_sampler(&f, FALSE);
    for (gsize k = 0; k < G_N_ELEMENTS(views_deg); k++) {
        int counts[RINGS_Z][SECTORS] = {{0}}, bins = 0;
        double chi = 0.0;
        float view[3], light[3];
        direction_of(views_deg[k][0] * G_PI / 180, views_deg[k][1] * G_PI / 180, view);
        for (int i = 0; i < N; i++) {
            const float numbers[2] = {(float)(g_rand_int(random) >> 8) * 0x1p-24F,
                                      (float)(g_rand_int(random) >> 8) * 0x1p-24F};
            const float p = material_sampler_draw(f.sampler, uv, view, 0.0F, numbers, light);
            g_assert_cmpfloat(p, ==, material_sampler_density(f.sampler, uv, view, light, 0.0F));
            g_assert_cmpfloat(p, >, 0.0F);
            g_assert_cmpfloat_with_epsilon(
                light[0] * light[0] + light[1] * light[1] + light[2] * light[2], 1.0F, 1e-5F);
            const double turn = atan2((double)light[1], (double)light[0]) / (2 * G_PI);
            counts[MIN((int)((double)light[2] * RINGS_Z), RINGS_Z - 1)]
                  [(int)((turn - floor(turn)) * SECTORS) % SECTORS]++;
        }
        for (int i = 0; i < RINGS_Z; i++)
            for (int j = 0; j < SECTORS; j++) {
                const double expected =
                    N * integrate(&f, uv, view, 0.0F, (double)i / RINGS_Z, (i + 1.0) / RINGS_Z,
                                  2 * G_PI * j / SECTORS, 2 * G_PI * (j + 1) / SECTORS, 40);
                if (expected < 10.0)
                    continue;
                chi += (counts[i][j] - expected) * (counts[i][j] - expected) / expected;
                bins++;
            }
        g_assert_cmpint(bins, >, 100);
        g_assert_cmpfloat(chi, <, bins - 1 + 4.0 * sqrt(2.0 * (bins - 1)));
    }
    fixture_clear(&f);
}

/* The mean of value / (π p) is the albedo ∫ value dω / π, and its variance is far below that of
 * even directions. */
TEST(albedo) {
    enum { N = 20000 };
    struct fixture f;
    g_autoptr(GRand) random = g_rand_new_with_seed(6);
    fixture_sampler(&f, FALSE);
    for (gsize k = 0; k < G_N_ELEMENTS(views_deg); k++) {
        /* Texel 3 of row 1 tilts to the right. */
        const float uv[2] = {0.8F, 0.3F};
        double truth = 0.0, sums[2] = {0.0}, squares[2] = {0.0};
        float view[3], light[3];
        enum { QUADRATURE = 600 };
        direction_of(views_deg[k][0] * G_PI / 180, views_deg[k][1] * G_PI / 180, view);
        for (int i = 0; i < QUADRATURE; i++)
            for (int j = 0; j < QUADRATURE; j++) {
                direction_of(acos((i + 0.5) / QUADRATURE), 2 * G_PI * (j + 0.5) / QUADRATURE,
                             light);
                truth += fixture_value(3, view, light) * 2.0 / QUADRATURE / QUADRATURE;
            }
        for (int i = 0; i < N; i++) {
            const double a = g_rand_double(random), b = g_rand_double(random);
            const float numbers[2] = {(float)(a * 0.999999), (float)(b * 0.999999)};
            const float p = material_sampler_draw(f.sampler, uv, view, 0.0F, numbers, light);
            const double drawn = fixture_value(3, view, light) / (G_PI * (double)p);
            direction_of(acos(a), 2 * G_PI * b, light);
            const double even = 2.0 * fixture_value(3, view, light);
            sums[0] += drawn;
            squares[0] += drawn * drawn;
            sums[1] += even;
            squares[1] += even * even;
        }
        const double mean = sums[0] / N, variance = squares[0] / N - mean * mean;
        const double even = squares[1] / N - pow(sums[1] / N, 2.0);
        g_assert_cmpfloat_with_epsilon(mean, truth, 4.0 * sqrt(variance / N));
        if (k < 3) /* beyond its lowest views a material is no longer what the formula says */
            g_assert_cmpfloat(variance, <, even / 4.0);
    }
    fixture_clear(&f);
}

/* Nothing below the horizon; the largest random numbers. */
TEST(edges) {
    struct fixture f;
    const float uv[2] = {0.2F, 0.2F}, down[3] = {0.6F, 0.0F, -0.8F}, up[3] = {0.0F, 0.0F, 1.0F};
    float light[3];
    fixture_sampler(&f, FALSE);
    g_assert_cmpfloat(material_sampler_density(f.sampler, uv, down, up, 0.0F), ==, 0.0F);
    g_assert_cmpfloat(material_sampler_density(f.sampler, uv, up, down, 0.0F), ==, 0.0F);
    g_assert_cmpfloat(
        material_sampler_draw(f.sampler, uv, down, 0.0F, (const float[]){0.5F, 0.5F}, light), ==,
        0.0F);
    for (int k = 0; k < 25; k++) {
        const float few[5] = {0.0F, 0.0499999F, 0.05F, 0.15F, 0x1.fffffep-1F};
        const float numbers[2] = {few[k % 5], few[k / 5]};
        const float p = material_sampler_draw(f.sampler, uv, up, 0.0F, numbers, light);
        g_assert_true(isfinite(p));
        g_assert_cmpfloat(p, >, 0.0F);
        g_assert_cmpfloat(light[2], >, 0.0F);
    }
    fixture_clear(&f);
}

/* A material without light is drawn from evenly. */
static void black_reconstruct(gconstpointer model, int texel, float *ret) {
    memset(ret, 0, 3 * (gsize)N_ALL * N_ALL * sizeof *ret);
}

TEST(black) {
    struct fixture f;
    fixture_init(&f, FALSE);
    const struct material_sampler_source source = {&f.layout,         f.views, f.lights, 0,
                                                   black_reconstruct, NULL,    NULL,     NULL};
    f.sampler = material_sampler_new(&source);
    const float uv[2] = {0.2F, 0.2F}, up[3] = {0.0F, 0.0F, 1.0F};
    g_assert_cmpfloat_with_epsilon(integrate(&f, uv, up, 0.0F, 0.0, 1.0, 0.0, 2 * G_PI, 200), 1.0,
                                   1e-3);
    fixture_clear(&f);
}
