/* Rays against a relief whose distances are known exactly: waves, traced by bisection. */
#include "codecs/mdf_codecs/mdf_blocks.h"
#include "codecs/mdf_codecs/mdf_factors.h"
#include "exr/exr.h"
#include "lib/material_fixture.h"
#include "lib/mdf_file.h"
#include "lib/ok.h"
#include "lib/plate.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <math.h>
#include <mesorig/material.h>
#include <string.h>

#define SIDE     32
#define TEXEL_MM 0.5
#define DEG      (G_PI / 180)
#define TILE_MM  (SIDE * TEXEL_MM)

#define RINGS  5
#define A_RING 16
#define VIEWS  (1 + RINGS * A_RING) /* the normal, and rings 15° apart */

/* x to the right and y upwards from the tile's centre, mm: 0.1 … 0.7 mm below the plane. */
static double depth_at(double x, double y) {
    return 0.4 + 0.2 * sin(2 * G_PI * x / TILE_MM) + 0.1 * cos(4 * G_PI * y / TILE_MM);
}

static void angles_of(int k, double *ret_theta_deg, double *ret_phi_deg) {
    const int ring = (k - 1) / A_RING, in_ring = (k - 1) % A_RING;
    *ret_theta_deg = k == 0 ? 0 : 15.0 * (1 + ring);
    *ret_phi_deg = k == 0 ? 0 : 360.0 / A_RING * in_ring;
}

static void direction_of(int k, double ret[3]) {
    double theta, phi;
    angles_of(k, &theta, &phi);
    ret[0] = sin(theta * DEG) * cos(phi * DEG);
    ret[1] = sin(theta * DEG) * sin(phi * DEG);
    ret[2] = cos(theta * DEG);
}

/* The slopes are so small that a ray above the horizon by 15° meets the surface once. */
static double distance_of(double x, double y, const double v[3]) {
    double low = 0, high = 0.8 / v[2];
    for (int k = 0; k < 40; k++) {
        const double at = (low + high) / 2;
        *(at * v[2] < depth_at(x - at * v[0], y - at * v[1]) ? &low : &high) = at;
    }
    return low;
}

static void write_mdf(const char *path) {
    g_autoptr(ExrFile) file = exr_file_new();
    for (int k = 0; k < VIEWS; k++) {
        double v[3], theta, phi;
        direction_of(k, v);
        angles_of(k, &theta, &phi);
        struct exr_part *part = mdf_file_add_view(file, k, SIDE, SIDE, theta, phi, TEXEL_MM);
        for (int i = 0; i < SIDE * SIDE; i++) {
            const int column = i % SIDE, row = i / SIDE;
            part->planes[0][i] = (float)distance_of((column + 0.5 - SIDE / 2.0) * TEXEL_MM,
                                                    (SIDE / 2.0 - row - 0.5) * TEXEL_MM, v);
        }
    }
    g_assert_true(ok(exr_write(path, file, EXR_ZIP, FALSE, ERR)));
}

