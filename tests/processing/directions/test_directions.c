#include "base/work.h"
#include "directions/directions.h"
#include "lib/direction.h"
#include "lib/ok.h"
#include "lib/test.h"

#include <math.h>
#include <string.h>

#define DEG (G_PI / 180.0)

struct set {
    float theta[512], phi[512];
    int n;
};

static void add(struct set *set, double theta, double phi) {
    set->theta[set->n] = theta;
    set->phi[set->n++] = phi;
}

static void add_ring(struct set *set, double theta, int n, double offset) {
    for (int k = 0; k < n; k++)
        add(set, theta, offset + 360.0 * k / n);
}

static Directions *make(const struct set *set) {
    Directions *directions = ok(directions_new(set->theta, set->phi, set->n, ERR));
    return directions;
}

static struct set rig_set(void) {
    struct set set = {.n = 0};
    for (int ring = 1; ring <= 5; ring++)
        add_ring(&set, 15.0 * ring, 12, 15.0);
    return set;
}

/* As a calibrated rig has it: uneven counts and offsets, some jitter, one view missing. */
static struct set uneven_set(void) {
    struct set set = {.n = 0};
    g_autoptr(GRand) random = g_rand_new_with_seed(5);
    add_ring(&set, 14.0, 5, 3.0);
    add_ring(&set, 31.0, 9, 11.0);
    add_ring(&set, 52.0, 12, 0.0);
    add_ring(&set, 71.0, 17, 7.0);
    for (int k = 0; k < set.n; k++) {
        set.theta[k] += g_rand_double_range(random, -0.4, 0.4);
        set.phi[k] += g_rand_double_range(random, -1.5, 1.5);
    }
    set.n--;
    return set;
}

static struct set spiral_set(void) {
    struct set set = {.n = 0};
    for (int k = 0; k < 81; k++)
        add(&set, acos(1.0 - (k + 0.5) / 81.0 * 0.9) / DEG, fmod(k * 137.50776, 360.0));
    return set;
}

static struct set grid_set(void) { /* in the plane of x and y: many on common lines */
    struct set set = {.n = 0};
    for (int j = -4; j <= 4; j++)
        for (int i = -4; i <= 4; i++)
            if (i * i + j * j <= 16)
                add(&set, hypot(i, j) * 20.0, atan2(j, i) / DEG);
    return set;
}

static double value_of(Directions *directions, const struct set *set, const double *values,
                       struct vec3 at) {
    struct direction_weights w;
    directions_weights(directions, at, &w);
    double sum = 0.0, weights = 0.0;
    for (int k = 0; k < 4; k++) {
        int n;
        const int *members = directions_pole(directions, &n);
        g_assert_cmpfloat(w.weight[k], >=, -1e-7);
        weights += w.weight[k];
        if (w.index[k] < set->n) {
            sum += w.weight[k] * values[w.index[k]];
            continue;
        }
        g_assert_cmpint(n, >, 0);
        for (int m = 0; m < n; m++)
            sum += w.weight[k] * values[members[m]] / n;
    }
    g_assert_cmpfloat_with_epsilon(weights, 1.0, 1e-6);
    return sum;
}

static void random_values(GRand *random, double *values) {
    for (int k = 0; k < 512; k++)
        values[k] = g_rand_double(random);
}

static void check_exact(const struct set *set, double tolerance) {
    g_autoptr(Directions) directions = make(set);
    g_autoptr(GRand) random = g_rand_new_with_seed(1);
    double values[512];
    random_values(random, values);
    for (int k = 0; k < set->n; k++)
        g_assert_cmpfloat_with_epsilon(
            value_of(directions, set, values, direction_of_deg(set->theta[k], set->phi[k])),
            values[k], tolerance);
}

/* Along great circles, a step of a thousandth of a radian must never change the value by more than
 * the steepest slope between neighbours allows. */
static void check_continuous(const struct set *set, double steepest) {
    g_autoptr(Directions) directions = make(set);
    g_autoptr(GRand) random = g_rand_new_with_seed(2);
    double values[512];
    random_values(random, values);
    for (int circle = 0; circle < 40; circle++) {
        struct vec3 a = direction_of_deg(g_rand_double_range(random, 0, 90),
                                         g_rand_double_range(random, 0, 360));
        struct vec3 b = direction_of_deg(g_rand_double_range(random, 0, 90),
                                         g_rand_double_range(random, 0, 360));
        if (circle % 4 == 0) /* through the pole */
            a = vec3(0, 0, 1);
        struct vec3 side = vec3_unit(vec3_sub(b, vec3_scale(a, vec3_dot(a, b))));
        double last = NAN, last_fade = NAN;
        for (int k = 0; k < 6284; k++) {
            struct vec3 v = vec3_add(vec3_scale(a, cos(k * 1e-3)), vec3_scale(side, sin(k * 1e-3)));
            if (v.z <= 0.0) {
                last = last_fade = NAN;
                continue;
            }
            double value = value_of(directions, set, values, v);
            double fade = directions_fade(directions, v);
            if (!isnan(last))
                g_assert_cmpfloat(fabs(value - last), <, steepest * 1e-3);
            if (!isnan(last_fade))
                g_assert_cmpfloat(fabs(fade - last_fade), <, 2e-2);
            last = value;
            last_fade = fade;
        }
    }
}

