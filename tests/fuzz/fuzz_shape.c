/* Shapes: OBJ, and glTF as text and binary. A shape that is read can be drawn: all numbers are
 * finite, and all corners exist. */
#include "fuzz.h"

#include "shapes/scene.h"

#include <math.h>

static void check_finite(const float *values, int n) {
    for (int k = 0; k < n; k++)
        g_assert_true(isfinite(values[k]));
}

static void check(struct mesh *mesh, GError **error) {
    fuzz_check(mesh != NULL, error);
    if (!mesh)
        return;
    g_assert_cmpuint(mesh->n_indices % 3, ==, 0);
    for (guint k = 0; k < mesh->n_indices; k++)
        g_assert_cmpuint(mesh->indices[k], <, mesh->n_vertices);
    for (guint k = 0; k < mesh->n_vertices; k++) {
        const struct vertex *v = &mesh->vertices[k];
        check_finite(v->position, 3);
        check_finite(v->normal, 3);
        check_finite(v->tangent, 4);
        check_finite(v->uv, 2);
    }
    g_assert_true(isfinite(mesh->radius) && isfinite(mesh->tiles_u) && isfinite(mesh->tiles_v));
    mesh_free(mesh);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    g_autofree char *text = fuzz_text(data, size);
    const enum scene_up up = size % 2 ? SCENE_Y_UP : SCENE_Z_UP;
    GError *error = NULL;
    struct mesh *mesh = scene_parse_obj("fuzz.obj", text, up, &error);
    check(mesh, &error);
    mesh = scene_read_gltf(fuzz_file_in_folder("shape.gltf", data, size), up, &error);
    check(mesh, &error);
    return 0;
}