/* Rays in the measured directions, and between them with a wider bound. */
static void check_rays(const mesorig_material *m, gboolean measured, double distance_bound,
                       double least_cosine) {
    g_autoptr(GRand) random = g_rand_new_with_seed(2);
    double worst = 0, worst_off = 0, worst_cosine = 1;
    for (int k = 0; k < 4000; k++) {
        const float uv[] = {(float)g_rand_double_range(random, -1, 2),
                            (float)g_rand_double_range(random, -1, 2)};
        double v[3];
        direction_of(k % VIEWS, v);
        if (!measured) {
            const double theta = g_rand_double_range(random, 0, 60) * DEG;
            const double phi = g_rand_double_range(random, 0, 2 * G_PI);
            v[0] = sin(theta) * cos(phi);
            v[1] = sin(theta) * sin(phi);
            v[2] = cos(theta);
        }
        const float view[] = {3 * (float)v[0], 3 * (float)v[1], 3 * (float)v[2]};
        struct mesorig_hit hit;
        g_assert_cmpint(mesorig_material_intersect(m, 1, uv, view, &hit), ==, MESORIG_OK);
        g_assert_cmpint(hit.hit, ==, 1);
        const double x = (uv[0] - 0.5) * TILE_MM, y = (0.5 - uv[1]) * TILE_MM;
        worst = fmax(worst, fabs(hit.distance_mm - distance_of(x, y, v)));
        const double at_x = (hit.uv[0] - 0.5) * TILE_MM, at_y = (0.5 - hit.uv[1]) * TILE_MM;
        g_assert_cmpfloat_with_epsilon(at_x, x - hit.distance_mm * v[0], 1e-4);
        g_assert_cmpfloat_with_epsilon(at_y, y - hit.distance_mm * v[1], 1e-4);
        worst_off = fmax(worst_off, fabs(hit.distance_mm * v[2] - depth_at(at_x, at_y)));
        /* Of z = −depth: along (∂depth/∂x, ∂depth/∂y, 1). */
        const double a = 0.2 * 2 * G_PI / TILE_MM * cos(2 * G_PI * at_x / TILE_MM);
        const double b = -0.1 * 4 * G_PI / TILE_MM * sin(4 * G_PI * at_y / TILE_MM);
        const double length = sqrt(a * a + b * b + 1);
        worst_cosine =
            fmin(worst_cosine, (hit.normal[0] * a + hit.normal[1] * b + hit.normal[2]) / length);
    }
    g_test_message("distance off by %.4f mm, point by %.4f mm, normal by %.2f°", worst, worst_off,
                   acos(MIN(worst_cosine, 1)) / DEG);
    g_assert_cmpfloat(worst, <, distance_bound);
    g_assert_cmpfloat(worst_off, <, distance_bound);
    g_assert_cmpfloat(worst_cosine, >, least_cosine);
}

TEST(waves) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autofree char *mdf = g_build_filename(folder, "mdf.exr", NULL);
    g_autofree char *blocks_path = g_build_filename(folder, "blocks.exr", NULL);
    g_autofree char *factors_path = g_build_filename(folder, "factors.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_sized(6, 6, 2, TRUE);
    g_autoptr(GError) why = NULL;
    struct mesorig_error error = {0};
    struct mesorig_material_info info = {.size = sizeof info};
    btf->layout.texel_mm = TILE_MM / 6;
    material_fixture_write(path, codecs_find("ward"), btf, "");
    write_mdf(mdf);
    mesorig_material *m = mesorig_material_open(path, mdf, &error);
    g_assert_cmpstr(error.text, ==, "");
    mesorig_material_info(m, &info);
    g_assert_cmpint(info.has_relief, ==, 1);
    g_assert_cmpfloat_with_epsilon(info.deepest_mm, 0.7, 0.01);
    /* Bilinear between texels: ∂²D/∂x², ∂²D/∂y² ≤ 0.1 / mm, times h² / 8 each, over cos 75°. */
    check_rays(m, TRUE, 0.02, cos(2 * DEG));
    /* Linear between rings: the depth seen is that at a shift of D tan θ, so that its error is
     * about D |∇D| tan″ θ Δθ² / 8 = 0.7 · 0.12 · 14 · 0.0086 = 0.01 mm at 60°, twice that as a
     * distance. */
    check_rays(m, FALSE, 0.02, cos(2 * DEG));
    mesorig_material_close(m);

    /* The compressed forms, and the file from memory. */
    g_autoptr(MdfTable) table = mdf_table_read(mdf, &why);
    g_assert_no_error(why);
    g_autoptr(MdfBlocks) blocks = mdf_blocks_new(table);
    g_assert_true(mdf_blocks_write(blocks_path, blocks, &why));
    g_autoptr(MdfFactors) factors = mdf_factors_compute(table, table->n_views, 12, 0, NULL, &why);
    g_assert_true(mdf_factors_write(factors_path, factors, &why));
    const char *const forms[] = {blocks_path, factors_path};
    for (gsize k = 0; k < G_N_ELEMENTS(forms); k++) {
        m = mesorig_material_open(path, forms[k], &error);
        g_assert_cmpstr(error.text, ==, "");
        check_rays(m, FALSE, 0.04, cos(6 * DEG));
        mesorig_material_close(m);
    }
    g_autofree char *bytes = NULL, *mdf_bytes = NULL;
    gsize n, mdf_n;
    g_assert_true(g_file_get_contents(path, &bytes, &n, NULL));
    g_assert_true(g_file_get_contents(mdf, &mdf_bytes, &mdf_n, NULL));
    m = mesorig_material_open_memory(bytes, n, mdf_bytes, mdf_n, &error);
    g_assert_nonnull(m);
    check_rays(m, TRUE, 0.02, cos(2 * DEG));
    mesorig_material_close(m);
}