static struct set pole_set(void) {
    struct set set = rig_set();
    add(&set, 0.3, 77.0);
    return set;
}

static const struct kind {
    const char *path;
    struct set (*make)(void);
    gboolean rings;
    double steepest, tolerance;
} kinds[] = {
    {"/directions/rings", rig_set, TRUE, 12.0, 1e-5},
    {"/directions/uneven-rings", uneven_set, TRUE, 12.0, 1e-5},
    {"/directions/rings-with-pole", pole_set, TRUE, 12.0, 1e-5},
    {"/directions/spiral", spiral_set, FALSE, 25.0, 1e-4},
    {"/directions/grid", grid_set, FALSE, 25.0, 1e-4},
};

/* Between two rings four directions count, in a triangle at most three. */
static gboolean are_rings(const Directions *directions) {
    struct direction_weights at;
    int most = 0;
    for (int k = 0; k < 100; k++) {
        int n = 0;
        directions_weights(directions, direction_of_deg(20 + 0.4 * k, 7.3 * k), &at);
        for (int i = 0; i < 4; i++)
            n += at.weight[i] > 0;
        most = MAX(most, n);
    }
    return most > 3;
}

static void test_kind(gconstpointer data) {
    const struct kind *kind = data;
    struct set set = kind->make();
    g_autoptr(Directions) directions = make(&set);
    g_assert_cmpint(are_rings(directions), ==, kind->rings);
    check_exact(&set, kind->tolerance);
    check_continuous(&set, kind->steepest);
}

/* Half way in theta, a third of the way in azimuth. */
TEST(bilinear) {
    struct set set = rig_set();
    g_autoptr(Directions) directions = make(&set);
    double values[512] = {0.0};
    values[12 + 0] = 1.0; /* 30°, 15° */
    g_assert_cmpfloat_with_epsilon(value_of(directions, &set, values, direction_of_deg(37.5, 25.0)),
                                   0.5 * (1.0 - 10.0 / 30.0), 1e-6);
    values[12 + 0] = 0.0;
    values[24 + 1] = 1.0; /* 45°, 45° */
    g_assert_cmpfloat_with_epsilon(value_of(directions, &set, values, direction_of_deg(37.5, 25.0)),
                                   0.5 * 10.0 / 30.0, 1e-6);
    values[24 + 1] = 0.0;
    values[11] = 12.0; /* 15°, 345°: the pole is the mean of twelve */
    g_assert_cmpfloat_with_epsilon(value_of(directions, &set, values, vec3(0, 0, 1)), 1.0, 1e-6);
    g_assert_cmpfloat_with_epsilon(value_of(directions, &set, values, direction_of_deg(7.5, 345.0)),
                                   6.5, 1e-5);
    g_assert_cmpfloat_with_epsilon(value_of(directions, &set, values, direction_of_deg(7.5, 0.0)),
                                   3.5, 1e-5);
}

/* cos θ is even in every azimuth: bilinear interpolation errs by at most h²/8 between rings. */
TEST(smooth_function) {
    const struct set sets[] = {rig_set(), uneven_set(), spiral_set()};
    for (gsize s = 0; s < G_N_ELEMENTS(sets); s++) {
        g_autoptr(Directions) directions = make(&sets[s]);
        g_autoptr(GRand) random = g_rand_new_with_seed(3);
        double values[512];
        for (int k = 0; k < sets[s].n; k++)
            values[k] = cos(sets[s].theta[k] * DEG);
        for (int k = 0; k < 1000; k++) {
            double theta = g_rand_double_range(random, 16.0, 68.0);
            struct vec3 v = direction_of_deg(theta, g_rand_double_range(random, 0, 360));
            g_assert_cmpfloat_with_epsilon(value_of(directions, &sets[s], values, v),
                                           cos(theta * DEG), 0.025);
        }
    }
}

TEST(fade) {
    struct set set = rig_set();
    g_autoptr(Directions) directions = make(&set);
    g_assert_cmpfloat(directions_fade(directions, direction_of_deg(74.9, 10)), ==, 1.0);
    g_assert_cmpfloat_with_epsilon(directions_fade(directions, direction_of_deg(84.0, 10)),
                                   cos(84.0 * DEG) / cos(75.0 * DEG), 1e-9);
    g_assert_cmpfloat(directions_fade(directions, direction_of_deg(90.0 + 1e-9, 10)), ==, 0.0);
    g_assert_cmpfloat(directions_fade(directions, direction_of_deg(170.0, 10)), ==, 0.0);
    struct set spiral = spiral_set();
    g_autoptr(Directions) scattered = make(&spiral);
    g_assert_cmpfloat(directions_fade(scattered, direction_of_deg(60.0, 10)), ==, 1.0);
    g_assert_cmpfloat(directions_fade(scattered, direction_of_deg(89.0, 10)), <, 0.3);
}

