#include "scene_parts.h"

#include "gltf_scene.h"

#include <math.h>
#include <string.h>

/* Two limits for a floor, relative to the diagonal of the base of the scene: the largest difference
 * of height within the floor, and the largest distance of its sides from the sides of the scene. */
#define FLAT 1e-4

gboolean scene_binding_parse(const char *text, struct scene_binding *ret, GError **error) {
    const char *equals = strchr(text, '=');
    *ret = (struct scene_binding){.tiles = 1.0};
    if (equals == NULL || equals == text || equals[1] == '\0') {
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                    "--material %s: give NAME=PATH or NAME=PATH,TILES", text);
        return FALSE;
    }
    ret->name = g_strndup(text, (gsize)(equals - text));
    ret->path = g_strdup(equals + 1);
    char *comma = strrchr(ret->path, ','), *end;
    const double number = comma != NULL ? g_ascii_strtod(comma + 1, &end) : 0.0;
    if (comma != NULL && end != comma + 1 && *end == '\0') {
        ret->tiles = number;
        *comma = '\0';
    }
    return TRUE;
}

void scene_binding_clear(struct scene_binding *binding) {
    g_clear_pointer(&binding->name, g_free);
    g_clear_pointer(&binding->path, g_free);
}

struct parts {
    const struct gltf_scene *scene;
    const struct scene_binding *bindings;
    guint n_bindings;
    gboolean *floor;       /* whether each part of the scene belongs to the floor */
    float low[3], high[3]; /* corners of the bounding box that parts_box() found */
};

static const struct gltf_part *parts_at(const struct parts *p, guint k) {
    return p->scene->parts->pdata[k];
}

static const char *part_name(const struct parts *p, guint k) {
    const int material = parts_at(p, k)->material;
    return material < 0 ? ""
                        : g_array_index(p->scene->materials, struct gltf_material, material).name;
}

static int part_material(const struct parts *p, guint k) {
    for (guint b = 0; b < p->n_bindings; b++)
        if (g_str_equal(p->bindings[b].name, part_name(p, k)))
            return (int)b + 1;
    return 0;
}

static char *parts_names(const struct parts *p) {
    GString *names = g_string_new(NULL);
    for (guint k = 0; k < p->scene->materials->len; k++)
        g_string_append_printf(names, "%s“%s”", k > 0 ? ", " : "",
                               g_array_index(p->scene->materials, struct gltf_material, k).name);
    return g_string_free(names, FALSE);
}

/* Checks that a mesh has the material of each binding, and that all meshes with these materials
 * have texture coordinates. */
static gboolean parts_check(const struct parts *p, const char *path, GError **error) {
    for (guint b = 0; b < p->n_bindings; b++) {
        gboolean found = FALSE;
        for (guint k = 0; k < p->scene->parts->len; k++) {
            if (part_material(p, k) != (int)b + 1)
                continue;
            found = TRUE;
            if (parts_at(p, k)->texture)
                continue;
            g_set_error(error, SCENE_ERROR, SCENE_ERROR_NO_TEXTURE,
                        "%s: the mesh “%s” of material “%s” has no texture coordinates "
                        "(TEXCOORD_0); unwrap it and save it again",
                        path, parts_at(p, k)->name, p->bindings[b].name);
            return FALSE;
        }
        if (!found) {
            g_autofree char *names = parts_names(p);
            gboolean twice = FALSE;
            for (guint a = 0; a < b; a++)
                twice |= g_str_equal(p->bindings[a].name, p->bindings[b].name);
            if (twice)
                g_set_error(error, SCENE_ERROR, SCENE_ERROR_FORMAT,
                            "%s: --material names “%s” twice; give each material once", path,
                            p->bindings[b].name);
            else
                g_set_error(error, SCENE_ERROR, SCENE_ERROR_FORMAT,
                            "%s: no mesh has the material “%s”; the materials are %s", path,
                            p->bindings[b].name, *names ? names : "none");
            return FALSE;
        }
    }
    return TRUE;
}

static void parts_box(struct parts *p, gboolean with_floor) {
    for (int c = 0; c < 3; c++) {
        p->low[c] = INFINITY;
        p->high[c] = -INFINITY;
    }
    for (guint k = 0; k < p->scene->parts->len; k++) {
        const struct mesh *mesh = parts_at(p, k)->mesh;
        for (guint v = 0; (with_floor || !p->floor[k]) && v < mesh->n_vertices; v++)
            for (int c = 0; c < 3; c++) {
                p->low[c] = MIN(p->low[c], mesh->vertices[v].position[c]);
                p->high[c] = MAX(p->high[c], mesh->vertices[v].position[c]);
            }
    }
}

/* Returns whether a mesh is flat, faces up, lies in the lower half of the bounding box of all
 * meshes, and reaches to the sides of that box. */