/* The distances of another sample, in each form, are refused. */
TEST(other_sample) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "material.exr", NULL);
    g_autofree char *mdf = g_build_filename(folder, "mdf.exr", NULL);
    g_autofree char *blocks_path = g_build_filename(folder, "blocks.exr", NULL);
    g_autofree char *factors_path = g_build_filename(folder, "factors.exr", NULL);
    g_autofree char *session = g_build_filename(folder, "a.session", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE); /* 3 mm × 2.5 mm */
    g_autoptr(GError) why = NULL;
    material_fixture_write(path, codecs_find("ward"), btf, "");
    material_fixture_write_session(session, btf);
    write_mdf(mdf);
    g_autoptr(MdfTable) table = mdf_table_read(mdf, &why);
    g_autoptr(MdfBlocks) blocks = mdf_blocks_new(table);
    g_assert_true(mdf_blocks_write(blocks_path, blocks, &why));
    g_autoptr(MdfFactors) factors = mdf_factors_compute(table, table->n_views, 12, 0, NULL, &why);
    g_assert_true(mdf_factors_write(factors_path, factors, &why));
    g_assert_no_error(why);
    const char *const materials[] = {path, session}, *const forms[] = {mdf, blocks_path,
                                                                       factors_path};
    for (gsize i = 0; i < G_N_ELEMENTS(materials); i++)
        for (gsize k = 0; k < G_N_ELEMENTS(forms); k++) {
            struct mesorig_error error = {0};
            g_assert_null(mesorig_material_open(materials[i], forms[k], &error));
            g_assert_cmpint(error.status, ==, MESORIG_ERROR_FORMAT);
            assert_has(error.text, forms[k]);
            assert_has(error.text, "a sample of 16 × 16 mm");
            assert_has(error.text, "has 3 × 2.5 mm; give the MDF of the same session");
        }
}