TEST(few) {
    struct set set = {.n = 0};
    for (int n = 1; n <= 5; n++) {
        add(&set, 20.0 + 9.0 * n, 30.0 * n * n);
        check_exact(&set, 1e-4);
        check_continuous(&set, 200.0);
    }
    struct set twins = spiral_set();
    add(&twins, twins.theta[7], twins.phi[7]);
    g_autoptr(Directions) directions = make(&twins);
    double values[512] = {0.0};
    values[7] = values[81] = 1.0;
    g_assert_cmpfloat_with_epsilon(
        value_of(directions, &twins, values, direction_of_deg(twins.theta[7], twins.phi[7])), 1.0,
        1e-4);
}

/* Directions in one plane, as of lamps on an arc that does not turn. Each way of the arc in
 * azimuth, and also given out of order. */
TEST(arc) {
    for (double turn = 0; turn < 180; turn += 22.5) {
        struct set set = {.n = 0};
        for (int k = 0; k < 7; k++) {
            const int at = k * 3 % 7 - 3; /* −3 … 3 */
            add(&set, 20.0 * abs(at), at < 0 ? turn + 180 : turn);
        }
        check_exact(&set, 1e-6);
        check_continuous(&set, 200.0);
        g_autoptr(Directions) directions = make(&set);
        double values[512] = {0.0};
        for (int k = 0; k < set.n; k++)
            values[k] = tan(set.theta[k] * DEG / 2) * (set.phi[k] > turn + 90 ? -1 : 1);
        for (double theta = -55; theta < 60; theta += 10) /* linear in the stereographic plane */
            g_assert_cmpfloat_with_epsilon(
                value_of(directions, &set, values, direction_of_deg(theta, turn)),
                tan(theta * DEG / 2), 1e-6);
    }
}

TEST(square) {
    double sum = 0.0, step = 2.0 / 400;
    for (int j = 0; j < 400; j++)
        for (int i = 0; i < 400; i++) {
            double a = -1.0 + (i + 0.5) * step, b = -1.0 + (j + 0.5) * step;
            struct vec3 v = directions_from_square(a, b);
            g_assert_cmpfloat_with_epsilon(vec3_length(v), 1.0, 1e-12);
            double scale = fabs(v.x) + fabs(v.y) + v.z;
            g_assert_cmpfloat_with_epsilon((v.x + v.y) / scale, a, 1e-9);
            g_assert_cmpfloat_with_epsilon((v.x - v.y) / scale, b, 1e-9);
            sum += directions_square_density(a, b) * step * step;
        }
    g_assert_cmpfloat_with_epsilon(sum, 2.0 * G_PI, 1e-3);
}

TEST(bad) {
    const float theta[] = {10.0f, NAN, 95.0f, -1.0f, INFINITY}, phi[] = {0, 0, 0, 0, 0};
    for (int k = 1; k < 5; k++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(directions_new(theta + k, phi, 1, &error));
        g_assert_error(error, DIRECTIONS_ERROR, DIRECTIONS_ERROR_RANGE);
    }
    g_autoptr(GError) none = NULL, bad_phi = NULL;
    g_assert_null(directions_new(theta, phi, 0, &none));
    g_assert_error(none, DIRECTIONS_ERROR, DIRECTIONS_ERROR_RANGE);
    g_assert_null(directions_new(theta, theta + 1, 1, &bad_phi));
    g_assert_error(bad_phi, DIRECTIONS_ERROR, DIRECTIONS_ERROR_RANGE);
}

#define ASKED   2000
#define ASKERS  4
#define STRIDES 7 /* does not divide ASKED: each thread asks all, in an order of its own */

struct asked {
    const Directions *directions;
    struct vec3 at[ASKED];
    struct direction_weights found[ASKERS][ASKED];
};

static void ask_all(int asker, gpointer data) {
    struct asked *asked = data;
    for (int k = 0; k < ASKED; k++) {
        const int one = (int)((gint64)k * (STRIDES + 2 * asker) % ASKED);
        directions_weights(asked->directions, asked->at[one], &asked->found[asker][one]);
    }
}

/* What several threads find at the same time, each in another order, is the same to the last bit.
 */
TEST(threads) {
    const struct set sets[] = {rig_set(), spiral_set(), grid_set()};
    g_autofree struct asked *asked = g_new0(struct asked, 1);
    for (gsize s = 0; s < G_N_ELEMENTS(sets); s++) {
        g_autoptr(Directions) directions = make(&sets[s]);
        g_autoptr(GRand) random = g_rand_new_with_seed(4);
        asked->directions = directions;
        for (int k = 0; k < ASKED; k++)
            asked->at[k] = direction_of_deg(g_rand_double_range(random, 0, 90),
                                            g_rand_double_range(random, 0, 360));
        memset(asked->found, 0xff, sizeof asked->found);
        work_for_each(ASKERS, ASKERS, ask_all, asked);
        for (int asker = 1; asker < ASKERS; asker++)
            g_assert_cmpmem(asked->found[0], sizeof asked->found[0], asked->found[asker],
                            sizeof asked->found[asker]);
    }
}

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        g_test_add_data_func(kinds[i].path, &kinds[i], test_kind);
}
