/* The mesh of a plate over a floor, whose surface is known, and of random shells. */
#include "lib/plate.h"
#include "lib/test.h"
#include "mdf/mdf_mesh.h"

#include <math.h>

/* The number of directed edges a→b minus that of b→a, for each pair of vertices. */
static void check_closed(const struct mdf_mesh *mesh) {
    g_autoptr(GHashTable) edges = g_hash_table_new_full(g_int64_hash, g_int64_equal, g_free, NULL);
    for (guint k = 0; k < mesh->n_indices; k++) {
        const guint32 a = mesh->indices[k], b = mesh->indices[k % 3 == 2 ? k - 2 : k + 1];
        g_assert_cmpuint(a, <, mesh->n_vertices);
        g_assert_cmpuint(a, !=, b);
        gint64 key = (gint64)MIN(a, b) << 32 | MAX(a, b);
        const int n = GPOINTER_TO_INT(g_hash_table_lookup(edges, &key)) + (a < b ? 1 : -1);
        g_hash_table_insert(edges, g_memdup2(&key, sizeof key), GINT_TO_POINTER(n));
    }
    GHashTableIter iter;
    gpointer n;
    g_hash_table_iter_init(&iter, edges);
    while (g_hash_table_iter_next(&iter, NULL, &n))
        g_assert_cmpint(GPOINTER_TO_INT(n), ==, 0);
}

/* The volume inside, positive if the triangles face outwards. */
static double volume_mm3(const struct mdf_mesh *mesh) {
    double sum = 0.0;
    for (guint k = 0; k < mesh->n_indices; k += 3) {
        double p[3][3];
        for (int c = 0; c < 3; c++)
            for (int i = 0; i < 3; i++)
                p[c][i] = (double)mesh->vertices[mesh->indices[k + (guint)c]].at_mm[i];
        sum += p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) +
               p[0][1] * (p[1][2] * p[2][0] - p[1][0] * p[2][2]) +
               p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0]);
    }
    return sum / 6.0;
}

/* Distance of a point from the plate's surface or from the floor, in a section along x. */
static double distance_mm(double x, double depth) {
    const double sides = MAX(PLATE_LEFT - x, x - PLATE_RIGHT);
    const double layers = MAX(PLATE_TOP - depth, depth - PLATE_BOTTOM);
    const double plate =
        sides > 0.0 && layers > 0.0 ? hypot(sides, layers) : fabs(MAX(sides, layers));
    return MIN(plate, fabs(depth - PLATE_FLOOR));
}

TEST(plate) {
    g_autoptr(MdfTable) table = plate_table(PLATE_RINGS);
    g_autoptr(MdfShell) shell = mdf_shell_new(table);
    g_autoptr(MdfMesh) mesh = mdf_mesh_new(shell, table);
    const double layer_mm = PLATE_FLOOR / shell->depth;
    double sum = 0.0, facing = 0.0;
    int n = 0, n_under = 0;
    check_closed(mesh);
    for (guint k = 0; k < mesh->n_vertices; k++) {
        const struct mdf_mesh_vertex *v = &mesh->vertices[k];
        const double x = (double)v->at_mm[0], y = (double)v->at_mm[1], depth = -(double)v->at_mm[2];
        g_assert_cmpfloat_with_epsilon(x, (double)v->uv[0] * PLATE_TILE, 1e-4);
        g_assert_cmpfloat_with_epsilon(PLATE_HEIGHT - y, (double)v->uv[1] * PLATE_HEIGHT, 1e-4);
        g_assert_cmpfloat(depth, >, 0.0);
        g_assert_cmpfloat(depth, <, PLATE_FLOOR + 1.01 * layer_mm);
        if (x < 0.01 || x > PLATE_TILE - 0.01 || y < 0.01 || y > PLATE_HEIGHT - 0.01 ||
            depth > PLATE_FLOOR + 0.9 * layer_mm)
            continue;
        sum += distance_mm(x, depth);
        n++;
        /* The lower side of the plate, near an edge, where rays go under it. */
        if (fabs(depth - PLATE_BOTTOM) < 0.4 && x > PLATE_LEFT + 0.5 && x < PLATE_LEFT + 1.5) {
            n_under++;
            facing += (double)v->normal[2];
        }
    }
    g_test_message("%u vertices, %.3f mm from the surface; volume %.1f mm³", mesh->n_vertices,
                   sum / n, volume_mm3(mesh));
    g_assert_cmpfloat(sum / n, <, 0.2);
    g_assert_cmpint(n_under, >, 10);
    g_assert_cmpfloat(facing / n_under, <, -0.5);
    const double solid = PLATE_HEIGHT * ((PLATE_RIGHT - PLATE_LEFT) * (PLATE_BOTTOM - PLATE_TOP) +
                                         PLATE_TILE * layer_mm);
    g_assert_cmpfloat(volume_mm3(mesh), >, solid);
    g_assert_cmpfloat(volume_mm3(mesh), <, 1.6 * solid);
}

/* All neighbourhoods of free and opaque samples. */
TEST(random) {
    g_autoptr(GRand) random = g_rand_new_with_seed(7);
    for (int round = 0; round < 20; round++) {
        float theta = 30.0F, phi = 0.0F;
        g_autoptr(MdfTable) table = mdf_table_new(8, 6, 1, 1.0, &theta, &phi);
        table->deepest_mm = 3.0;
        for (int k = 0; k < 8 * 6; k++)
            table->depth_mm[k] = (float)g_rand_double_range(random, 0.0, 3.0);
        g_autoptr(MdfShell) shell = mdf_shell_new(table);
        for (int k = 0; k < shell->width * shell->height * shell->depth; k++)
            shell->values[k] = g_rand_boolean(random) ? 255 : 0;
        g_autoptr(MdfMesh) mesh = mdf_mesh_new(shell, table);
        check_closed(mesh);
        g_assert_cmpfloat(volume_mm3(mesh), >, 0.0);
    }
}