static mesorig_material *plate_material(const char *folder) {
    g_autofree char *path = g_build_filename(folder, "plate.exr", NULL);
    g_autofree char *mdf = g_build_filename(folder, "plate_mdf.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_sized(8, 2, 2, TRUE);
    struct mesorig_error error = {0};
    btf->layout.texel_mm = PLATE_TILE / 8;
    material_fixture_write(path, codecs_find("ward"), btf, "");
    plate_write(mdf, PLATE_RINGS);
    mesorig_material *m = mesorig_material_open(path, mdf, &error);
    g_assert_cmpstr(error.text, ==, "");
    return m;
}

/* Between measured directions, interpolation mixes the plate and the floor. */
TEST(overhang) {
    TEMPORARY_FOLDER(folder);
    mesorig_material *m = plate_material(folder);
    double sum = 0;
    int n = 0, n_side = 0;
    for (double theta = 22; theta < 85; theta += 15)
        for (double phi = 10; phi < 360; phi += 40)
            for (int i = 0; i < 50; i++, n++) {
                const float uv[] = {(float)i / 50.0F, 0.12F + 0.015F * (float)i};
                const float view[] = {(float)(sin(theta * DEG) * cos(phi * DEG)),
                                      (float)(sin(theta * DEG) * sin(phi * DEG)),
                                      (float)cos(theta * DEG)};
                const double x = (double)uv[0] * PLATE_TILE, dx = plate_slant(theta, phi);
                const double depth = plate_depth(x, dx);
                struct mesorig_hit hit;
                g_assert_cmpint(mesorig_material_intersect(m, 1, uv, view, &hit), ==, MESORIG_OK);
                sum += fabs((double)hit.distance_mm * cos(theta * DEG) - depth);
                const float *normal = hit.normal;
                g_assert_cmpfloat(normal[0] * view[0] + normal[1] * view[1] + normal[2] * view[2],
                                  >, 0.0);
                /* In the middle of a side of the plate, the normal points outwards. */
                if (fabs(depth - 1.5) > 0.2)
                    continue;
                n_side++;
                g_assert_cmpfloat(normal[0] * (float)dx, <, 0.0F);
                g_assert_cmpfloat(fabsf(normal[0]), >, 0.3F);
            }
    /* In a measured direction, the texels have their measured depths. */
    const float view[] = {(float)(sin(45 * DEG) * cos(150 * DEG)),
                          (float)(sin(45 * DEG) * sin(150 * DEG)), (float)cos(45 * DEG)};
    for (int i = 0; i < PLATE_TEXELS; i++) {
        const float uv[] = {((float)i + 0.5F) / PLATE_TEXELS, 0.5F / PLATE_ROWS};
        struct mesorig_hit hit;
        g_assert_cmpint(mesorig_material_intersect(m, 1, uv, view, &hit), ==, MESORIG_OK);
        g_assert_cmpfloat_with_epsilon(
            (double)hit.distance_mm * cos(45 * DEG),
            plate_depth((double)uv[0] * PLATE_TILE, plate_slant(45, 150)), 1e-3);
    }
    g_test_message("mean error of depths %.3f mm, %d of %d rays meet a side", sum / n, n_side, n);
    g_assert_cmpfloat(sum / n, <, 0.2);
    g_assert_cmpint(n_side, >, 20);
    mesorig_material_close(m);
}

/* Rays over a curved mesh; test_shell_ray.c has their hits. */
TEST(march) {
    TEMPORARY_FOLDER(folder);
    mesorig_material *m = plate_material(folder);
    /* A tile is 10 units wide, so that 1 mm is 0.4. The ray goes level along the plate. */
    struct mesorig_surface mesh[2] = {{.tile = {10, 2.5F}}, {.tile = {10, 2.5F}}};
    const float uv[] = {0.5F, 0.5F, 0.5F, 0.5F}, view[] = {0, 3, 4, 0, 3, 4};
    const float limits[] = {INFINITY, 0.4F};
    float distance[2];
    g_assert_cmpint(mesorig_material_march(m, 2, uv, view, mesh, limits, distance), ==, MESORIG_OK);
    g_assert_cmpfloat_with_epsilon(distance[0], 0.4 * PLATE_TOP / 0.8, 0.06);
    g_assert_cmpfloat(distance[1], ==, -1);
    /* On a narrow cylinder along x the ray leaves again above the plate: its deepest point is
     * R (1 − 0.6) = 0.2 below the mesh, which is 0.5 mm. */
    mesh[0].bend[2] = 2;
    g_assert_cmpint(mesorig_material_march(m, 1, uv, view, mesh, NULL, distance), ==, MESORIG_OK);
    g_assert_cmpfloat(distance[0], ==, -1);
    mesh[0].bend[2] = 0.4F; /* 1 unit, 2.5 mm */
    g_assert_cmpint(mesorig_material_march(m, 1, uv, view, mesh, NULL, distance), ==, MESORIG_OK);
    g_assert_cmpfloat_with_epsilon(distance[0], 2 - sqrt(4 - 1.84), 0.1);

    mesh[1].tile[0] = 0;
    g_assert_cmpint(mesorig_material_march(m, 2, uv, view, mesh, NULL, distance), ==, MESORIG_OK);
    g_assert_cmpfloat(distance[0], >, 0);
    g_assert_cmpfloat(distance[1], ==, -1);
    g_assert_cmpint(mesorig_material_march(m, 1, uv, view, NULL, NULL, distance), ==,
                    MESORIG_ERROR_ARGUMENT);
    mesorig_material_close(m);
}

/* Without relief rays end where they enter. */
TEST(flat) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    const float uv[] = {1.25F, -0.5F, 0, 0}, view[] = {0.5F, 0, 0.5F, 0, 1, -0.1F};
    struct mesorig_hit hit[2];
    material_fixture_write(path, codecs_find("ward"), btf, "");
    mesorig_material *m = mesorig_material_open(path, NULL, NULL);
    g_assert_cmpint(mesorig_material_intersect(m, 2, uv, view, hit), ==, MESORIG_OK);
    g_assert_cmpint(hit[0].hit, ==, 1);
    g_assert_cmpfloat(hit[0].distance_mm, ==, 0);
    g_assert_cmpfloat(hit[0].uv[0], ==, 1.25F);
    g_assert_cmpfloat(hit[0].uv[1], ==, -0.5F);
    g_assert_cmpfloat(hit[0].normal[2], ==, 1);
    g_assert_cmpint(hit[1].hit, ==, 0);
    g_assert_cmpfloat(hit[1].normal[2], ==, 0);
    mesorig_material_close(m);
}
