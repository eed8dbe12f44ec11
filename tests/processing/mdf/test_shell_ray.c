/* Rays through shells whose hits have closed forms: straight ones over a flat sample, and curved
 * ones under meshes of constant curvature or of a changing size of the texture. */
#include "lib/test.h"
#include "mdf/shell_ray.h"

#include <math.h>

#define SIDE 64
#define SIZE 16.0 /* of the tile, mm */
#define DEEP 2.0  /* depth of the shell, mm */
#define DEG  (G_PI / 180.0)

/* A shell that is opaque from a depth on, and from a column on in all depths. */
static struct mdf_shell *make_shell(double floor_mm, int wall_column) {
    struct mdf_shell *s = g_new0(struct mdf_shell, 1);
    *s = (struct mdf_shell){.width = SIDE,
                            .height = SIDE,
                            .depth = SIDE,
                            .width_mm = SIZE,
                            .height_mm = SIZE,
                            .depth_mm = DEEP,
                            .most_per_mm = 200.0,
                            .values = g_new0(guint8, SIDE * SIDE * SIDE)};
    for (int k = 0; k < SIDE * SIDE * SIDE; k++) {
        const double depth_mm = (k / SIDE / SIDE + 0.5) * DEEP / SIDE;
        s->values[k] = depth_mm > floor_mm || k % SIDE >= wall_column ? 255 : 0;
    }
    return s;
}

static void view_at(double theta_deg, double phi_deg, double ret[3]) {
    ret[0] = sin(theta_deg * DEG) * cos(phi_deg * DEG);
    ret[1] = sin(theta_deg * DEG) * sin(phi_deg * DEG);
    ret[2] = cos(theta_deg * DEG);
}

/* A flat sample with a level floor. */
TEST(flat) {
    g_autoptr(MdfShell) shell = make_shell(1.0, SIDE);
    const struct shell_surface flat = {.tile = {SIZE, SIZE}};
    for (double phi = 10.0; phi < 360.0; phi += 40.0)
        for (double theta = 0.0; theta < 85.0; theta += 20.0) {
            double view[3];
            struct shell_hit hit;
            view_at(theta, phi, view);
            g_assert_true(shell_ray_march(shell, &flat, 0.3, 0.6, view, INFINITY, &hit));
            /* Opacity begins half a layer above the floor, 0.0156 mm. */
            g_assert_cmpfloat_with_epsilon(hit.depth_mm, 1.0, 0.016);
            g_assert_cmpfloat_with_epsilon(hit.distance, hit.depth_mm / view[2], 1e-9);
            g_assert_cmpfloat_with_epsilon(hit.u, 0.3 - hit.distance * view[0] / SIZE, 1e-9);
            g_assert_cmpfloat_with_epsilon(hit.v, 0.6 + hit.distance * view[1] / SIZE, 1e-9);
            for (int c = 0; c < 3; c++)
                g_assert_cmpfloat_with_epsilon(hit.view[c], view[c], 1e-9);
            g_assert_false(shell_ray_march(shell, &flat, 0.3, 0.6, view, 0.9 / view[2], &hit));
            g_assert_true(shell_ray_march(shell, &flat, 0.3, 0.6, view, 1.1 / view[2], &hit));
        }
}

/* Below the structure a ray ends at the base, also if the shell has none. */
TEST(base) {
    g_autoptr(MdfShell) shell = make_shell(DEEP, SIDE);
    const struct shell_surface flat = {.tile = {SIZE, SIZE}};
    double view[3];
    struct shell_hit hit;
    view_at(60.0, 0.0, view);
    g_assert_true(shell_ray_march(shell, &flat, 0.0, 0.0, view, INFINITY, &hit));
    g_assert_cmpfloat_with_epsilon(hit.distance, 2.0 * DEEP, 1e-6);
    g_assert_false(shell_ray_march(shell, &flat, 0.0, 0.0, view, 1.9 * DEEP, &hit));
}

