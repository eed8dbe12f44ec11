#include "soup.h"

#include "float3.h"

#include <math.h>
#include <string.h>

struct builder {
    GArray *vertices, *indices, *corners, *next;
    /* For each position, the last vertex that was made from this position, or −1. `next` leads from
     * a vertex to the earlier vertices of the same position. */
    gint32 *first;
};

void soup_init(struct soup *soup) {
    *soup = (struct soup){.positions = g_array_new(FALSE, FALSE, 3 * sizeof(float)),
                          .normals = g_array_new(FALSE, FALSE, 3 * sizeof(float)),
                          .uvs = g_array_new(FALSE, FALSE, 2 * sizeof(float)),
                          .tangents = g_array_new(FALSE, FALSE, 4 * sizeof(float)),
                          .corners = g_array_new(FALSE, FALSE, sizeof(struct soup_corner)),
                          .polygons = g_array_new(FALSE, FALSE, sizeof(int))};
}

void soup_clear(struct soup *soup) {
    GArray *const arrays[] = {soup->positions, soup->normals, soup->uvs,
                              soup->tangents,  soup->corners, soup->polygons};
    for (gsize k = 0; k < G_N_ELEMENTS(arrays); k++)
        g_array_unref(arrays[k]);
    g_free(soup->smooth);
}

void soup_y_to_z_up(float values[3]) {
    const float y = values[1];
    values[1] = -values[2];
    values[2] = y;
}

static gboolean normalise(float a[3]) {
    float length = sqrtf(float3_dot(a, a));
    if (!(length > 1e-20f) || !isfinite(length))
        return FALSE;
    for (int k = 0; k < 3; k++)
        a[k] /= length;
    return TRUE;
}

static float *position(const struct soup *soup, int v) {
    return (float *)soup->positions->data + 3 * (gsize)v;
}

static const float *uv(const struct soup *soup, int vt) {
    return (const float *)soup->uvs->data + 2 * (gsize)vt;
}

/* Moves the middle of the bounding box to the origin and scales to radius 1. This is done before
 * anything else is computed, so that no later product can overflow. Fails if all positions are the
 * same. */
static gboolean soup_fit(struct soup *soup, const char *where, GError **error) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (guint c = 0; c < soup->corners->len; c++)
        for (int k = 0; k < 3; k++) {
            double x = position(soup, g_array_index(soup->corners, struct soup_corner, c).v)[k];
            low[k] = MIN(low[k], x);
            high[k] = MAX(high[k], x);
        }
    double radius = 0.0;
    for (guint c = 0; c < soup->corners->len; c++) {
        const float *p = position(soup, g_array_index(soup->corners, struct soup_corner, c).v);
        double sum = 0.0;
        for (int k = 0; k < 3; k++)
            sum += pow(p[k] - 0.5 * (low[k] + high[k]), 2.0);
        radius = MAX(radius, sqrt(sum));
    }
    if (!(radius > 1e-18)) {
        g_set_error(error, SCENE_ERROR, SCENE_ERROR_FORMAT,
                    "%s: all positions are the same; export an object that has a size", where);
        return FALSE;
    }
    for (guint v = 0; v < soup->positions->len; v++)
        for (int k = 0; k < 3; k++)
            position(soup, v)[k] = (position(soup, v)[k] - 0.5 * (low[k] + high[k])) / radius;
    return TRUE;
}

/* Computes a vector along the polygon's normal, with twice its area as length. */
static void polygon_normal(const struct soup *soup, const struct soup_corner *corners, int n,
                           float ret[3]) {
    memset(ret, 0, 3 * sizeof(float));
    const float *origin = position(soup, corners[0].v);
    for (int k = 1; k + 1 < n; k++) {
        float a[3], b[3], c[3];
        float3_minus(position(soup, corners[k].v), origin, a);
        float3_minus(position(soup, corners[k + 1].v), origin, b);
        float3_cross(a, b, c);
        for (int axis = 0; axis < 3; axis++)
            ret[axis] += c[axis];
    }
}

static void corner_normal(const struct soup *soup, const struct soup_corner *corner, float ret[3]) {
    if (corner->vn >= 0)
        memcpy(ret, (const float *)soup->normals->data + 3 * (gsize)corner->vn, 3 * sizeof(float));
    else
        memcpy(ret, soup->smooth + 3 * (gsize)corner->v, 3 * sizeof(float));
    if (!normalise(ret))
        memcpy(ret, (float[3]){0.0f, 0.0f, 1.0f}, 3 * sizeof(float));
}

