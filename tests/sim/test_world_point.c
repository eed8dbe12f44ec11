/* Points of a view: packing changes them far less than a sensor can see. */
#include "lib/test.h"
#include "world/world_private.h"

static double angle_between(const float a[3], const float b[3]) {
    struct v3 p = v3(a[0], a[1], a[2]), q = v3(b[0], b[1], b[2]), c = v3_cross(p, q);
    return atan2(sqrt(v3_dot(c, c)), v3_dot(p, q));
}

static void set_direction(float to[3], double x, double y, double z) {
    struct v3 d = v3_norm(v3(x, y, z));
    to[0] = (float)d.x;
    to[1] = (float)d.y;
    to[2] = (float)d.z;
}

static void check(const struct surface *from, enum cfa_colour colour) {
    struct point point;
    struct surface to;
    world_pack(from, colour, 4321, &point);
    world_unpack(&point, &to);
    g_assert_cmpuint(point.pixel, ==, 4321);
    g_assert_cmpuint(to.triangle, ==, from->triangle);
    for (int k = 0; k < 3; k++)
        g_assert_true(to.p[k] == from->p[k]);
    g_assert_cmpfloat(angle_between(to.n, from->n), <, 1e-4);
    g_assert_cmpfloat(angle_between(to.t, from->t), <, 1e-4);
    g_assert_cmpfloat(angle_between(to.ng, from->ng), <, 1e-4);
    g_assert_cmpfloat_with_epsilon(to.albedo[colour], from->albedo[colour], 1e-5);
    g_assert_cmpfloat_with_epsilon(to.gloss, from->gloss, 1e-5);
    g_assert_cmpfloat_with_epsilon(to.along, from->along, 1e-5);
    g_assert_cmpfloat_with_epsilon(to.across, from->across, 1e-5);
    g_assert_cmpfloat_with_epsilon(to.u, from->u, 1e-5);
    g_assert_cmpfloat_with_epsilon(to.v, from->v, 1e-5);
}

/* The axes and the octahedron's edges are among them: x, y and z run over −1, 0 and 1 as well. */
TEST(all_directions) {
    struct surface surface = {.p = {-12.345f, 6.789f, 0.1f},
                              .albedo = {0.1f, 0.5f, 1},
                              .gloss = 0.3f,
                              .along = 0.05f,
                              .across = 1,
                              .triangle = NO_TRIANGLE,
                              .u = 0.25f,
                              .v = 0.75f};
    for (int i = 0; i < 21 * 21 * 21; i++) {
        int x = i % 21 - 10, y = i / 21 % 21 - 10, z = i / 441 - 10;
        if (!x && !y && !z)
            continue;
        set_direction(surface.n, x, y, z);
        set_direction(surface.t, z, x, y);
        set_direction(surface.ng, -y, z, -x);
        check(&surface, (enum cfa_colour)(i % 3));
    }
}

TEST(narrow_lobe) {
    struct surface surface = {.n = {0, 0, 1},
                              .t = {1, 0, 0},
                              .ng = {0, 0, 1},
                              .gloss = 1,
                              .along = 1e-7f,
                              .across = 1e-7f},
                   to;
    struct point point;
    world_pack(&surface, CFA_GREEN, 0, &point);
    world_unpack(&point, &to);
    g_assert_cmpfloat(to.along, >, 0);
    g_assert_cmpfloat(to.across, >, 0);
    g_assert_true(isfinite(scene_reflect(&to, v3(0, 0, 500), v3(0, 0, 600), CFA_GREEN)));
}
