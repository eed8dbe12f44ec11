#include "mesh_shape.h"

#include "float3.h"

#include <math.h>

#define MIN_SCALE 1e-6f

/* Sums over the triangles around a vertex. `bend` of struct vertex_shape, (L, M, N), is fitted by
 * least squares to the changes of the normal along the edges of the triangles: L a + M b = p and M
 * a + N b = q. (a, b) are the components of an edge along tangent and bitangent, and (p, q) those
 * of the change of the normal. The members aa, ab, bb, pa, pb_qa and qb are sums of products of a,
 * b, p and q. */
struct sums {
    float area, scale[2];
    double aa, ab, bb, pa, pb_qa, qb;
    double ga[2], gb[2]; /* sums of the change of ln scale times a (ga) and times b (gb) */
};

/* Adds the lengths of dP/du and dP/dv, weighted by the triangle's area. */
static void add_scale(const struct vertex *const v[3], struct sums *const sums[3]) {
    float e1[3], e2[3], normal[3], du[3], dv[3];
    float3_minus(v[1]->position, v[0]->position, e1);
    float3_minus(v[2]->position, v[0]->position, e2);
    float3_cross(e1, e2, normal);
    float u1 = v[1]->uv[0] - v[0]->uv[0], v1 = v[1]->uv[1] - v[0]->uv[1];
    float u2 = v[2]->uv[0] - v[0]->uv[0], v2 = v[2]->uv[1] - v[0]->uv[1];
    float area = sqrtf(float3_dot(normal, normal)), turn = u1 * v2 - u2 * v1;
    if (turn == 0.0f || area == 0.0f)
        return;
    for (int k = 0; k < 3; k++) {
        du[k] = (v2 * e1[k] - v1 * e2[k]) / turn;
        dv[k] = (u1 * e2[k] - u2 * e1[k]) / turn;
    }
    for (int c = 0; c < 3; c++) {
        sums[c]->area += area;
        sums[c]->scale[0] += area * sqrtf(float3_dot(du, du));
        sums[c]->scale[1] += area * sqrtf(float3_dot(dv, dv));
    }
}

/* Computes the bitangent of a vertex, and sets ret to the components of an edge along the tangent
 * and the bitangent. */
static void components(const struct vertex *at, const float edge[3], float ret_bitangent[3],
                       double ret[2]) {
    float3_cross(at->normal, at->tangent, ret_bitangent);
    for (int k = 0; k < 3; k++)
        ret_bitangent[k] *= at->tangent[3];
    ret[0] = float3_dot(edge, at->tangent);
    ret[1] = float3_dot(edge, ret_bitangent);
}

static void add_edge(const struct vertex *at, const struct vertex *from, const struct vertex *to,
                     struct sums *sums) {
    float edge[3], change[3], side[3];
    double along[2];
    float3_minus(to->position, from->position, edge);
    float3_minus(to->normal, from->normal, change);
    components(at, edge, side, along);
    const double a = along[0], b = along[1];
    double p = float3_dot(change, at->tangent), q = float3_dot(change, side);
    sums->aa += a * a;
    sums->ab += a * b;
    sums->bb += b * b;
    sums->pa += p * a;
    sums->pb_qa += p * b + q * a;
    sums->qb += q * b;
}

/* Computes bend = (L, M, N) from the normal equations
 *     (aa, ab, 0; ab, aa + bb, ab; 0, ab, bb) (L, M, N) = (pa, pb + qa, qb). */
static void solve(const struct sums *s, float ret[3]) {
    double slack = 1e-9 * (s->aa + s->bb) + G_MINDOUBLE;
    double aa = s->aa + slack, bb = s->bb + slack, ab = s->ab;
    double middle = aa + bb - ab * ab / aa - ab * ab / bb;
    double m = middle > slack ? (s->pb_qa - ab * s->pa / aa - ab * s->qb / bb) / middle : 0.0;
    ret[0] = (s->pa - ab * m) / aa;
    ret[1] = m;
    ret[2] = (s->qb - ab * m) / bb;
    for (int k = 0; k < 3; k++)
        if (!isfinite(ret[k]))
            ret[k] = 0.0f;
}

/* Adds the change of ln scale along an edge to the sums ga and gb. */
static void add_change(const struct mesh *mesh, const struct vertex_shape *shapes, guint32 at,
                       guint32 from, guint32 to, struct sums *sums) {
    float edge[3], side[3];
    double along[2];
    float3_minus(mesh->vertices[to].position, mesh->vertices[from].position, edge);
    components(&mesh->vertices[at], edge, side, along);
    for (int c = 0; c < 2; c++) {
        const double change = log((double)shapes[to].scale[c] / shapes[from].scale[c]);
        sums->ga[c] += change * along[0];
        sums->gb[c] += change * along[1];
    }
}

/* Computes stretch from (aa, ab; ab, bb) (∂t, ∂b) = (ga, gb), for each of the two scales. ∂t and ∂b
 * are the derivatives of ln scale along tangent and bitangent. */
static void solve_stretch(const struct sums *s, float ret[4]) {
    const double determinant = s->aa * s->bb - s->ab * s->ab;
    const double size = (s->aa + s->bb) * (s->aa + s->bb);
    for (int c = 0; c < 2 && determinant > 1e-9 * size; c++) {
        ret[2 * c] = (float)((s->bb * s->ga[c] - s->ab * s->gb[c]) / determinant);
        ret[2 * c + 1] = (float)((s->aa * s->gb[c] - s->ab * s->ga[c]) / determinant);
    }
    for (int k = 0; k < 4; k++)
        if (!isfinite(ret[k]))
            ret[k] = 0.0F;
}

struct vertex_shape *mesh_shapes(const struct mesh *mesh) {
    g_autofree struct sums *sums = g_new0(struct sums, MAX(mesh->n_vertices, 1));
    struct vertex_shape *shapes = g_new0(struct vertex_shape, MAX(mesh->n_vertices, 1));
    for (guint k = 0; k + 2 < mesh->n_indices; k += 3) {
        const struct vertex *v[3];
        struct sums *to[3];
        for (int c = 0; c < 3; c++) {
            v[c] = &mesh->vertices[mesh->indices[k + c]];
            to[c] = &sums[mesh->indices[k + c]];
        }
        add_scale(v, to);
        for (int c = 0; c < 3; c++)
            for (int e = 0; e < 3; e++)
                add_edge(v[c], v[e], v[(e + 1) % 3], to[c]);
    }
    for (guint k = 0; k < mesh->n_vertices; k++) {
        const struct sums *s = &sums[k];
        for (int c = 0; c < 2; c++)
            shapes[k].scale[c] = MAX(s->area > 0.0f ? s->scale[c] / s->area : 1.0f, MIN_SCALE);
        solve(s, shapes[k].bend);
    }
    for (guint k = 0; k + 2 < mesh->n_indices; k += 3)
        for (int c = 0; c < 3; c++)
            for (int e = 0; e < 3; e++) {
                const guint32 *at = mesh->indices + k;
                add_change(mesh, shapes, at[c], at[e], at[(e + 1) % 3], &sums[at[c]]);
            }
    for (guint k = 0; k < mesh->n_vertices; k++)
        solve_stretch(&sums[k], shapes[k].stretch);
    return shapes;
}