/* A cylinder of radius R, bent along u or along v. Its floor is a cylinder of radius R − 1. */
static void check_cylinder(int axis, double radius) {
    g_autoptr(MdfShell) shell = make_shell(1.0, SIDE);
    struct shell_surface mesh = {.tile = {SIZE, SIZE}};
    mesh.bend[2 * axis] = 1.0 / radius;
    for (double theta = 10.0; theta < 88.0; theta += 6.0)
        for (double phi = 0.0; phi < 360.0; phi += 45.0) {
            double view[3];
            struct shell_hit hit;
            view_at(theta, phi, view);
            const gboolean met = shell_ray_march(shell, &mesh, 0.5, 0.5, view, INFINITY, &hit);
            /* The ray from (0, radius) across the axis: |(−a t, radius − v_z t)| = radius − 1. */
            const double a = view[axis], c = view[2], square = a * a + c * c;
            const double root = radius * radius * c * c - square * (2.0 * radius - 1.0);
            if (fabs(root) < 0.05 * radius * radius * c * c)
                continue; /* near the ray that touches the floor */
            g_assert_cmpint(met, ==, root > 0.0);
            if (!met)
                continue;
            const double t = (radius * c - sqrt(root)) / square;
            const double turn = atan2(-a * t, radius - c * t); /* of the foot */
            const double uv[2] = {0.5, 0.5}, found[2] = {hit.u - uv[0], uv[1] - hit.v};
            const double slope = sqrt(root) / radius; /* about the cosine at the hit */
            g_assert_cmpfloat_with_epsilon(hit.distance, t, 0.02 / slope);
            g_assert_cmpfloat_with_epsilon(found[axis] * SIZE, turn * radius, 0.03 / slope);
            g_assert_cmpfloat_with_epsilon(found[1 - axis] * SIZE, -view[1 - axis] * hit.distance,
                                           0.03);
            /* The frame has turned with the foot. */
            const double s = sin(turn), k = cos(turn);
            g_assert_cmpfloat_with_epsilon(hit.view[axis], k * a - s * c, 0.03);
            g_assert_cmpfloat_with_epsilon(hit.view[2], s * a + k * c, 0.03);
        }
}

TEST(cylinders) {
    check_cylinder(0, 8.0);
    check_cylinder(1, 8.0);
    check_cylinder(0, 40.0);
}

/* A cylinder whose axis lies between u and v, so that the mixed curvature counts. The ray goes
 * across the axis. */
TEST(slanting_cylinder) {
    const double radius = 8.0, c = cos(30.0 * DEG), s = sin(30.0 * DEG);
    g_autoptr(MdfShell) shell = make_shell(1.0, SIDE);
    const struct shell_surface mesh = {.tile = {SIZE, SIZE},
                                       .bend = {c * c / radius, c * s / radius, s * s / radius}};
    for (double theta = 5.0; theta < 55.0; theta += 5.0) {
        double view[3];
        struct shell_hit hit;
        view_at(theta, 30.0, view);
        g_assert_true(shell_ray_march(shell, &mesh, 0.5, 0.5, view, INFINITY, &hit));
        const double z = view[2], root = radius * radius * z * z - 2.0 * radius + 1.0;
        const double t = radius * z - sqrt(root);
        const double arc = atan2(-t * sin(theta * DEG), radius - t * z) * radius;
        g_assert_cmpfloat_with_epsilon(hit.distance, t, 0.02 * radius / sqrt(root));
        g_assert_cmpfloat_with_epsilon((hit.u - 0.5) * SIZE, arc * c, 0.03 * radius / sqrt(root));
        g_assert_cmpfloat_with_epsilon((0.5 - hit.v) * SIZE, arc * s, 0.03 * radius / sqrt(root));
    }
}