/* Returns whether the order of a polygon's corners contradicts the normals of the corners. The
 * caller then takes the normals as correct. */
static gboolean wound_backwards(const struct soup *soup, const struct soup_corner *corners, int n) {
    float face[3], sum = 0.0f;
    polygon_normal(soup, corners, n, face);
    for (int k = 0; k < n; k++) {
        float normal[3];
        corner_normal(soup, &corners[k], normal);
        sum += float3_dot(face, normal);
    }
    return sum < 0.0f;
}

/* Returns the index of the vertex for a corner, and adds the vertex if there is none yet. Corners
 * share a vertex if position, texture coordinates, normal and sense are the same. sense is the
 * handedness of the texture, 1 or −1. */
static guint32 add_vertex(const struct soup *soup, struct builder *b,
                          const struct soup_corner *corner, float sense) {
    for (gint32 at = b->first[corner->v]; at >= 0; at = g_array_index(b->next, gint32, at)) {
        const struct soup_corner *other = &g_array_index(b->corners, struct soup_corner, at);
        if (other->vt == corner->vt && other->vn == corner->vn &&
            g_array_index(b->vertices, struct vertex, at).tangent[3] == sense)
            return at;
    }
    struct vertex vertex = {.tangent = {0.0f, 0.0f, 0.0f, sense}};
    memcpy(vertex.position, position(soup, corner->v), sizeof vertex.position);
    memcpy(vertex.uv, uv(soup, corner->vt), sizeof vertex.uv);
    corner_normal(soup, corner, vertex.normal);
    gint32 index = b->vertices->len;
    g_array_append_val(b->vertices, vertex);
    g_array_append_val(b->corners, *corner);
    g_array_append_val(b->next, b->first[corner->v]);
    b->first[corner->v] = index;
    return index;
}

/* Projects v onto the surface at a vertex, and sets ret to the unit vector of the result. Returns
 * FALSE if the result is 0. */
static gboolean along_surface(const struct vertex *vertex, const float v[3], float ret[3]) {
    float off = float3_dot(v, vertex->normal);
    for (int k = 0; k < 3; k++)
        ret[k] = v[k] - off * vertex->normal[k];
    return normalise(ret);
}

/* Returns the angle of a triangle at its corner v[c], seen along the normal of this vertex. Returns
 * 0 if an edge at this corner is parallel to the normal or has length 0. */
static float corner_angle(struct vertex *const v[3], int c) {
    float edges[2][3];
    for (int e = 0; e < 2; e++) {
        float edge[3];
        float3_minus(v[(c + 1 + e) % 3]->position, v[c]->position, edge);
        if (!along_surface(v[c], edge, edges[e]))
            return 0.0f;
    }
    return acosf(CLAMP(float3_dot(edges[0], edges[1]), -1.0f, 1.0f));
}

/* Adds dP/du of a triangle to the tangents of its corners. As in MikkTSpace, dP/du is normalised,
 * projected onto the surface at each corner, and weighted by the angle of the triangle there.
 * Normal maps and fibres of other programs therefore fit. */
static void add_tangent(struct builder *b, const guint32 index[3]) {
    struct vertex *v[3];
    for (int k = 0; k < 3; k++)
        v[k] = &g_array_index(b->vertices, struct vertex, index[k]);
    float du1 = v[1]->uv[0] - v[0]->uv[0], dv1 = v[1]->uv[1] - v[0]->uv[1];
    float du2 = v[2]->uv[0] - v[0]->uv[0], dv2 = v[2]->uv[1] - v[0]->uv[1];
    float area = du1 * dv2 - du2 * dv1, tangent[3];
    for (int k = 0; k < 3; k++)
        tangent[k] = (dv2 * (v[1]->position[k] - v[0]->position[k]) -
                      dv1 * (v[2]->position[k] - v[0]->position[k])) *
                     (area < 0.0f ? -1.0f : 1.0f);
    if (area == 0.0f || !normalise(tangent))
        return;
    for (int c = 0; c < 3; c++) {
        float turned[3], angle = corner_angle(v, c);
        for (int k = 0; k < 3 && along_surface(v[c], tangent, turned); k++)
            v[c]->tangent[k] += angle * turned[k];
    }
}

