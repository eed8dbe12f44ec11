/* The triangles of a glTF 2.0 file, where its scene puts them; skins and morphs are as they rest.
 */
#include "gltf_file.h"
#include "soup.h"

#include <math.h>
#include <string.h>

#define MAX_NODES 100000 /* visited: a file's nodes may name each other in a circle */
#define MAX_LEVEL 64

struct reader {
    struct gltf gltf;
    enum scene_up up;
    struct soup soup;
    int n_visited;
};

struct transform {
    double m[4][4]; /* [row][column] */
};

/* The attributes of a primitive's vertices, and its indices. */
enum { POSITION, NORMAL, UV, TANGENT, N_ATTRIBUTES, INDICES = N_ATTRIBUTES };
struct attributes {
    GArray *of[N_ATTRIBUTES + 1]; /* NULL: nothing */
};

static const struct transform identity = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}};

static struct transform transform_product(const struct transform *outer,
                                          const struct transform *inner) {
    struct transform p = {{{0}}};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            for (int k = 0; k < 4; k++)
                p.m[i][j] += outer->m[i][k] * inner->m[k][j];
    return p;
}

static gboolean numbers(JsonObject *node, const char *name, double *values, guint n) {
    JsonArray *array = gltf_array(node, name);
    if (array == NULL || json_array_get_length(array) != n)
        return FALSE;
    for (guint k = 0; k < n; k++) {
        JsonNode *value = json_array_get_element(array, k);
        if (!JSON_NODE_HOLDS_VALUE(value))
            return FALSE;
        values[k] = json_node_get_double(value);
    }
    return TRUE;
}

/* A node's matrix, in columns, or its translation, rotation and scale. */
static struct transform gltf_transform_of(JsonObject *node) {
    double c[16], t[3] = {0, 0, 0}, q[4] = {0, 0, 0, 1}, s[3] = {1, 1, 1};
    struct transform p = identity;
    if (numbers(node, "matrix", c, 16)) {
        for (int k = 0; k < 16; k++)
            p.m[k % 4][k / 4] = c[k];
        return p;
    }
    numbers(node, "translation", t, 3);
    numbers(node, "rotation", q, 4);
    numbers(node, "scale", s, 3);
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    const double turn[3][3] = {
        {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
        {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
        {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)},
    };
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            p.m[i][j] = turn[i][j] * s[j];
        p.m[i][3] = t[i];
    }
    return p;
}

static void move_point(const struct transform *p, const float v[3], double w, float ret[3]) {
    for (int i = 0; i < 3; i++)
        ret[i] =
            (float)(p->m[i][0] * v[0] + p->m[i][1] * v[1] + p->m[i][2] * v[2] + p->m[i][3] * w);
}

/* Transforms by the cofactors, so that a normal stays perpendicular to the surface. */
static void move_normal(const struct transform *p, const float v[3], float ret[3]) {
    for (int i = 0; i < 3; i++) {
        const int a = (i + 1) % 3, b = (i + 2) % 3;
        double sum = 0.0;
        for (int j = 0; j < 3; j++) {
            const int c = (j + 1) % 3, d = (j + 2) % 3;
            sum += (p->m[a][c] * p->m[b][d] - p->m[a][d] * p->m[b][c]) * v[j];
        }
        ret[i] = (float)sum;
    }
}

static double determinant(const struct transform *p) {
    double sum = 0.0;
    for (int j = 0; j < 3; j++) {
        const int c = (j + 1) % 3, d = (j + 2) % 3;
        sum += p->m[0][j] * (p->m[1][c] * p->m[2][d] - p->m[1][d] * p->m[2][c]);
    }
    return sum;
}

static const float *row_of(const GArray *array, gsize k, int n) {
    return (const float *)(const void *)array->data + k * (gsize)n;
}

/* One vertex of the file: its position and attributes. glTF's v runs downwards. */
static void gltf_add_vertex(struct reader *r, const struct transform *p, const struct attributes *a,
                            gsize k) {
    float position[3], normal[3] = {0, 0, 0}, tangent[4] = {0, 0, 0, 0};
    const float *uv = row_of(a->of[UV], k, 2), turned[2] = {uv[0], 1.0f - uv[1]};
    const float mirrored = determinant(p) < 0.0 ? -1.0f : 1.0f;
    move_point(p, row_of(a->of[POSITION], k, 3), 1.0, position);
    if (a->of[NORMAL] != NULL)
        move_normal(p, row_of(a->of[NORMAL], k, 3), normal);
    if (a->of[TANGENT] != NULL) {
        const float *own = row_of(a->of[TANGENT], k, 4);
        move_point(p, own, 0.0, tangent);
        tangent[3] = own[3] * mirrored;
    }
    for (int c = 0; c < 3; c++)
        normal[c] *= mirrored;
    if (r->up == SCENE_Y_UP) {
        soup_y_to_z_up(position);
        soup_y_to_z_up(normal);
        soup_y_to_z_up(tangent);
    }
    g_array_append_vals(r->soup.positions, position, 1);
    g_array_append_vals(r->soup.normals, normal, 1);
    g_array_append_vals(r->soup.uvs, turned, 1);
    g_array_append_vals(r->soup.tangents, tangent, 1);
}

