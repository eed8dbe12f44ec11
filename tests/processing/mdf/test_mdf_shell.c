/* Shells of MDFs whose distances have closed forms. */
#include "lib/plate.h"
#include "lib/test.h"
#include "mdf/mdf_shell.h"

#include <math.h>
#include <string.h>

#define DEG (G_PI / 180.0)

/* g at a point of the shell, by the definition in mdf_shell.h. */
static double g_at(const struct mdf_shell *s, double x, double y, double z) {
    const double u = x / s->width_mm * s->width - 0.5, v = y / s->height_mm * s->height - 0.5;
    const double w = CLAMP(z / s->depth_mm * s->depth - 0.5, 0.0, s->depth - 1.0);
    double sum = 0.0;
    for (int k = 0; k < 8; k++) {
        const int i = (int)floor(u) + (k & 1), j = (int)floor(v) + (k >> 1 & 1);
        const int l = (int)floor(w) + (k >> 2);
        const double share =
            (1.0 - fabs(u - i)) * (1.0 - fabs(v - j)) * MAX(1.0 - fabs(w - l), 0.0);
        const int column = (i % s->width + s->width) % s->width;
        const int row = (j % s->height + s->height) % s->height;
        if (l < s->depth)
            sum += share * s->values[((gsize)l * s->height + row) * s->width + column] / 255.0;
    }
    return sum;
}

/* The depth at which the shell stops a ray, in small steps. */
static double depth_in(const struct mdf_shell *s, double x, double y, double dx, double dy) {
    enum { STEPS = 800 };
    const double step = PLATE_FLOOR / STEPS, length = step * sqrt(1.0 + dx * dx + dy * dy);
    double sum = 0.0;
    for (int k = 0; k < STEPS; k++) {
        const double z = (k + 0.5) * step, g = g_at(s, x + z * dx, y + z * dy, z);
        sum += s->most_per_mm * g * g * g * g * length;
        if (sum >= G_LN2)
            return z;
    }
    return PLATE_FLOOR;
}

/* Mean error in mm of rays in directions between those of the table. */
static double mean_error(const struct mdf_shell *s, double theta_deg) {
    double sum = 0.0;
    int n = 0;
    for (double phi = 10.0; phi < 360.0; phi += 40.0)
        for (int i = 0; i < 50; i++, n++) {
            const double x = i * PLATE_TILE / 50.0, y = 3.0 + 0.37 * i,
                         dx = plate_slant(theta_deg, phi);
            const double dy = tan(theta_deg * DEG) * sin(phi * DEG);
            sum += fabs(depth_in(s, x, y, dx, dy) - plate_depth(x, dx));
        }
    return sum / n;
}

TEST(plate) {
    g_autoptr(MdfTable) table = plate_table(PLATE_RINGS);
    g_autoptr(MdfShell) shell = mdf_shell_new(table);
    g_assert_cmpfloat(shell->width_mm, ==, PLATE_TILE);
    g_assert_cmpfloat(shell->depth_mm, ==, PLATE_FLOOR);
    g_assert_cmpint(shell->width * shell->height * shell->depth, <=,
                    table->n_views * PLATE_ROWS * PLATE_TEXELS);
    g_assert_cmpfloat(shell->top_mm, >, 0.3);
    g_assert_cmpfloat(shell->top_mm, <, PLATE_TOP);
    for (double theta = 22.0; theta < 70.0; theta += 15.0) {
        const double error = mean_error(shell, theta);
        g_test_message("%.0f°: mean error %.3f mm", theta, error);
        g_assert_cmpfloat(error, <, 0.2);
    }
}

/* The space under the plate is free near its edges, where rays of flat views go, and a ray that
 * enters there meets the floor. */
TEST(overhang) {
    g_autoptr(MdfTable) table = plate_table(PLATE_RINGS);
    g_autoptr(MdfShell) shell = mdf_shell_new(table);
    const double under = g_at(shell, PLATE_LEFT + 1.2, 12.0, 3.0),
                 within = g_at(shell, 12.0, 12.0, 1.1);
    g_test_message("g under the plate %.3f, in its upper side %.3f", under, within);
    g_assert_cmpfloat(shell->most_per_mm * pow(under, 4.0), <, 0.1);
    g_assert_cmpfloat(shell->most_per_mm * pow(within, 4.0), >, 2.0);
    const double dx = plate_slant(52.0, 180.0), x = PLATE_LEFT + 1.0 - 3.0 * dx;
    g_assert_cmpfloat_with_epsilon(depth_in(shell, x, 12.0, dx, 0.0), PLATE_FLOOR, 0.3);
}

/* Distances that no laser saw say nothing, and views that were not measured are not used. */
TEST(unseen) {
    g_autoptr(MdfTable) table = plate_table(PLATE_RINGS);
    g_autoptr(MdfShell) before = mdf_shell_new(table);
    const gsize n = (gsize)PLATE_ROWS * PLATE_TEXELS * table->n_views;
    table->seen = g_malloc(n);
    memset(table->seen, 1, n);
    for (gsize k = 0; k < n; k += 7) {
        table->depth_mm[k] = (float)(0.2 * PLATE_TOP);
        table->seen[k] = 0;
    }
    g_autoptr(MdfShell) after = mdf_shell_new(table);
    g_assert_cmpfloat(mean_error(after, 37.0), <, mean_error(before, 37.0) + 0.05);
    table->n_measured = table->n_views - 12;
    g_autoptr(MdfTable) measured = mdf_table_copy_measured(table);
    g_assert_cmpint(measured->n_views, ==, table->n_views - 12);
    for (gsize k = n - (gsize)12 * PLATE_ROWS * PLATE_TEXELS; k < n; k++)
        table->depth_mm[k] = (float)(0.2 * PLATE_TOP);
    g_autoptr(MdfShell) fewer = mdf_shell_new(table), alone = mdf_shell_new(measured);
    g_assert_cmpint(fewer->depth, ==, alone->depth);
    g_assert_cmpmem(fewer->values, (gsize)fewer->width * fewer->height * fewer->depth,
                    alone->values, (gsize)alone->width * alone->height * alone->depth);
}