/* A sphere of radius R, on which structure is met at the radius R − 1, or at the base. */
static void check_sphere(double floor_mm, double tolerance) {
    const double radius = 8.0, inner = radius - MIN(floor_mm, DEEP);
    g_autoptr(MdfShell) shell = make_shell(floor_mm, SIDE);
    const struct shell_surface mesh = {.tile = {SIZE, SIZE},
                                       .bend = {1.0 / radius, 0.0, 1.0 / radius}};
    for (double theta = 0.0; theta < 89.0; theta += 4.0)
        for (double phi = 20.0; phi < 360.0; phi += 70.0) {
            double view[3];
            struct shell_hit hit;
            view_at(theta, phi, view);
            const double nearest = radius * sin(theta * DEG);
            const double root = inner * inner - nearest * nearest;
            if (fabs(nearest - inner) < 0.1)
                continue;
            g_assert_cmpint(shell_ray_march(shell, &mesh, 0.5, 0.5, view, INFINITY, &hit), ==,
                            root > 0.0);
            if (!(root > 0.0))
                continue;
            const double t = radius * view[2] - sqrt(root), slope = sqrt(root) / inner;
            const double turn = atan2(t * sin(theta * DEG), radius - t * view[2]);
            const double arc = hypot(hit.u - 0.5, hit.v - 0.5) * SIZE;
            g_assert_cmpfloat_with_epsilon(hit.distance, t, tolerance / slope);
            g_assert_cmpfloat_with_epsilon(arc, turn * radius, 1.5 * tolerance / slope);
        }
}

TEST(sphere) {
    check_sphere(1.0, 0.02);
    check_sphere(DEEP, 0.005);
}

/* Bent the other way, as the inside of a tube: the floor is at the radius R + 1. */
TEST(tube) {
    const double radius = 12.0;
    g_autoptr(MdfShell) shell = make_shell(1.0, SIDE);
    const struct shell_surface mesh = {.tile = {SIZE, SIZE}, .bend = {-1.0 / radius}};
    for (double theta = 0.0; theta < 85.0; theta += 12.0) {
        double view[3];
        struct shell_hit hit;
        view_at(theta, 0.0, view);
        g_assert_true(shell_ray_march(shell, &mesh, 0.5, 0.5, view, INFINITY, &hit));
        const double c = view[2];
        const double t = -radius * c + sqrt(radius * radius * c * c + 2.0 * radius + 1.0);
        g_assert_cmpfloat_with_epsilon(hit.distance, t, 0.02 / c);
    }
}

/* A flat mesh whose tiles grow along u: u = ln(1 + a x) / (a tile). A wall in the texture is met
 * where that is. */
TEST(growing) {
    g_autoptr(MdfShell) shell = make_shell(DEEP, 40);
    const double u = 0.25, wall = 40.0 / SIDE;
    for (double a = -0.04; a < 0.05; a += 0.02) {
        const struct shell_surface mesh = {.tile = {SIZE, SIZE}, .stretch = {a, 0.0, 0.0, 0.0}};
        double view[3];
        struct shell_hit hit;
        view_at(84.0, 180.0, view); /* towards +u */
        g_assert_true(shell_ray_march(shell, &mesh, u, 0.5, view, INFINITY, &hit));
        const double way = (wall - u) * SIZE;
        const double x = a == 0.0 ? way : (exp(a * way) - 1.0) / a;
        g_assert_cmpfloat_with_epsilon(hit.u, wall, 0.01);
        g_assert_cmpfloat_with_epsilon(hit.distance * sin(84.0 * DEG), x, 0.2);
    }
}

/* In fog of one density, a ray goes a certain way in the flat sample. On a mesh whose tiles grow
 * along u, that is ∫ dx / (1 + a x) = ln (1 + a x) / a. */
