/* Reads the triangles of a glTF 2.0 file, transformed by the nodes of its scene. Skins and morph
 * targets stay in their rest state. */
#include "gltf_nodes.h"

#include <math.h>

struct reader {
    struct gltf *gltf;
    enum scene_up up;
    gboolean bare;
    struct soup *soup;
};

/* The attributes of a primitive's vertices, and its indices. */
enum { POSITION, NORMAL, UV, TANGENT, N_ATTRIBUTES, INDICES = N_ATTRIBUTES };
struct attributes {
    GArray *of[N_ATTRIBUTES +
               1]; /* numbers of each attribute, and the indices last; NULL if there are none */
};

static const float *row_of(const GArray *array, gsize k, int n) {
    return (const float *)(const void *)array->data + k * (gsize)n;
}

/* Adds vertex k of the primitive, with its position and attributes. The texture coordinate v is
 * flipped, because v of glTF increases downwards. */
static void add_vertex(struct reader *r, const struct gltf_transform *p, const struct attributes *a,
                       gsize k) {
    float position[3], normal[3] = {0, 0, 0}, tangent[4] = {0, 0, 0, 0};
    float turned[2] = {0.0f, 0.0f};
    const float mirrored = gltf_determinant(p) < 0.0 ? -1.0f : 1.0f;
    gltf_move_point(p, row_of(a->of[POSITION], k, 3), 1.0, position);
    if (a->of[UV] != NULL) {
        turned[0] = row_of(a->of[UV], k, 2)[0];
        turned[1] = 1.0f - row_of(a->of[UV], k, 2)[1];
    }
    if (a->of[NORMAL] != NULL)
        gltf_move_normal(p, row_of(a->of[NORMAL], k, 3), normal);
    if (a->of[TANGENT] != NULL) {
        const float *own = row_of(a->of[TANGENT], k, 4);
        gltf_move_point(p, own, 0.0, tangent);
        tangent[3] = own[3] * mirrored;
    }
    for (int c = 0; c < 3; c++)
        normal[c] *= mirrored;
    if (r->up == SCENE_Y_UP) {
        soup_y_to_z_up(position);
        soup_y_to_z_up(normal);
        soup_y_to_z_up(tangent);
    }
    g_array_append_vals(r->soup->positions, position, 1);
    g_array_append_vals(r->soup->normals, normal, 1);
    g_array_append_vals(r->soup->uvs, turned, 1);
    g_array_append_vals(r->soup->tangents, tangent, 1);
}

static gboolean add_triangle(struct reader *r, const struct gltf_transform *p,
                             const struct attributes *a, guint first, const gsize at[3],
                             GError **error) {
    const int three = 3;
    const gboolean turned = gltf_determinant(p) < 0.0;
    if (r->soup->corners->len >= SOUP_MAX_CORNERS || r->soup->positions->len >= SCENE_MAX_VERTICES)
        return gltf_fail(r->gltf, SCENE_ERROR_TOO_LARGE, error,
                         "it has more than %d triangles or %d vertices; simplify the mesh",
                         SOUP_MAX_CORNERS / 3, SCENE_MAX_VERTICES);
    for (int c = 0; c < 3; c++) {
        const gsize k = at[turned ? 2 - c : c];
        gint32 v = (gint32)(first + k);
        if (a->of[NORMAL] == NULL) { /* flat shading: corners are not shared */
            v = (gint32)r->soup->positions->len;
            add_vertex(r, p, a, k);
        }
        const struct soup_corner corner = {v, v, a->of[NORMAL] != NULL ? v : -1};
        g_array_append_val(r->soup->corners, corner);
    }
    g_array_append_val(r->soup->polygons, three);
    return TRUE;
}

/* Adds triangles. mode is that of glTF: 4 for triangles, 5 for a strip, 6 for a fan. */
static gboolean add_triangles(struct reader *r, const struct gltf_transform *p,
                              const struct attributes *a, gint64 mode, GError **error) {
    const gsize n_vertices = a->of[POSITION]->len / 3;
    const gsize n = a->of[INDICES] != NULL ? a->of[INDICES]->len : n_vertices;
    const guint first = r->soup->positions->len;
    if (first + n_vertices > SCENE_MAX_VERTICES)
        return gltf_fail(r->gltf, SCENE_ERROR_TOO_LARGE, error,
                         "it has more than %d vertices; simplify the mesh", SCENE_MAX_VERTICES);
    for (gsize k = 0; a->of[NORMAL] != NULL && k < n_vertices; k++)
        add_vertex(r, p, a, k);
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
            return gltf_bad(r->gltf, error,
                            "an index names vertex %zu, but the primitive has %zu vertices, "
                            "counted from 0; export the file again",
                            MAX(MAX(at[0], at[1]), at[2]), n_vertices);
        if (!add_triangle(r, p, a, first, at, error))
            return FALSE;
    }
    return TRUE;
}

