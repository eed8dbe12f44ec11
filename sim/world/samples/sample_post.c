#include "sample.h"

#include <math.h>
#include <string.h>

#define CORNERS 96

static guint32 add_corner(struct mesh *mesh, const double p[3], const double n[3],
                          const float albedo[3]) {
    struct vertex vertex = {.t = {(float)-n[1], (float)n[0], 0}, .along = 1, .across = 1};
    for (int k = 0; k < 3; k++) {
        vertex.p[k] = (float)p[k];
        vertex.n[k] = (float)n[k];
        vertex.albedo[k] = albedo[k];
    }
    if (n[2] > 0.5)
        vertex.t[0] = 1;
    return sample_add_vertex(mesh, &vertex);
}

void sample_add_post(struct mesh *mesh, double x_mm, double y_mm, double z_mm, double radius_mm,
                     const float albedo[3]) {
    static const float black[3] = {0, 0, 0};
    const double up[3] = {0, 0, 1}, middle[3] = {x_mm, y_mm, z_mm};
    guint32 face[CORNERS], high[CORNERS], low[CORNERS];
    guint32 centre = add_corner(mesh, middle, up, albedo);
    /* The polygon has the same area as the circle. */
    double step = 2 * G_PI / CORNERS, r = radius_mm * sqrt(step / sin(step));
    for (int i = 0; i < CORNERS; i++) {
        double out[3] = {cos(i * step), sin(i * step), 0};
        double p[3] = {x_mm + r * out[0], y_mm + r * out[1], z_mm};
        face[i] = add_corner(mesh, p, up, albedo);
        high[i] = add_corner(mesh, p, out, black);
        p[2] = 0;
        low[i] = add_corner(mesh, p, out, black);
    }
    for (int i = 0; i < CORNERS; i++) {
        int next = (i + 1) % CORNERS;
        sample_add_triangle(mesh, centre, face[i], face[next]);
        sample_add_quad(mesh, low[i], low[next], high[next], high[i]);
    }
}