TEST(fog) {
    g_autoptr(MdfShell) shell = make_shell(0.0, 0);
    shell->most_per_mm = 0.4;
    shell->depth_mm = 4.0;
    const double way_mm = G_LN2 / 0.4, unit = 3.0; /* of the mesh, for each mm */
    for (double a = -0.04; a < 0.05; a += 0.02) {
        const struct shell_surface mesh = {.tile = {unit * SIZE, unit * SIZE},
                                           .stretch = {a, 0.0, a, 0.0}};
        double view[3];
        struct shell_hit hit;
        view_at(50.0, 180.0, view);
        const double growth = a * sin(50.0 * DEG);
        const double x = a == 0.0 ? unit * way_mm : (exp(growth * unit * way_mm) - 1.0) / growth;
        g_assert_true(shell_ray_march(shell, &mesh, 0.5, 0.5, view, INFINITY, &hit));
        g_assert_cmpfloat_with_epsilon(hit.distance, x, 0.005 * x);
    }
}

/* Polar coordinates on a plane: u is along the radius, v against the angle, and the lines of u bend
 * apart. A straight ray keeps its direction, while the frame turns with the angle. */
TEST(polar) {
    const double radius = 30.0;
    g_autoptr(MdfShell) shell = make_shell(1.0, SIDE);
    const struct shell_surface mesh = {.tile = {SIZE, SIZE},
                                       .stretch = {0.0, 0.0, 1.0 / radius, 0.0}};
    double view[3];
    struct shell_hit hit;
    view_at(75.0, 230.0, view); /* towards +u and along the bitangent */
    g_assert_true(shell_ray_march(shell, &mesh, 0.1, 0.9, view, INFINITY, &hit));
    const double x = radius - hit.distance * view[0], y = -hit.distance * view[1];
    const double angle = atan2(y, x);
    g_assert_cmpfloat_with_epsilon((hit.u - 0.1) * SIZE, hypot(x, y) - radius, 0.02);
    g_assert_cmpfloat_with_epsilon((0.9 - hit.v) * SIZE, angle * radius, 0.02);
    g_assert_cmpfloat_with_epsilon(hit.view[0], cos(angle) * view[0] + sin(angle) * view[1], 0.01);
    g_assert_cmpfloat_with_epsilon(hit.view[1], cos(angle) * view[1] - sin(angle) * view[0], 0.01);
    g_assert_cmpfloat(angle, >, 0.08);

    /* The same with u and v exchanged. */
    const struct shell_surface other = {.tile = {SIZE, SIZE},
                                        .stretch = {0.0, 1.0 / radius, 0.0, 0.0}};
    view_at(75.0, 220.0, view);
    g_assert_true(shell_ray_march(shell, &other, 0.1, 0.9, view, INFINITY, &hit));
    const double right = -hit.distance * view[0], away = radius - hit.distance * view[1];
    g_assert_cmpfloat_with_epsilon((0.9 - hit.v) * SIZE, hypot(right, away) - radius, 0.02);
    g_assert_cmpfloat_with_epsilon((hit.u - 0.1) * SIZE, atan2(right, away) * radius, 0.02);
}

/* The gradient is that of differences. */
TEST(gradient) {
    g_autoptr(MdfShell) shell = make_shell(1.0, 40);
    g_autoptr(GRand) random = g_rand_new_with_seed(4);
    for (int k = 0; k < SIDE * SIDE * SIDE; k++)
        shell->values[k] = (guint8)g_rand_int_range(random, 0, 256);
    for (int k = 0; k < 200; k++) {
        const double u = g_rand_double_range(random, -1.0, 2.0);
        const double v = g_rand_double_range(random, -1.0, 2.0);
        const double z = g_rand_double_range(random, 0.1, DEEP - 0.1), h = 1e-6;
        double at[3], unused[3];
        const double g = shell_ray_value(shell, u, v, z, at);
        const double right = shell_ray_value(shell, u + h / SIZE, v, z, unused);
        const double up = shell_ray_value(shell, u, v - h / SIZE, z, unused);
        const double out = shell_ray_value(shell, u, v, z - h, unused);
        g_assert_cmpfloat_with_epsilon((right - g) / h, at[0], 1e-3);
        g_assert_cmpfloat_with_epsilon((up - g) / h, at[1], 1e-3);
        g_assert_cmpfloat_with_epsilon((out - g) / h, at[2], 1e-3);
    }
}