static gboolean add_triangle(struct reader *r, const struct transform *p,
                             const struct attributes *a, guint first, const gsize at[3],
                             GError **error) {
    const int three = 3;
    const gboolean turned = determinant(p) < 0.0;
    if (r->soup.corners->len >= SOUP_MAX_CORNERS || r->soup.positions->len >= SCENE_MAX_VERTICES)
        return gltf_fail(&r->gltf, SCENE_ERROR_TOO_LARGE, error,
                         "it has too many triangles; simplify the mesh");
    for (int c = 0; c < 3; c++) {
        const gsize k = at[turned ? 2 - c : c];
        gint32 v = (gint32)(first + k);
        if (a->of[NORMAL] == NULL) { /* flat: no corner is another's */
            v = (gint32)r->soup.positions->len;
            gltf_add_vertex(r, p, a, k);
        }
        const struct soup_corner corner = {v, v, a->of[NORMAL] != NULL ? v : -1};
        g_array_append_val(r->soup.corners, corner);
    }
    g_array_append_val(r->soup.polygons, three);
    return TRUE;
}

/* mode 4: triangles, 5: a strip, 6: a fan. */
static gboolean add_triangles(struct reader *r, const struct transform *p,
                              const struct attributes *a, gint64 mode, GError **error) {
    const gsize n_vertices = a->of[POSITION]->len / 3;
    const gsize n = a->of[INDICES] != NULL ? a->of[INDICES]->len : n_vertices;
    const guint first = r->soup.positions->len;
    if (first + n_vertices > SCENE_MAX_VERTICES)
        return gltf_fail(&r->gltf, SCENE_ERROR_TOO_LARGE, error, "it has too many vertices");
    for (gsize k = 0; a->of[NORMAL] != NULL && k < n_vertices; k++)
        gltf_add_vertex(r, p, a, k);
    for (gsize k = 0; k + 2 < n; k += mode == 4 ? 3 : 1) {
        const gboolean swapped = mode == 5 && k % 2 == 1;
        gsize at[3] = {mode == 6 ? 0 : k, k + 1, k + 2};
        if (swapped) {
            at[0] = k + 1;
            at[1] = k;
        }
        for (int c = 0; c < 3 && a->of[INDICES] != NULL; c++)
            at[c] = g_array_index(a->of[INDICES], guint32, at[c]);
        if (MAX(MAX(at[0], at[1]), at[2]) >= n_vertices)
            return gltf_bad(&r->gltf, error, "an index names a vertex that does not exist");
        if (!add_triangle(r, p, a, first, at, error))
            return FALSE;
    }
    return TRUE;
}

static gboolean gltf_read_attributes(struct reader *r, JsonObject *primitive, struct attributes *a,
                                     GError **error) {
    static const char *const names[] = {"POSITION", "NORMAL", "TEXCOORD_0", "TANGENT"};
    static const int n_numbers[] = {3, 3, 2, 4};
    JsonObject *of = gltf_object(primitive, "attributes");
    for (int k = 0; k < N_ATTRIBUTES; k++)
        if (of != NULL && json_object_has_member(of, names[k]) &&
            (a->of[k] = gltf_floats(&r->gltf, gltf_int(of, names[k], -1), n_numbers[k], error)) ==
                NULL)
            return FALSE;
    if (a->of[POSITION] == NULL)
        return gltf_bad(&r->gltf, error, "a primitive has no positions");
    if (a->of[UV] == NULL)
        return gltf_fail(&r->gltf, SCENE_ERROR_NO_TEXTURE, error,
                         "a mesh has no texture coordinates (TEXCOORD_0); unwrap it and save it "
                         "with them");
    for (int k = 1; k < N_ATTRIBUTES; k++)
        if (a->of[k] != NULL && a->of[k]->len / n_numbers[k] != a->of[POSITION]->len / 3)
            return gltf_bad(&r->gltf, error, "a primitive's attributes differ in number");
    if (!json_object_has_member(primitive, "indices"))
        return TRUE;
    a->of[INDICES] = gltf_indices(&r->gltf, gltf_int(primitive, "indices", -1), error);
    return a->of[INDICES] != NULL;
}

