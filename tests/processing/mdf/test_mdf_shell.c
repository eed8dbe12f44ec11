/* Shells of MDFs whose distances have closed forms: a plate that stands over a floor like a table,
 * so that rays go under it. Lengths are in mm. */
#include "lib/test.h"
#include "mdf/mdf_shell.h"

#include <math.h>
#include <string.h>

#define TEXELS 32
#define TILE   25.0
#define TOP    1.0 /* of the plate */
#define BOTTOM 2.0
#define FLOOR  4.0
#define LEFT   8.0 /* edges of the plate along x; it has no end along y */
#define RIGHT  17.0
#define DEG    (G_PI / 180.0)

/* The depth at which a ray from (x, y) on the reference plane stops. x grows by dx for each mm of
 * depth. */
static double true_depth(double x, double dx) {
    for (int tile = -2; tile <= 2; tile++) {
        const double left = LEFT + tile * TILE, right = RIGHT + tile * TILE;
        const double at_top = x + dx * TOP, at_bottom = x + dx * BOTTOM;
        if (at_top > left && at_top < right)
            return TOP;
        if (dx > 0.0 && at_top <= left && at_bottom > left)
            return (left - x) / dx;
        if (dx < 0.0 && at_top >= right && at_bottom < right)
            return (right - x) / dx;
    }
    return FLOOR;
}

static double slant(double theta_deg, double phi_deg) {
    return -tan(theta_deg * DEG) * cos(phi_deg * DEG);
}

static struct mdf_table *plate_table(void) {
    enum { RINGS = 5, ROUND = 12, VIEWS = RINGS * ROUND };
    float theta[VIEWS], phi[VIEWS];
    for (int k = 0; k < VIEWS; k++) {
        theta[k] = 15.0F * (float)(1 + k / ROUND);
        phi[k] = 30.0F * (float)(k % ROUND);
    }
    struct mdf_table *t = mdf_table_new(TEXELS, TEXELS, VIEWS, TILE / TEXELS, theta, phi);
    t->deepest_mm = FLOOR;
    for (int k = 0; k < VIEWS * TEXELS * TEXELS; k++) {
        const int view = k / (TEXELS * TEXELS);
        const double x = (k % TEXELS + 0.5) * TILE / TEXELS;
        const double dx = slant((double)theta[view], (double)phi[view]);
        t->depth_mm[k] = (float)true_depth(x, dx);
    }
    return t;
}

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
    const double step = FLOOR / STEPS, length = step * sqrt(1.0 + dx * dx + dy * dy);
    double sum = 0.0;
    for (int k = 0; k < STEPS; k++) {
        const double z = (k + 0.5) * step, g = g_at(s, x + z * dx, y + z * dy, z);
        sum += s->most_per_mm * g * g * g * g * length;
        if (sum >= G_LN2)
            return z;
    }
    return FLOOR;
}

/* Mean error in mm of rays in directions between those of the table. */
static double mean_error(const struct mdf_shell *s, double theta_deg) {
    double sum = 0.0;
    int n = 0;
    for (double phi = 10.0; phi < 360.0; phi += 40.0)
        for (int i = 0; i < 50; i++, n++) {
            const double x = i * TILE / 50.0, y = 3.0 + 0.37 * i, dx = slant(theta_deg, phi);
            const double dy = tan(theta_deg * DEG) * sin(phi * DEG);
            sum += fabs(depth_in(s, x, y, dx, dy) - true_depth(x, dx));
        }
    return sum / n;
}

TEST(plate) {
    g_autoptr(MdfTable) table = plate_table();
    g_autoptr(MdfShell) shell = mdf_shell_new(table);
    g_assert_cmpfloat(shell->width_mm, ==, TILE);
    g_assert_cmpfloat(shell->depth_mm, ==, FLOOR);
    g_assert_cmpint(shell->width * shell->height * shell->depth, <=,
                    table->n_views * TEXELS * TEXELS);
    g_assert_cmpfloat(shell->top_mm, >, 0.3);
    g_assert_cmpfloat(shell->top_mm, <, TOP);
    for (double theta = 22.0; theta < 70.0; theta += 15.0) {
        const double error = mean_error(shell, theta);
        g_test_message("%.0f°: mean error %.3f mm", theta, error);
        g_assert_cmpfloat(error, <, 0.2);
    }
}

/* The space under the plate is free near its edges, where rays of flat views go, and a ray that
 * enters there meets the floor. */
TEST(overhang) {
    g_autoptr(MdfTable) table = plate_table();
    g_autoptr(MdfShell) shell = mdf_shell_new(table);
    const double under = g_at(shell, LEFT + 1.2, 12.0, 3.0), within = g_at(shell, 12.0, 12.0, 1.1);
    g_test_message("g under the plate %.3f, in its upper side %.3f", under, within);
    g_assert_cmpfloat(shell->most_per_mm * pow(under, 4.0), <, 0.1);
    g_assert_cmpfloat(shell->most_per_mm * pow(within, 4.0), >, 2.0);
    const double dx = slant(52.0, 180.0), x = LEFT + 1.0 - 3.0 * dx;
    g_assert_cmpfloat_with_epsilon(depth_in(shell, x, 12.0, dx, 0.0), FLOOR, 0.3);
}

/* Distances that no laser saw say nothing, and views that were not measured are not used. */
TEST(unseen) {
    g_autoptr(MdfTable) table = plate_table();
    g_autoptr(MdfShell) before = mdf_shell_new(table);
    const gsize n = (gsize)TEXELS * TEXELS * table->n_views;
    table->seen = g_malloc(n);
    memset(table->seen, 1, n);
    for (gsize k = 0; k < n; k += 7) {
        table->depth_mm[k] = (float)(0.2 * TOP);
        table->seen[k] = 0;
    }
    g_autoptr(MdfShell) after = mdf_shell_new(table);
    g_assert_cmpfloat(mean_error(after, 37.0), <, mean_error(before, 37.0) + 0.05);
    table->n_measured = table->n_views - 12;
    g_autoptr(MdfTable) measured = mdf_table_copy_measured(table);
    g_assert_cmpint(measured->n_views, ==, table->n_views - 12);
    for (gsize k = n - (gsize)12 * TEXELS * TEXELS; k < n; k++)
        table->depth_mm[k] = (float)(0.2 * TOP);
    g_autoptr(MdfShell) fewer = mdf_shell_new(table), alone = mdf_shell_new(measured);
    g_assert_cmpint(fewer->depth, ==, alone->depth);
    g_assert_cmpmem(fewer->values, (gsize)fewer->width * fewer->height * fewer->depth,
                    alone->values, (gsize)alone->width * alone->height * alone->depth);
}