static void add_polygon(const struct soup *soup, struct builder *b,
                        const struct soup_corner *corners, int n) {
    gboolean backwards = wound_backwards(soup, corners, n);
    for (int k = 1; k + 1 < n; k++) {
        const struct soup_corner *c[3] = {&corners[0], &corners[backwards ? k + 1 : k],
                                          &corners[backwards ? k : k + 1]};
        const float *p = uv(soup, c[0]->vt), *q = uv(soup, c[1]->vt), *r = uv(soup, c[2]->vt);
        float area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        guint32 index[3];
        for (int i = 0; i < 3; i++)
            index[i] = add_vertex(soup, b, c[i], area < 0.0f ? -1.0f : 1.0f);
        g_array_append_vals(b->indices, index, 3);
        add_tangent(b, index);
    }
}

/* Completes the tangent of a vertex. own is the tangent in the file, or NULL if the file has none.
 * The tangent in the file takes precedence over the computed tangent. If there is neither, any
 * direction along the surface is used. */
static void finish_tangent(struct vertex *vertex, const float *own) {
    float *t = vertex->tangent, sum[3], axis[3] = {0.0f, 0.0f, 0.0f}, side[3];
    memcpy(sum, t, sizeof sum);
    if (own != NULL && own[3] != 0.0f && along_surface(vertex, own, side)) {
        memcpy(t, side, sizeof side);
        t[3] = own[3] < 0.0f ? -1.0f : 1.0f;
    } else if (!along_surface(vertex, sum, t)) {
        axis[fabsf(vertex->normal[0]) < 0.7f ? 0 : 1] = 1.0f;
        float3_cross(vertex->normal, axis, side);
        float3_cross(side, vertex->normal, t);
        normalise(t);
    }
}

static struct mesh *build(struct soup *soup, const char *name) {
    struct builder b = {g_array_new(FALSE, FALSE, sizeof(struct vertex)),
                        g_array_new(FALSE, FALSE, sizeof(guint32)),
                        g_array_new(FALSE, FALSE, sizeof(struct soup_corner)),
                        g_array_new(FALSE, FALSE, sizeof(gint32)),
                        g_new(gint32, soup->positions->len)};
    memset(b.first, 0xff, sizeof(gint32) * (gsize)soup->positions->len);
    const struct soup_corner *corners = (const struct soup_corner *)soup->corners->data;
    for (guint p = 0; p < soup->polygons->len; p++) {
        int n = g_array_index(soup->polygons, int, p);
        add_polygon(soup, &b, corners, n);
        corners += n;
    }
    const float *own = (const float *)(gpointer)soup->tangents->data;
    for (guint k = 0; k < b.vertices->len; k++) {
        const gsize from = (gsize)g_array_index(b.corners, struct soup_corner, k).v;
        finish_tangent(&g_array_index(b.vertices, struct vertex, k),
                       soup->tangents->len > 0 ? own + 4 * from : NULL);
    }
    struct mesh *mesh = g_new0(struct mesh, 1);
    mesh->name = g_strdup(name);
    mesh->n_vertices = b.vertices->len;
    mesh->n_indices = b.indices->len;
    mesh->vertices = (struct vertex *)g_array_free(b.vertices, FALSE);
    mesh->indices = (guint32 *)g_array_free(b.indices, FALSE);
    mesh->radius = 1.0f;
    mesh->tiles_u = mesh->tiles_v = 1.0;
    g_array_unref(b.corners);
    g_array_unref(b.next);
    g_free(b.first);
    return mesh;
}

struct mesh *soup_mesh(struct soup *soup, const char *name, const char *where, gboolean fit,
                       GError **error) {
    if (fit && !soup_fit(soup, where, error))
        return NULL;
    soup->smooth = g_new0(float, 3 * (gsize)soup->positions->len);
    const struct soup_corner *corners = (const struct soup_corner *)soup->corners->data;
    for (guint p = 0; p < soup->polygons->len; p++) {
        int n = g_array_index(soup->polygons, int, p);
        float normal[3];
        polygon_normal(soup, corners, n, normal);
        for (int k = 0; k < n; k++)
            for (int axis = 0; axis < 3; axis++)
                soup->smooth[3 * (gsize)corners[k].v + axis] += normal[axis];
        corners += n;
    }
    struct mesh *mesh = build(soup, name);
    for (guint k = 0; !fit && k < mesh->n_vertices; k++) {
        const float *at = mesh->vertices[k].position, radius = sqrtf(float3_dot(at, at));
        mesh->radius = k == 0 ? radius : MAX(mesh->radius, radius);
    }
    return mesh;
}