static gboolean read_attributes(struct reader *r, JsonObject *primitive, struct attributes *a,
                                GError **error) {
    static const char *const names[] = {"POSITION", "NORMAL", "TEXCOORD_0", "TANGENT"};
    static const int n_numbers[] = {3, 3, 2, 4};
    JsonObject *of = gltf_object(primitive, "attributes");
    for (int k = 0; k < N_ATTRIBUTES; k++)
        if (of != NULL && json_object_has_member(of, names[k]) &&
            (a->of[k] = gltf_floats(r->gltf, gltf_int(of, names[k], -1), n_numbers[k], error)) ==
                NULL)
            return FALSE;
    if (a->of[POSITION] == NULL)
        return gltf_bad(r->gltf, error,
                        "a primitive has no positions (POSITION); export the file again");
    if (a->of[UV] == NULL && !r->bare)
        return gltf_fail(
            r->gltf, SCENE_ERROR_NO_TEXTURE, error,
            "a mesh has no texture coordinates (TEXCOORD_0); unwrap it and save it again");
    for (int k = 1; k < N_ATTRIBUTES; k++)
        if (a->of[k] != NULL && a->of[k]->len / n_numbers[k] != a->of[POSITION]->len / 3)
            return gltf_bad(r->gltf, error,
                            "the attribute %s of a primitive has %u elements, but its POSITION has "
                            "%u; export the file again",
                            names[k], a->of[k]->len / n_numbers[k], a->of[POSITION]->len / 3);
    if (!json_object_has_member(primitive, "indices"))
        return TRUE;
    a->of[INDICES] = gltf_indices(r->gltf, gltf_int(primitive, "indices", -1), error);
    return a->of[INDICES] != NULL;
}

gboolean gltf_add_primitive(struct gltf *gltf, const struct gltf_transform *p,
                            JsonObject *primitive, enum scene_up up, gboolean bare,
                            struct soup *soup, GError **error) {
    const gint64 mode = gltf_int(primitive, "mode", 4);
    struct reader r = {gltf, up, bare, soup};
    struct attributes a = {{NULL}};
    if (mode >= 0 && mode < 4) /* points and lines have no surface */
        return TRUE;
    if (mode < 0 || mode > 6)
        return gltf_bad(gltf, error,
                        "a primitive has the mode %" G_GINT64_FORMAT
                        "; 0 to 6 are known; export the file again",
                        mode);
    const gboolean good =
        read_attributes(&r, primitive, &a, error) && add_triangles(&r, p, &a, mode, error);
    for (gsize k = 0; k < G_N_ELEMENTS(a.of); k++)
        g_clear_pointer(&a.of[k], g_array_unref);
    return good;
}

gboolean gltf_check_positions(const struct gltf *gltf, const struct soup *soup, GError **error) {
    /* values is NULL if there are no positions. */
    const float *values = (const float *)(const void *)soup->positions->data;
    for (gsize k = 0; k < 3 * (gsize)soup->positions->len; k++)
        if (!(fabsf(values[k]) <= 1e18f))
            return gltf_bad(gltf, error,
                            "a coordinate is %g after the transforms of the nodes, but must be "
                            "within ±1e18; correct the nodes' scales and translations",
                            (double)values[k]);
    return TRUE;
}

/* Data of whole_visit(): all triangles so far in one soup, and the transform p of the node that is
 * being visited. */
struct whole {
    const struct gltf_transform *p;
    enum scene_up up;
    struct soup soup;
};

static gboolean whole_add(struct gltf *gltf, JsonObject *primitive, gpointer data, GError **error) {
    struct whole *whole = data;
    return gltf_add_primitive(gltf, whole->p, primitive, whole->up, FALSE, &whole->soup, error);
}

static gboolean whole_visit(struct gltf *gltf, const struct gltf_transform *p, JsonObject *node,
                            gint64 mesh, gpointer data, GError **error) {
    struct whole *whole = data;
    whole->p = p;
    return mesh < 0 || gltf_each_primitive(gltf, mesh, whole_add, whole, error);
}

struct mesh *scene_read_gltf(const char *path, enum scene_up up, GError **error) {
    struct whole whole = {.up = up};
    struct gltf gltf;
    struct mesh *mesh = NULL;
    soup_init(&whole.soup);
    gboolean good = gltf_open(&gltf, path, error) &&
                    gltf_visit(&gltf, whole_visit, &whole, error) &&
                    gltf_check_positions(&gltf, &whole.soup, error);
    if (good && whole.soup.polygons->len == 0)
        good = gltf_bad(&gltf, error, "the scene has no triangles; export at least one mesh");
    if (good)
        mesh = soup_mesh(&whole.soup, path, path, TRUE, error);
    gltf_clear(&gltf);
    soup_clear(&whole.soup);
    return mesh;
}
