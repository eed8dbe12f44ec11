/* Endless materials in hexagons: pictures of the graphics card are compared with the same
 * computation on the CPU. The hexagons must take nothing from beyond the sample's edges and have no
 * jumps at their borders, their lattice must close, and mean and variance must be those of the
 * sample. */
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/silhouettes_fixture.h"
#include "lib/test.h"
#include "lib/view_fixture.h"
#include "scene/reference.h"

#include "synthesis/endless.h"

#define SIDE  32
#define TILES 6
#define MANY  200000

/* Noise, one picture: independent values of the given power of a random number. */
static float *new_noise(int width, int height, double power) {
    float *ret = g_new(float, width *height);
    GRand *random = g_rand_new_with_seed(4);
    for (int k = 0; k < width * height; k++)
        ret[k] = (float)pow(g_rand_double(random), power);
    g_rand_free(random);
    return ret;
}

static void moments(const double *values, int n, double *ret_mean, double *ret_variance) {
    double sum = 0, squares = 0;
    for (int k = 0; k < n; k++) {
        sum += values[k];
        squares += values[k] * values[k];
    }
    *ret_mean = sum / n;
    *ret_variance = squares / n - sum / n * (sum / n);
}

/* Of a sample that is no square, at many points: no place is beyond the edges, weights are those of
 * the variance, and the nearest texels' values have mean and variance of the sample. */
TEST(places) {
    const int width = 48, height = 40;
    g_autofree float *noise = new_noise(width, height, 3);
    g_autoptr(Endless) e =
        endless_new(width, height, &(struct endless_pictures){width, height, 1, noise});
    g_autofree double *sample = g_new(double, width *height), *seen = g_new(double, MANY);
    struct endless_lattice lattice;
    GRand *random = g_rand_new_with_seed(5);
    int alone = 0;
    double all_mean, mean, all_variance, variance;
    for (int k = 0; k < width * height; k++)
        sample[k] = noise[k];
    moments(sample, width * height, &all_mean, &all_variance);
    endless_lattice_init(&lattice, e, 40, 40);
    for (int k = 0; k < MANY; k++) {
        const float x[2] = {(float)g_rand_double_range(random, -20, 20),
                            (float)g_rand_double_range(random, -40, 0)};
        struct endless_places at;
        endless_find(e, &lattice, x, &at);
        double squares = 0, sum = at.mean, value = at.mean * all_mean;
        for (int i = 0; i < at.n; i++) {
            squares += at.weight[i] * (double)at.weight[i];
            sum += at.weight[i];
            for (int c = 0; c < 2; c++)
                g_assert_true(at.x[i][c] >= e->edge[c] && at.x[i][c] <= 1 - e->edge[c]);
            value +=
                at.weight[i] *
                noise[(int)(at.x[i][1] * (float)height) * width + (int)(at.x[i][0] * (float)width)];
        }
        g_assert_cmpfloat_with_epsilon(squares, 1, 1e-5);
        g_assert_cmpfloat_with_epsilon(sum, 1, 1e-5);
        alone += at.n == 1;
        seen[k] = value;
    }
    moments(seen, MANY, &mean, &variance);
    g_test_message("mean %.4f of %.4f, variance %.4f of %.4f, %.3f in one hexagon", mean, all_mean,
                   variance, all_variance, (double)alone / MANY);
    g_assert_cmpfloat(fabs(mean / all_mean - 1), <, 0.02);
    g_assert_cmpfloat(fabs(variance / all_variance - 1), <, 0.04);
    /* The strip along the edges, (1 − blend)² of the area of a hexagon away from it. */
    g_assert_cmpfloat_with_epsilon((double)alone / MANY, pow(1 - ENDLESS_BLEND, 2), 0.01);
    g_rand_free(random);
}

/* A smooth function of the places changes little over little steps, and the same on both sides of
 * where the shape's coordinates close. */
TEST(continuous) {
    g_autofree float *noise = new_noise(SIDE, SIDE, 1);
    g_autoptr(Endless) e =
        endless_new(SIDE, SIDE, &(struct endless_pictures){SIDE, SIDE, 1, noise});
    struct endless_lattice lattice;
    const double tiles[2] = {7.3, 2.9};
    endless_lattice_init(&lattice, e, tiles[0], tiles[1]);
    for (int k = 0; k < 20000; k++) {
        double before = 0;
        for (int turn = 0; turn < 3; turn++) {
            const double u = 0.003 * k + (turn == 1 ? 1e-4 : 0), v = -0.0007 * k;
            const float x[2] = {(float)(u + (turn == 2 ? tiles[0] : 0)),
                                (float)(v - (turn == 2 ? 2 * tiles[1] : 0))};
            struct endless_places at;
            double value = 0;
            endless_find(e, &lattice, x, &at);
            for (int i = 0; i < at.n; i++)
                value += at.weight[i] * sin(2 * at.x[i][0] + 3 * at.x[i][1]);
            if (turn > 0)
                g_assert_cmpfloat(fabs(value - before), <, turn == 1 ? 0.02 : 0.002);
            before = turn == 0 ? value : before;
        }
    }
}