static gboolean add_primitive(struct reader *r, const struct transform *p, JsonObject *primitive,
                              GError **error) {
    const gint64 mode = gltf_int(primitive, "mode", 4);
    struct attributes a = {{NULL}};
    if (mode >= 0 && mode < 4) /* points and lines have no surface */
        return TRUE;
    if (mode < 0 || mode > 6)
        return gltf_bad(&r->gltf, error, "a primitive has no known mode");
    const gboolean good =
        gltf_read_attributes(r, primitive, &a, error) && add_triangles(r, p, &a, mode, error);
    for (gsize k = 0; k < G_N_ELEMENTS(a.of); k++)
        g_clear_pointer(&a.of[k], g_array_unref);
    return good;
}

static gboolean add_mesh(struct reader *r, const struct transform *p, gint64 k, GError **error) {
    JsonObject *mesh = gltf_item(&r->gltf, "meshes", k, error);
    JsonArray *primitives = mesh != NULL ? gltf_array(mesh, "primitives") : NULL;
    if (mesh == NULL)
        return FALSE;
    for (guint i = 0; primitives != NULL && i < json_array_get_length(primitives); i++) {
        JsonNode *node = json_array_get_element(primitives, i);
        if (!JSON_NODE_HOLDS_OBJECT(node))
            return gltf_bad(&r->gltf, error, "a primitive is not an object");
        if (!add_primitive(r, p, json_node_get_object(node), error))
            return FALSE;
    }
    return TRUE;
}

// NOLINTNEXTLINE(misc-no-recursion): at most MAX_LEVEL deep
static gboolean add_nodes(struct reader *r, const struct transform *outer, JsonArray *nodes,
                          int level, GError **error) {
    for (guint k = 0; nodes != NULL && k < json_array_get_length(nodes); k++) {
        JsonNode *index = json_array_get_element(nodes, k);
        const gint64 at = JSON_NODE_HOLDS_VALUE(index) ? json_node_get_int(index) : -1;
        JsonObject *node = gltf_item(&r->gltf, "nodes", at, error);
        if (node == NULL)
            return FALSE;
        if (++r->n_visited > MAX_NODES || level > MAX_LEVEL)
            return gltf_bad(&r->gltf, error, "its nodes form a cycle");
        const struct transform own = gltf_transform_of(node), p = transform_product(outer, &own);
        if ((json_object_has_member(node, "mesh") &&
             !add_mesh(r, &p, gltf_int(node, "mesh", -1), error)) ||
            !add_nodes(r, &p, gltf_array(node, "children"), level + 1, error))
            return FALSE;
    }
    return TRUE;
}

/* Its scene, or without one all meshes. */
static gboolean add_scene(struct reader *r, GError **error) {
    if (json_object_has_member(r->gltf.root, "scenes")) {
        JsonObject *scene =
            gltf_item(&r->gltf, "scenes", gltf_int(r->gltf.root, "scene", 0), error);
        return scene != NULL && add_nodes(r, &identity, gltf_array(scene, "nodes"), 0, error);
    }
    JsonArray *meshes = gltf_array(r->gltf.root, "meshes");
    for (guint k = 0; meshes != NULL && k < json_array_get_length(meshes); k++)
        if (!add_mesh(r, &identity, k, error))
            return FALSE;
    return TRUE;
}

struct mesh *scene_read_gltf(const char *path, enum scene_up up, GError **error) {
    struct reader r = {.up = up};
    struct mesh *mesh = NULL;
    soup_init(&r.soup);
    gboolean good = gltf_open(&r.gltf, path, error) && add_scene(&r, error);
    const float *values = (const float *)(const void *)r.soup.positions->data; /* or NULL */
    for (gsize k = 0; good && k < 3 * (gsize)r.soup.positions->len; k++)
        if (!(fabsf(values[k]) <= 1e18f))
            good = gltf_bad(&r.gltf, error, "a node puts its mesh infinitely far away");
    if (good && r.soup.polygons->len == 0)
        good = gltf_bad(&r.gltf, error, "there is no triangle in this file");
    if (good)
        mesh = soup_mesh(&r.soup, path, path, error);
    gltf_clear(&r.gltf);
    soup_clear(&r.soup);
    return mesh;
}
