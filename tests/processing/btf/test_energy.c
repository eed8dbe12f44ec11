#include "base/data_error.h"
#include "btf/energy.h"
#include "lib/btf_fixture.h"
#include "lib/ok.h"
#include "lib/test.h"

#include <math.h>

#define SIDE 3

/* Views and lights at the same directions: rings of 15° with so many each. */
static struct direction_list new_directions(void) {
    static const int around[] = {1, 6, 10, 14, 18, 20};
    struct direction_list ret = direction_list_new(69);
    for (int ring = 0, i = 0; ring < 6; ring++)
        for (int k = 0; k < around[ring]; k++, i++) {
            ret.theta_deg[i] = 15.0F * (float)ring;
            ret.phi_deg[i] = 360.0F * (float)k / (float)around[ring];
        }
    return ret;
}

#define N 69

typedef double (*Reflect)(double theta_l, double theta_v, double between);

static struct btf_matrix *new_btf(Reflect reflect) {
    struct btf_matrix *btf =
        btf_fixture_of("analytic", SIDE, SIDE, new_directions(), new_directions());
    for (int i = 0; i < SIDE * SIDE * N * N; i++) {
        int v = i / N % N, l = i % N;
        double degree = G_PI / 180;
        double value = reflect(
            (double)btf->layout.lights.theta_deg[l] * degree,
            (double)btf->layout.views.theta_deg[v] * degree,
            (double)(btf->layout.views.phi_deg[v] - btf->layout.lights.phi_deg[l]) * degree);
        for (int c = 0; c < 3; c++)
            btf->values[3 * i + c] = (float)value;
    }
    return btf;
}

static double lambert(double theta_l, double theta_v, double between) {
    return 0.6 * cos(theta_l);
}

/* Of a diffuser 0.6 comes back from everywhere, in each view and under each light. */
TEST(lambert) {
    struct btf_matrix *btf = new_btf(lambert);
    struct energy *energy = ok(energy_compute(btf, -1, ERR));
    g_assert_cmpint(energy->texel, ==, 4);
    g_assert_cmpint(energy->pairs, ==, N * (N - 1) / 2);
    g_assert_cmpfloat(energy->asymmetry, <, 1e-5);
    g_assert_cmpfloat_with_epsilon(energy->largest_albedo, 0.6, 1e-5);
    for (int i = 0; i < N; i++) {
        g_assert_cmpfloat_with_epsilon(energy->e_r[i], 0.6, 1e-5);
        g_assert_cmpfloat_with_epsilon(energy->texel_e_r[i], 0.6, 1e-5);
        g_assert_cmpfloat_with_epsilon(energy->e_i[i], 0.6, 1e-5);
        g_assert_cmpfloat_with_epsilon(energy->texel_e_i[i], 0.6, 1e-5);
        g_assert_cmpfloat_with_epsilon(energy->albedo[i], 0.6, 1e-5);
    }
    energy_free(energy);
    btf_matrix_free(btf);
}

/* A lobe around the mirror direction, reciprocal: f = 2·max(r·v, 0)⁴. */
static double lobe(double theta_l, double theta_v, double between) {
    double cosine = cos(theta_l) * cos(theta_v) - sin(theta_l) * sin(theta_v) * cos(between);
    return 2 * pow(MAX(cosine, 0), 4) * cos(theta_l);
}

TEST(lobe) {
    struct btf_matrix *btf = new_btf(lobe);
    struct energy *energy = energy_compute(btf, 0, NULL);
    g_test_message("albedo under the zenith %.4f", energy->albedo[0]);
    g_assert_cmpfloat(energy->asymmetry, <, 1e-5);
    /* (1/π) ∫ 2 cos⁵θ dω = 2/3, but for the steps between views */
    g_assert_cmpfloat_with_epsilon(energy->albedo[0], 2.0 / 3, 0.01);
    for (int i = 0; i < N; i++)
        g_assert_cmpfloat_with_epsilon(energy->e_r[i], energy->e_i[i], 1e-5);
    g_assert_cmpfloat(fabs(energy->e_r[0] - energy->e_r[N - 1]), >, 0.1);
    energy_free(energy);
    btf_matrix_free(btf);
}

/* A light at the horizon is divided by nothing: E_r leaves it out. */
TEST(horizon) {
    struct direction_list lights = direction_list_new(2), views = direction_list_new(1);
    lights.theta_deg[1] = 90;
    struct btf_matrix *btf = btf_fixture_of("horizon", 1, 1, views, lights);
    for (int i = 0; i < 6; i++)
        btf->values[i] = i < 3 ? 0.5F : 0.25F;
    struct energy *energy = energy_compute(btf, 0, NULL);
    g_assert_cmpfloat_with_epsilon(energy->e_r[0], 0.5, 1e-6);
    g_assert_cmpfloat_with_epsilon(energy->e_i[0], 0.5, 1e-6);
    g_assert_cmpfloat(energy->e_i[1], ==, 0);
    energy_free(energy);
    btf_matrix_free(btf);
}

/* Values that depend on the view only: B / cos l = cos v / cos l, which exchanged is its inverse.
 */
static double lopsided(double theta_l, double theta_v, double between) {
    return cos(theta_v);
}

TEST(lopsided) {
    struct btf_matrix *btf = new_btf(lopsided);
    struct energy *energy = energy_compute(btf, 0, NULL);
    g_assert_cmpfloat(energy->asymmetry, >, 0.5);
    g_assert_cmpfloat(energy->largest_albedo, >, 1);
    energy_free(energy);
    btf_matrix_free(btf);
}

TEST(no_such_texel) {
    struct btf_matrix *btf = new_btf(lambert);
    for (int texel = -2; texel <= SIDE * SIDE; texel += SIDE * SIDE + 2) {
        g_autoptr(GError) error = NULL;
        g_assert_null(energy_compute(btf, texel, &error));
        g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    }
    btf_matrix_free(btf);
}
