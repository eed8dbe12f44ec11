/* The nodes of a glTF file's scene. Skins and morph targets stay in their rest state. */
#include "gltf_nodes.h"

#include <math.h>

#define MAX_NODES 100000 /* a limit, because a file's nodes may refer to each other in a circle */
#define MAX_LEVEL 64

struct walk {
    struct gltf *gltf;
    GltfVisit visit;
    gpointer data;
    int n_visited;
};

static const struct gltf_transform identity = {
    {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}};

static struct gltf_transform product(const struct gltf_transform *outer,
                                     const struct gltf_transform *inner) {
    struct gltf_transform p = {{{0}}};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            for (int k = 0; k < 4; k++)
                p.m[i][j] += outer->m[i][k] * inner->m[k][j];
    return p;
}

gboolean gltf_numbers(JsonObject *node, const char *name, double *values, guint n) {
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

/* Returns the transform of a node. If the node has a matrix, this is the transform; the file stores
 * it column by column. Otherwise the transform is the product of translation, rotation and scale.
 */
static struct gltf_transform transform(JsonObject *node) {
    double c[16], t[3] = {0, 0, 0}, q[4] = {0, 0, 0, 1}, s[3] = {1, 1, 1};
    struct gltf_transform p = identity;
    if (gltf_numbers(node, "matrix", c, 16)) {
        for (int k = 0; k < 16; k++)
            p.m[k % 4][k / 4] = c[k];
        return p;
    }
    gltf_numbers(node, "translation", t, 3);
    gltf_numbers(node, "rotation", q, 4);
    gltf_numbers(node, "scale", s, 3);
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

void gltf_move_point(const struct gltf_transform *p, const float v[3], double w, float ret[3]) {
    for (int i = 0; i < 3; i++)
        ret[i] =
            (float)(p->m[i][0] * v[0] + p->m[i][1] * v[1] + p->m[i][2] * v[2] + p->m[i][3] * w);
}

void gltf_move_normal(const struct gltf_transform *p, const float v[3], float ret[3]) {
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

double gltf_determinant(const struct gltf_transform *p) {
    double sum = 0.0;
    for (int j = 0; j < 3; j++) {
        const int c = (j + 1) % 3, d = (j + 2) % 3;
        sum += p->m[0][j] * (p->m[1][c] * p->m[2][d] - p->m[1][d] * p->m[2][c]);
    }
    return sum;
}

// NOLINTNEXTLINE(misc-no-recursion): at most MAX_LEVEL deep
static gboolean visit_nodes(struct walk *walk, const struct gltf_transform *outer, JsonArray *nodes,
                            int level, GError **error) {
    for (guint k = 0; nodes != NULL && k < json_array_get_length(nodes); k++) {
        JsonNode *index = json_array_get_element(nodes, k);
        const gint64 at = JSON_NODE_HOLDS_VALUE(index) ? json_node_get_int(index) : -1;
        JsonObject *node = gltf_item(walk->gltf, "nodes", at, error);
        if (node == NULL)
            return FALSE;
        if (level > MAX_LEVEL)
            return gltf_bad(walk->gltf, error,
                            "its nodes form a cycle, or are nested more than %d deep; correct or "
                            "simplify the hierarchy",
                            MAX_LEVEL);
        if (++walk->n_visited > MAX_NODES)
            return gltf_bad(walk->gltf, error,
                            "its nodes form a cycle, or there are more than %d nodes; correct or "
                            "simplify the hierarchy",
                            MAX_NODES);
        const struct gltf_transform own = transform(node);
        const struct gltf_transform p = product(outer, &own);
        gint64 mesh = gltf_int(node, "mesh", -1);
        if (mesh < 0 && json_object_has_member(node, "mesh"))
            mesh = G_MAXINT; /* no file has a mesh of this number, so visit() fails with an error */
        if (!walk->visit(walk->gltf, &p, node, mesh, walk->data, error) ||
            !visit_nodes(walk, &p, gltf_array(node, "children"), level + 1, error))
            return FALSE;
    }
    return TRUE;
}

gboolean gltf_visit(struct gltf *gltf, GltfVisit visit, gpointer data, GError **error) {
    struct walk walk = {gltf, visit, data, 0};
    if (json_object_has_member(gltf->root, "scenes")) {
        JsonObject *scene = gltf_item(gltf, "scenes", gltf_int(gltf->root, "scene", 0), error);
        return scene != NULL && visit_nodes(&walk, &identity, gltf_array(scene, "nodes"), 0, error);
    }
    JsonArray *meshes = gltf_array(gltf->root, "meshes");
    for (guint k = 0; meshes != NULL && k < json_array_get_length(meshes); k++)
        if (!visit(gltf, &identity, NULL, k, data, error))
            return FALSE;
    return TRUE;
}

gboolean gltf_each_primitive(struct gltf *gltf, gint64 k, GltfUse use, gpointer data,
                             GError **error) {
    JsonObject *mesh = gltf_item(gltf, "meshes", k, error);
    JsonArray *primitives = mesh != NULL ? gltf_array(mesh, "primitives") : NULL;
    if (mesh == NULL)
        return FALSE;
    for (guint i = 0; primitives != NULL && i < json_array_get_length(primitives); i++) {
        JsonNode *node = json_array_get_element(primitives, i);
        if (!JSON_NODE_HOLDS_OBJECT(node))
            return gltf_bad(gltf, error,
                            "primitive %u of mesh %" G_GINT64_FORMAT
                            " is not a JSON object; export the file again",
                            i, k);
        if (!use(gltf, json_node_get_object(node), data, error))
            return FALSE;
    }
    return TRUE;
}
