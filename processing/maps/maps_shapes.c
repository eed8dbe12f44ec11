#include "maps_shapes.h"

#include <math.h>

/* AROUND: number of quads of the sphere around its axis; DOWN: from pole to pole */
#define AROUND  96
#define DOWN    48
#define TILES_U 6 /* repetitions of the material around the sphere, as in mesorig-view */
#define TILES_V 3

static struct maps_mesh mesh_new(void) {
    return (struct maps_mesh){g_array_new(FALSE, FALSE, sizeof(float)),
                              g_array_new(FALSE, FALSE, sizeof(guint32))};
}

static void mesh_vertex(struct maps_mesh *mesh, const double p[3], const double n[3],
                        const double t[3], double u, double v) {
    const float all[MAPS_VERTEX] = {(float)p[0], (float)p[1], (float)p[2], (float)n[0],
                                    (float)n[1], (float)n[2], (float)t[0], (float)t[1],
                                    (float)t[2], 1,           (float)u,    (float)v};
    g_array_append_vals(mesh->vertices, all, MAPS_VERTEX);
}

static double radius_m(const struct maps *maps) {
    return TILES_U * maps->width * maps->texel_mm / 1000 / (2 * G_PI);
}

/* +x of the sample is +x of glTF. +y of the sample is −z of glTF, so that the top row of the sample
 * is at the back. */
struct maps_mesh maps_shapes_plane(const struct maps *maps) {
    static const double up[3] = {0, 1, 0}, right[3] = {1, 0, 0};
    static const guint32 indices[] = {0, 1, 3, 0, 3, 2};
    const double width = maps->width * maps->texel_mm / 1000;
    const double depth = maps->height * maps->texel_mm / 1000;
    struct maps_mesh mesh = mesh_new();
    for (int i = 0; i < 4; i++) {
        const double u = i % 2, v = i < 2 ? 0 : 1; /* v is 0 at the front */
        const double p[3] = {(u - 0.5) * width, 0, (0.5 - v) * depth};
        mesh_vertex(&mesh, p, up, right, u, 1 - v);
    }
    g_array_append_vals(mesh.indices, indices, G_N_ELEMENTS(indices));
    return mesh;
}

/* At the equator of the sphere the material has its true size. */
struct maps_mesh maps_shapes_sphere(const struct maps *maps) {
    const double radius = radius_m(maps);
    struct maps_mesh mesh = mesh_new();
    for (int j = 0; j <= DOWN; j++)
        for (int i = 0; i <= AROUND; i++) {
            /* v is 0 at the south pole and 1 at the north pole */
            const double u = (double)i / AROUND, v = (double)j / DOWN;
            const double a = 2 * G_PI * u, e = G_PI * (v - 0.5);
            const double n[3] = {cos(e) * cos(a), sin(e), -cos(e) * sin(a)};
            const double t[3] = {-sin(a), 0, -cos(a)};
            const double p[3] = {radius * n[0], radius * n[1], radius * n[2]};
            mesh_vertex(&mesh, p, n, t, TILES_U * u, TILES_V * (1 - v));
        }
    for (guint32 j = 0; j < DOWN; j++)
        for (guint32 i = 0; i < AROUND; i++) {
            const guint32 a = j * (AROUND + 1) + i, b = a + 1, c = a + AROUND + 1, d = c + 1;
            const guint32 lower[3] = {a, b, d}, upper[3] = {a, d, c};
            if (j > 0) /* at a pole one of the two triangles has no area */
                g_array_append_vals(mesh.indices, lower, 3);
            if (j + 1 < DOWN)
                g_array_append_vals(mesh.indices, upper, 3);
        }
    return mesh;
}

double maps_shapes_aside(const struct maps *maps, int shapes) {
    return shapes & MAPS_PLANE ? maps->width * maps->texel_mm / 1000 / 2 + 1.2 * radius_m(maps) : 0;
}

void maps_shapes_clear(struct maps_mesh *mesh) {
    g_clear_pointer(&mesh->vertices, g_array_unref);
    g_clear_pointer(&mesh->indices, g_array_unref);
}
