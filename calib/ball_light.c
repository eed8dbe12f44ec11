#include "ball_light.h"

#include <math.h>
#include <string.h>

#define PARALLEL 1e-6 /* of the normal equations' determinant */

static gboolean normal_at(const struct ball_outline *ball, double x_px, double y_px,
                          struct vec3 *ret) {
    double x = (x_px - ball->x_px) / ball->radius_px, y = (ball->y_px - y_px) / ball->radius_px;
    double rest = 1 - x * x - y * y;
    if (!(rest > 0))
        return FALSE;
    *ret = vec3(x, y, sqrt(rest));
    return TRUE;
}

gboolean ball_light_direction(const struct ball_outline *ball, double x_px, double y_px,
                              struct vec3 *ret) {
    struct vec3 n;
    if (!normal_at(ball, x_px, y_px, &n))
        return FALSE;
    *ret = vec3_sub(vec3_scale(n, 2 * n.z), vec3(0, 0, 1));
    return TRUE;
}

/* Cramer's rule for a symmetric matrix; FALSE: it is nearly singular. */
static gboolean solve3(const struct mat3 *a, struct vec3 b, struct vec3 *ret) {
    struct vec3 r[3];
    for (int i = 0; i < 3; i++)
        r[i] = vec3(a->m[i][0], a->m[i][1], a->m[i][2]);
    struct vec3 c[3] = {vec3_cross(r[1], r[2]), vec3_cross(r[2], r[0]), vec3_cross(r[0], r[1])};
    double det = vec3_dot(r[0], c[0]), size = a->m[0][0] + a->m[1][1] + a->m[2][2];
    if (!(det > PARALLEL * size * size * size))
        return FALSE;
    *ret = vec3_scale(
        vec3_add(vec3_add(vec3_scale(c[0], b.x), vec3_scale(c[1], b.y)), vec3_scale(c[2], b.z)),
        1 / det);
    return TRUE;
}

gboolean ball_light_place(const struct ball_outline *balls, const double (*highlights_px)[2], int n,
                          struct vec3 *ret, double *ret_miss) {
    struct mat3 a;
    struct vec3 b = vec3(0, 0, 0), d;
    double miss = 0;
    memset(&a, 0, sizeof a);
    for (int pass = 0; pass < 2; pass++) { /* the sums, then how far off each ray is */
        for (int i = 0; i < n; i++) {
            struct vec3 normal, from;
            if (!normal_at(&balls[i], highlights_px[i][0], highlights_px[i][1], &normal) ||
                !ball_light_direction(&balls[i], highlights_px[i][0], highlights_px[i][1], &d))
                return FALSE;
            /* Balls of one size that seem larger are nearer; that they are so little is let be. */
            double unit = balls[i].radius_px;
            from = vec3_add(vec3((balls[i].x_px - balls[0].x_px) / unit,
                                 (balls[0].y_px - balls[i].y_px) / unit, 0),
                            normal);
            if (pass == 1) {
                miss += pow(vec3_length(vec3_cross(vec3_sub(*ret, from), d)), 2) / n;
                continue;
            }
            const double v[3] = {d.x, d.y, d.z};
            for (int j = 0; j < 3; j++)
                for (int k = 0; k < 3; k++)
                    a.m[j][k] += (j == k) - v[j] * v[k];
            b = vec3_add(b, vec3_sub(from, vec3_scale(d, vec3_dot(d, from))));
        }
        if (pass == 0 && !solve3(&a, b, ret))
            return FALSE;
    }
    *ret_miss = sqrt(miss);
    return TRUE;
}