static gboolean part_is_floor(const struct parts *p, const struct mesh *mesh) {
    const float even = (float)FLAT * hypotf(p->high[0] - p->low[0], p->high[1] - p->low[1]);
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (guint v = 0; v < mesh->n_vertices; v++) {
        if ((double)mesh->vertices[v].normal[2] < 0.99)
            return FALSE;
        for (int c = 0; c < 3; c++) {
            low[c] = MIN(low[c], mesh->vertices[v].position[c]);
            high[c] = MAX(high[c], mesh->vertices[v].position[c]);
        }
    }
    return high[2] - low[2] <= even && low[2] <= 0.5F * (p->low[2] + p->high[2]) &&
           low[0] <= p->low[0] + even && low[1] <= p->low[1] + even &&
           high[0] >= p->high[0] - even && high[1] >= p->high[1] - even;
}

/* Finds the meshes of the floor, and the bounding box of all other meshes. */
static void parts_find_floor(struct parts *p) {
    guint n_floors = 0;
    parts_box(p, TRUE);
    for (guint k = 0; k < p->scene->parts->len; k++) {
        p->floor[k] = part_is_floor(p, parts_at(p, k)->mesh);
        n_floors += p->floor[k];
    }
    if (n_floors == p->scene->parts->len)
        memset(p->floor, 0, n_floors * sizeof *p->floor);
    parts_box(p, FALSE);
}

/* Appends all meshes of a material that belong to the floor if of_floor is TRUE, or all that do
 * not. */
static void parts_append(const struct parts *p, int material, gboolean of_floor, struct mesh *to) {
    const guint first = to->n_indices;
    for (guint k = 0; k < p->scene->parts->len; k++) {
        const struct mesh *from = parts_at(p, k)->mesh;
        if (part_material(p, k) != material || p->floor[k] != of_floor)
            continue;
        for (guint v = 0; v < from->n_vertices; v++) {
            struct vertex *vertex = &to->vertices[to->n_vertices + v];
            double square = 0.0;
            *vertex = from->vertices[v];
            for (int c = 0; c < 3; c++) {
                vertex->position[c] -= 0.5F * (p->low[c] + p->high[c]);
                square += (double)vertex->position[c] * vertex->position[c];
            }
            if (!of_floor)
                to->radius = fmaxf(to->radius, (float)sqrt(square));
        }
        for (guint i = 0; i < from->n_indices; i++)
            to->indices[to->n_indices + i] = to->n_vertices + from->indices[i];
        to->n_vertices += from->n_vertices;
        to->n_indices += from->n_indices;
        to->n_floor_vertices += of_floor ? from->n_vertices : 0;
        to->n_floor_indices += of_floor ? from->n_indices : 0;
    }
    if (to->n_indices > first)
        to->parts[to->n_parts++] = (struct mesh_part){first, to->n_indices - first, material};
}

struct mesh *scene_read_parts(const char *path, const struct scene_binding *bindings, guint n,
                              GError **error) {
    g_autoptr(GltfScene) scene = gltf_scene_read(path, error);
    if (scene == NULL)
        return NULL;
    g_autofree gboolean *floors = g_new0(gboolean, scene->parts->len);
    struct parts p = {.scene = scene, .bindings = bindings, .n_bindings = n, .floor = floors};
    gsize n_vertices = 0, n_indices = 0;
    if (!parts_check(&p, path, error))
        return NULL;
    for (guint k = 0; k < scene->parts->len; k++) {
        n_vertices += parts_at(&p, k)->mesh->n_vertices;
        n_indices += parts_at(&p, k)->mesh->n_indices;
    }
    if (n_vertices > SCENE_MAX_VERTICES || n_indices > 6 * (gsize)SCENE_MAX_VERTICES) {
        g_set_error(error, SCENE_ERROR, SCENE_ERROR_TOO_LARGE,
                    "%s: it has %zu vertices and %zu triangles, but at most %d vertices and %d "
                    "triangles can be drawn; leave out some meshes",
                    path, n_vertices, n_indices / 3, SCENE_MAX_VERTICES, 2 * SCENE_MAX_VERTICES);
        return NULL;
    }
    parts_find_floor(&p);
    struct mesh *mesh = g_new0(struct mesh, 1);
    mesh->name = g_strdup(path);
    mesh->tiles_u = mesh->tiles_v = 1.0;
    mesh->vertices = g_new(struct vertex, n_vertices);
    mesh->indices = g_new(guint32, n_indices);
    mesh->parts = g_new(struct mesh_part, 2 * (gsize)(n + 1));
    for (int of_floor = 0; of_floor < 2; of_floor++)
        for (guint material = 0; material <= n; material++)
            parts_append(&p, (int)material, of_floor, mesh);
    if (!(mesh->radius > 0.0F)) {
        g_set_error(error, SCENE_ERROR, SCENE_ERROR_FORMAT,
                    "%s: all positions are the same; export objects that have a size", path);
        g_clear_pointer(&mesh, mesh_free);
    }
    return mesh;
}
