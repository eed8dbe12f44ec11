#include "trace_fixture.h"

#include <string.h>

struct text {
    GByteArray *bytes;
    GString *views, *accessors;
    int n;
};

/* Adds an accessor and returns its index. type is 5126 for float or 5125 for uint. */
static int add_numbers(struct text *text, gconstpointer values, gsize size, guint count, int type,
                       const char *shape) {
    g_string_append_printf(
        text->views, "%s{\"buffer\": 0, \"byteOffset\": %u, \"byteLength\": %" G_GSIZE_FORMAT "}",
        text->n > 0 ? ", " : "", text->bytes->len, size);
    g_string_append_printf(
        text->accessors,
        "%s{\"bufferView\": %d, \"componentType\": %d, \"count\": %u, \"type\": \"%s\"}",
        text->n > 0 ? ", " : "", text->n, type, count, shape);
    g_byte_array_append(text->bytes, values, (guint)size);
    return text->n++;
}

/* Converts from z up to y up: (x, z, −y). */
static void turn(const float from[3], float ret[3]) {
    ret[0] = from[0];
    ret[1] = from[2];
    ret[2] = -from[1];
}

static void add_object(struct text *text, const struct trace_object *object, GString *meshes) {
    const guint n = object->mesh->n_vertices;
    g_autofree float *positions = g_new(float, 3 * (gsize)n), *normals = g_new(float, 3 * (gsize)n);
    g_autofree float *uvs = g_new(float, 2 * (gsize)n);
    for (guint k = 0; k < n; k++) {
        const struct vertex *v = &object->mesh->vertices[k];
        float at[3];
        for (int c = 0; c < 3; c++)
            at[c] = v->position[c] * object->scale + object->move[c];
        turn(at, positions + 3 * (gsize)k);
        turn(v->normal, normals + 3 * (gsize)k);
        uvs[2 * k] = v->uv[0];
        uvs[2 * k + 1] = 1.0F - v->uv[1];
    }
    const int p = add_numbers(text, positions, 12 * (gsize)n, n, 5126, "VEC3");
    const int m = add_numbers(text, normals, 12 * (gsize)n, n, 5126, "VEC3");
    const int t = add_numbers(text, uvs, 8 * (gsize)n, n, 5126, "VEC2");
    const int i = add_numbers(text, object->mesh->indices, 4 * (gsize)object->mesh->n_indices,
                              object->mesh->n_indices, 5125, "SCALAR");
    g_string_append_printf(meshes,
                           "%s{\"name\": \"%s\", \"primitives\": [{\"attributes\": {\"POSITION\": "
                           "%d, \"NORMAL\": %d",
                           meshes->len > 0 ? ", " : "", object->mesh->name, p, m);
    if (!object->bare)
        g_string_append_printf(meshes, ", \"TEXCOORD_0\": %d", t);
    g_string_append_printf(meshes, "}, \"indices\": %d", i);
    if (object->material >= 0)
        g_string_append_printf(meshes, ", \"material\": %d", object->material);
    g_string_append(meshes, "}]}");
}

char *trace_fixture_text(const struct trace_object *objects, int n, const char *materials,
                         const char *more, const char *nodes, int n_nodes) {
    g_autoptr(GByteArray) bytes = g_byte_array_new();
    g_autoptr(GString) views = g_string_new(NULL), accessors = g_string_new(NULL);
    g_autoptr(GString) meshes = g_string_new(NULL), all = g_string_new(NULL);
    g_autoptr(GString) numbers = g_string_new(NULL);
    struct text text = {bytes, views, accessors, 0};
    for (int k = 0; k < n; k++) {
        add_object(&text, &objects[k], meshes);
        g_string_append_printf(all, "%s{\"mesh\": %d}", k > 0 ? ", " : "", k);
    }
    for (int k = 0; k < n + n_nodes; k++)
        g_string_append_printf(numbers, "%s%d", k > 0 ? ", " : "", k);
    g_autofree char *base64 = g_base64_encode(bytes->data, bytes->len);
    return g_strdup_printf(
        "{\"asset\": {\"version\": \"2.0\"}, \"scenes\": [{\"nodes\": [%s]}], \"nodes\": [%s%s], "
        "\"meshes\": [%s], \"materials\": [%s], \"accessors\": [%s], \"bufferViews\": [%s], "
        "\"buffers\": [{\"byteLength\": %u, \"uri\": \"data:application/octet-stream;base64,%s\"}]"
        "%s}",
        numbers->str, all->str, nodes, meshes->str, materials, accessors->str, views->str,
        bytes->len, base64, more);
}

char *trace_fixture_write(const char *text) {
    g_autofree char *folder = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    char *path = g_build_filename(folder, "scene.gltf", NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    return path;
}