/* One light and view as another; waves of which filters keep all. */
static struct eigenmaps *new_waves(void) {
    struct eigenmaps *maps = view_fixture_material(GREY, 2, 6);
    const gsize layers = (gsize)maps->n_terms * maps->layout.lights.n;
    maps->layout.width = maps->layout.height = SIDE;
    g_free(maps->maps);
    maps->maps = g_new0(float, 3 * SIDE * SIDE * layers);
    for (gsize i = 0; i < 3 * SIDE * SIDE * maps->layout.lights.n; i++) {
        const gsize texel = i / 3 % (SIDE * SIDE), x = texel % SIDE, y = texel / SIDE;
        maps->maps[i] = 0.4F + 0.2F * sinf((float)(2 * G_PI / SIDE) * (float)(x + 2 * y + i % 3)) +
                        0.2F * (float)(i % 3 == 1) * (float)(x > y);
    }
    return maps;
}

/* The card against the processor, filtered: within hexagons, along their edges, over the sample's
 * edges. */
GPU_TEST(reference) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 128, 64);
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    struct eigenmaps *maps = new_waves();
    g_assert_true(eigenmaps_write(path, maps, &error));
    g_autoptr(Viewer) view = viewer_new(maps, &error);
    g_autoptr(Reference) reference = reference_open_material(path, &error);
    g_assert_no_error(error);
    g_assert_true(viewer_set_mesh(view, mesh, &error));
    struct viewer_settings s = viewer_settings_default;
    double relative = 1, repeated = 0;
    s.tiles_u = TILES;
    s.tiles_v = 2;
    s.ambient = 0;
    s.camera_distance = 1.6;
    s.endless = TRUE;
    g_autofree float *drawn =
        ok(reference_render_scene_linear(&reference, 1, view, &s, 200, 150, &relative, ERR));
    s.endless = FALSE;
    g_autofree float *plain =
        reference_render_scene_linear(&reference, 1, view, &s, 200, 150, &repeated, &error);
    double differ = 0, all = 0;
    for (int k = 0; k < 4 * 200 * 150; k++) {
        differ += pow(drawn[k] - plain[k], 2);
        all += plain[k] * (double)plain[k];
    }
    g_test_message("endless %g, repeated %g; the two differ by %g", relative, repeated,
                   sqrt(differ / all));
    g_assert_cmpfloat(relative, <, fmax(1.5 * repeated, 0.02));
    g_assert_cmpfloat(differ, >, 0.04 * all);
    eigenmaps_free(maps);
}

/* Every view has the same depths: the way of a ray tells that of the nearest hexagon, not of a
 * mixture. */
GPU_TEST(depth) {
    static const float theta_deg[4] = {0, 45, 45, 45}, phi_deg[4] = {0, 0, 120, 240};
    const int width = 160, height = 120;
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_plane();
    g_autoptr(MdfTable) mdf = mdf_table_new(W, H, 4, 1, theta_deg, phi_deg);
    g_autofree float *noise = new_noise(W, H, 1);
    for (int k = 0; k < 4 * W * H; k++)
        mdf->depth_mm[k] = 0.1F + 0.4F * noise[k % (W * H)];
    mdf->deepest_mm = 0.6;
    g_autoptr(Viewer) view = silhouettes_view(mesh, mdf);
    struct viewer_settings s = view_fixture_settings();
    s.tiles_u = s.tiles_v = 4;
    s.camera_elevation_deg = 80;
    s.camera_distance = 0;
    s.silhouettes = s.endless = TRUE;
    s.visibility.views = TRUE; /* as the library */
    g_autofree float *texel =
        viewer_render_geometry(view, &s, VIEWER_GEOMETRY_TEXEL, width, height, &error);
    g_autofree float *to_view =
        viewer_render_geometry(view, &s, VIEWER_GEOMETRY_VIEW, width, height, &error);
    g_autofree float *lit =
        ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_LIT, width, height, ERR));
    struct endless_lattice lattice;
    const struct endless *e = viewer_endless(view, &s, &lattice);
    int n = 0, wrong = 0;
    double scale = 0;
    g_assert_nonnull(e);
    for (int k = 0; k < 4 * width * height; k += 4) {
        if (texel[k + 3] < 0.5F || texel[k + 2] < 0.5F || lit[k + 1] <= 0)
            continue;
        struct endless_places at;
        endless_find(e, &lattice, texel + k, &at);
        const float x = at.x[0][0] * W - 0.5F, y = at.x[0][1] * H - 0.5F;
        const int i = (int)floorf(x), j = (int)floorf(y);
        double depth = 0;
        for (int c = 0; c < 4; c++) {
            const int a = i + c % 2, b = j + c / 2;
            depth += (c % 2 ? x - (float)i : 1 - x + (float)i) *
                     (c / 2 ? y - (float)j : 1 - y + (float)j) *
                     mdf->depth_mm[(b + H) % H * W + (a + W) % W];
        }
        const double way = lit[k + 1] * to_view[k + 2] / depth;
        scale = n == 0 ? way : scale;
        wrong += fabs(way / scale - 1) > 0.02;
        n++;
    }
    g_test_message("%d of %d depths are others", wrong, n);
    g_assert_cmpint(n, >, width * height / 4);
    g_assert_cmpint(wrong, <, n / 50);
}
