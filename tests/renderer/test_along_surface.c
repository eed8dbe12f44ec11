/* Views between measured ones along the surface, on a sample whose colour is a function of the
 * point that a ray meets. Rays are traced through the sample here. */
#include "lib/ok.h"
#include "lib/view_fixture.h"
#include "mdf/mdf_table.h"

#define N        32  /* texels of a tile in each direction, 1 mm each */
#define DEEP     5.0 /* depth of the floor, mm */
#define N_VIEWS  16
#define N_LIGHTS 8

enum sample { FLOOR, RIDGES };

/* Returns the depth of the sample below (x, y), mm. Ridges run across the tile and end at the
 * reference plane. */
static double depth_of(enum sample sample, double x, double y) {
    const double across = (x + y) / N;
    return sample == RIDGES && across - floor(across) < 0.4 ? 0.0 : DEEP;
}

/* Follows a ray from the reference plane at (x, y) against v. Returns the depth at which the ray
 * meets the sample, and the colour there. */
static double meet(enum sample sample, double x, double y, struct vec3 v, double ret[3]) {
    const double step = 0.01;
    double z = 0.0;
    while (z < depth_of(sample, x, y)) {
        z += step;
        x -= step * v.x / v.z;
        y -= step * v.y / v.z;
    }
    z = MIN(z, DEEP);
    ret[0] = 0.5 + 0.4 * sin(4.0 * G_PI * x / N);
    ret[1] = 0.5 + 0.4 * cos(4.0 * G_PI * y / N);
    ret[2] = 0.8 - 0.6 * z / DEEP;
    return z;
}

/* Makes eigen-maps that are exact: each view is a term of its own. Fills the depths of its MDF. */
static struct eigenmaps *measure(enum sample sample, struct mdf_table *mdf) {
    struct eigenmaps *m = g_new0(struct eigenmaps, 1);
    m->name = g_strdup("test");
    m->layout.width = m->layout.height = N;
    m->layout.texel_mm = 1.0;
    m->layout.views.n = N_VIEWS;
    m->layout.lights.n = N_LIGHTS;
    m->layout.views.theta_deg = g_memdup2(mdf->theta_deg, sizeof(float) * N_VIEWS);
    m->layout.views.phi_deg = g_memdup2(mdf->phi_deg, sizeof(float) * N_VIEWS);
    m->layout.lights.theta_deg = g_memdup2(mdf->theta_deg, sizeof(float) * N_LIGHTS);
    m->layout.lights.phi_deg = g_memdup2(mdf->phi_deg, sizeof(float) * N_LIGHTS);
    m->n_terms = N_VIEWS;
    m->weights = g_new0(float, N_VIEWS *N_VIEWS);
    m->maps = g_new(float, (gsize)N_VIEWS *N_LIGHTS *N *N * 3);
    for (int view = 0; view < N_VIEWS; view++) {
        const struct vec3 v = direction_of_deg(mdf->theta_deg[view], mdf->phi_deg[view]);
        m->weights[view * N_VIEWS + view] = 1.0F;
        for (int k = 0; k < N * N; k++) {
            double rgb[3];
            mdf->depth_mm[view * N * N + k] =
                (float)meet(sample, k % N + 0.5, N - k / N - 0.5, v, rgb);
            for (int i = 0; i < N_LIGHTS * 3; i++)
                m->maps[(((gsize)view * N_LIGHTS + i / 3) * N * N + k) * 3 + i % 3] =
                    (float)rgb[i % 3];
        }
    }
    return m;
}

static Viewer *open_view(enum sample sample) {
    float theta_deg[N_VIEWS], phi_deg[N_VIEWS];
    for (int k = 0; k < N_VIEWS; k++) {
        theta_deg[k] = k < 8 ? 20.0F : 45.0F;
        phi_deg[k] = 45.0F * (float)(k % 8);
    }
    g_autoptr(MdfTable) mdf = mdf_table_new(N, N, N_VIEWS, 1.0, theta_deg, phi_deg);
    mdf->deepest_mm = DEEP;
    g_autoptr(Mesh) plane = scene_plane();
    struct eigenmaps *maps = measure(sample, mdf);
    Viewer *view = ok(viewer_new(maps, ERR));
    eigenmaps_free(maps);
    ok(viewer_set_mesh(view, plane, ERR));
    ok(viewer_set_mdf(view, &(struct mdf_source){.table = mdf}, ERR));
    return view;
}

/* Returns the RMS error of the picture over the middle of the plane. */
static double error_of(Viewer *view, enum sample sample, double azimuth_deg, gboolean along) {
    const int width = 120, height = 90;
    struct viewer_settings s = view_fixture_settings();
    s.style.nearest = FALSE;
    s.camera_distance = 4.0;
    s.camera_fov_deg = 25.0;
    s.camera_azimuth_deg = azimuth_deg;
    s.camera_elevation_deg = 57.0;
    s.light_theta_deg = 20.0; /* a measured polar angle */
    s.silhouettes = TRUE;
    s.along_surface = along;
    g_autofree float *pixels = view_fixture_linear(view, &s, width, height);
    double squares = 0.0;
    int n = 0;
    for (int j = 0; j < height; j++)
        for (int i = 0; i < width; i++) {
            struct vec3 eye, d = view_fixture_ray(&s, sqrt(2.0), width, height, i, j, &eye);
            const struct vec3 p = view_fixture_mix(eye, 1.0, d, -eye.z / d.z);
            if (fabs(p.x) > 0.6 || fabs(p.y) > 0.6)
                continue;
            double rgb[3];
            meet(sample, 0.5 * (p.x + 1.0) * N, 0.5 * (p.y + 1.0) * N, vec3(-d.x, -d.y, -d.z), rgb);
            for (int c = 0; c < 3; c++)
                squares += pow((double)pixels[4 * (j * width + i) + c] - rgb[c], 2.0) / 3.0;
            n++;
        }
    g_assert_cmpint(n, >, 1000);
    return sqrt(squares / n);
}

/* On a floor far below the reference plane each measured view shows another point at a texel. */
GPU_TEST(floor) {
    g_autoptr(Viewer) view = open_view(FLOOR);
    for (int k = 0; k < 4; k++) {
        const double mixed = error_of(view, FLOOR, 90.0 * k + 20.0, FALSE);
        const double along = error_of(view, FLOOR, 90.0 * k + 20.0, TRUE);
        g_test_message("floor: %.4f mixed, %.4f along the surface", mixed, along);
        g_assert_cmpfloat(along, <, 0.004);
        g_assert_cmpfloat(mixed, >, 8.0 * along);
    }
}

/* Ridges hide a part of the floor from some of the views. */
GPU_TEST(ridges) {
    g_autoptr(Viewer) view = open_view(RIDGES);
    double sum_mixed = 0.0, sum_along = 0.0;
    for (int k = 0; k < 4; k++) {
        const double mixed = error_of(view, RIDGES, 90.0 * k + 20.0, FALSE);
        const double along = error_of(view, RIDGES, 90.0 * k + 20.0, TRUE);
        g_test_message("ridges: %.4f mixed, %.4f along the surface", mixed, along);
        g_assert_cmpfloat(along, <, mixed);
        sum_mixed += mixed;
        sum_along += along;
    }
    g_assert_cmpfloat(sum_along, <, 0.6 * sum_mixed);
}
