/* Interpolation over directions against formulas, and tables of directions. */
#include "btf/direction_mesh.h"

#include "lib/near_field_fixture.h"
#include "lib/ok.h"
#include "lib/test.h"

/* f = a + b·x + x·C·x in the plane. */
static double quadric(const double x[2]) {
    return 2 + 0.7 * x[0] - 0.4 * x[1] + 1.5 * x[0] * x[0] - 0.8 * x[0] * x[1] + 0.3 * x[1] * x[1];
}

static struct vec3 unit_vec(double theta_deg, double phi_deg) {
    double d[3];
    near_field_direction(theta_deg, phi_deg, d);
    return vec3(d[0], d[1], d[2]);
}

static double evaluate(const DirectionMesh *mesh, const double *points, int n, struct vec3 at,
                       const float *values, gboolean *ret_held) {
    struct direction_guess guess;
    struct direction_share share;
    double point[2], sum = 0;
    g_autofree float *weights = g_new0(float, n);
    direction_mesh_guess(mesh, at, &guess);
    direction_mesh_point(at, point);
    direction_mesh_share(mesh, points, point, &guess, &share);
    direction_mesh_weights(mesh, &share, weights);
    for (int i = 0; i < n; i++)
        sum += (double)(weights[i] * values[4 * i]);
    *ret_held = share.clamped;
    return sum;
}

/* Any quadric comes back exactly, within and a little besides what was measured. */
TEST(quadrics) {
    struct rings rings = near_field_twelve(7);
    near_field_add_ring(&rings, 0, 1, 0);
    const int n = rings.n;
    g_autofree struct vec3 *directions = g_new(struct vec3, n);
    g_autofree double *points = g_new(double, 2 * n);
    g_autofree float *values = g_new0(float, 4 * n), *slopes = g_new(float, 8 * n);
    for (int i = 0; i < n; i++) {
        directions[i] = unit_vec((double)rings.theta[i], (double)rings.phi[i]);
        direction_mesh_point(directions[i], points + (gsize)(2 * i));
        values[4 * i] = (float)quadric(points + (gsize)(2 * i));
    }
    g_autoptr(DirectionMesh) mesh = direction_mesh_new(directions, n, -1, FALSE);
    direction_mesh_slopes(mesh, values, 4, slopes);
    for (int i = 0; i < n; i++) {
        const double *x = points + (gsize)(2 * i);
        g_assert_cmpfloat(fabs((double)slopes[8 * i] - (0.7 + 3 * x[0] - 0.8 * x[1])), <, 2e-5);
        g_assert_cmpfloat(fabs((double)slopes[8 * i + 4] - (-0.4 - 0.8 * x[0] + 0.6 * x[1])), <,
                          2e-5);
    }
    for (int k = 0; k < 2000; k++) {
        const struct vec3 at = unit_vec(k % 50 * 1.6, k * 7.7);
        double point[2];
        gboolean held;
        direction_mesh_point(at, point);
        const double got = evaluate(mesh, points, n, at, values, &held);
        g_assert_false(held);
        g_assert_cmpfloat(fabs(got - quadric(point)), <, 2e-5);
    }
}

/* Few directions, all in a line, or several in one place: weights that are finite and sum up to 1.
 */
TEST(few_directions) {
    static const double sets[][8] = {{30, 0},
                                     {30, 0, 60, 180},
                                     {10, 0, 40, 0, 70, 0},
                                     {60, 45, 30, 45, 30, 225, 60, 225},
                                     {40, 10, 40, 10.01, 40, 130, 40, 250}};
    static const int counts[] = {1, 2, 3, 4, 4};
    for (gsize s = 0; s < G_N_ELEMENTS(sets); s++)
        for (int skip = -1; skip < counts[s]; skip++) {
            const int n = counts[s];
            struct vec3 directions[4];
            double points[8];
            float ones[16] = {0};
            for (int i = 0; i < n; i++) {
                directions[i] = unit_vec(sets[s][2 * i], sets[s][2 * i + 1]);
                direction_mesh_point(directions[i], points + (gsize)(2 * i));
                ones[4 * i] = 1;
            }
            g_autoptr(DirectionMesh) mesh = direction_mesh_new(directions, n, skip, FALSE);
            for (int k = 0; k < 100; k++) {
                gboolean held;
                const double sum =
                    evaluate(mesh, points, n, unit_vec(k * 0.9, k * 41), ones, &held);
                g_assert_cmpfloat(fabs(sum - 1), <, n == 1 && skip == 0 ? 2 : 1e-5);
            }
        }
}

TEST(table) {
    static const struct {
        const char *text, *what;
    } cases[] = {
        {"theta_deg,phi_deg\n1,2\n", "the column “of” is missing"},
        {"of,theta_deg,phi_deg\neye,1,2\n", ":2: the column “of” has “eye”, but must"},
        {"of,theta_deg,phi_deg\nboth,90,2\n", ":2: theta_deg is 90, but must be 0 to 89"},
        {"of,theta_deg,phi_deg\nboth,nan,2\n", ":2: "},
        {"of,theta_deg,phi_deg\nboth,,2\n", ":2: "},
        {"of,theta_deg,phi_deg\nboth,10,2\nview,10,362\n", ":3: the view θ 10°, φ 362° repeats"},
        {"of,theta_deg,phi_deg\nview,10,2\n", "the table has no light; add"},
        {"", "the table is empty"}};
    g_autofree char *path = g_build_filename(near_folder, "table.csv", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_true(g_file_set_contents(path, cases[i].text, -1, NULL));
        g_assert_null(btf_directions_read(path, &error));
        if (!strstr(error->message, cases[i].what))
            g_error("“%s” does not say “%s”", error->message, cases[i].what);
    }
    static const char good[] = "# two of each\nof; theta_deg; phi_deg\nboth;0;0\nview;30;90\n"
                               "light;60;-20\n";
    g_autoptr(GError) error = NULL;
    g_assert_true(g_file_set_contents(path, good, -1, NULL));
    struct btf_directions *read = ok(btf_directions_read(path, ERR));
    g_assert_cmpint(read->views.n, ==, 2);
    g_assert_cmpint(read->lights.n, ==, 2);
    g_assert_cmpfloat((double)read->views.phi_deg[1], ==, 90);
    g_assert_cmpfloat((double)read->lights.theta_deg[1], ==, 60);
    g_assert_cmpstr(read->name, ==, "table.csv");
    btf_directions_free(read);
}

BEFORE_TESTS {
    near_folder = g_dir_make_tmp("direction-mesh-XXXXXX", NULL);
}

AFTER_TESTS {
    remove_tree(near_folder);
    g_free(near_folder);
}
