/* glTF scenes of mesorig-trace. Parts, materials, lamps and the camera are finite and name only
 * parts that exist. Embree accepts the triangles, and rays through them hit surfaces. */
#include "fuzz.h"

#include "tracer/trace_scene.h"

#include <math.h>

static void check_doubles(const double *values, int n) {
    for (int k = 0; k < n; k++)
        g_assert_true(isfinite(values[k]));
}

static void check_vec(struct vec3 v) {
    g_assert_true(isfinite(v.x) && isfinite(v.y) && isfinite(v.z));
}

static void check_parts(const GltfScene *gltf) {
    guint triangles = 0;
    for (guint k = 0; k < gltf->parts->len; k++) {
        const struct gltf_part *part = gltf->parts->pdata[k];
        const struct mesh *mesh = part->mesh;
        g_assert_cmpint(part->material, >=, -1);
        g_assert_cmpint(part->material, <, (int)gltf->materials->len);
        g_assert_cmpuint(mesh->n_indices % 3, ==, 0);
        triangles += mesh->n_indices / 3;
        for (guint i = 0; i < mesh->n_indices; i++)
            g_assert_cmpuint(mesh->indices[i], <, mesh->n_vertices);
        for (guint i = 0; i < mesh->n_vertices; i++)
            for (int c = 0; c < 3; c++) {
                g_assert_true(fabsf(mesh->vertices[i].position[c]) <= GLTF_SCENE_MAX_LENGTH);
                g_assert_true(isfinite(mesh->vertices[i].normal[c]));
                g_assert_true(isfinite(mesh->vertices[i].tangent[c]));
            }
    }
    g_assert_cmpuint(triangles, >=, 1);
}

static void check_lights(const GltfScene *gltf) {
    for (guint k = 0; k < gltf->materials->len; k++) {
        const struct gltf_material *material =
            &g_array_index(gltf->materials, struct gltf_material, k);
        g_assert_true(g_utf8_validate(material->name, -1, NULL));
        g_assert_true(material->metallic >= 0 && material->metallic <= 1);
        g_assert_true(material->roughness >= 0 && material->roughness <= 1);
        for (int c = 0; c < 3; c++) {
            g_assert_true(isfinite(material->base[c]) && material->base[c] >= 0);
            g_assert_true(isfinite(material->emission[c]) && material->emission[c] >= 0);
        }
    }
    for (guint k = 0; k < gltf->lamps->len; k++) {
        const struct gltf_lamp *lamp = &g_array_index(gltf->lamps, struct gltf_lamp, k);
        check_doubles(lamp->position, 3);
        check_doubles(lamp->towards, 3);
        check_doubles(lamp->rgb, 3);
        g_assert_true(isfinite(lamp->inner_cos) && isfinite(lamp->outer_cos));
    }
}

static void trace(const TraceScene *scene) {
    g_assert_true(isfinite(scene->reach) && scene->reach > 0);
    check_vec(scene->camera.eye);
    check_vec(scene->camera.back);
    for (int i = 0; i < 8; i++) {
        struct trace_hit hit;
        const struct vec3 towards = vec3(cos(i), sin(i), 0.3 * (i - 4));
        const struct vec3 from = vec3_sub(scene->middle, vec3_scale(towards, 2 * scene->reach));
        if (!trace_scene_hit(scene, from, vec3_scale(towards, 1 / vec3_length(towards)), &hit))
            continue;
        check_vec(hit.position);
        check_vec(hit.facet);
        check_vec(hit.z);
        g_assert_true(isfinite(hit.distance) && hit.distance >= 0);
        g_assert_cmpint(hit.area, <, (gint64)scene->areas->len);
        g_assert_nonnull(hit.surface);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    GError *error = NULL;
    g_autoptr(TraceScene) scene =
        trace_scene_read(fuzz_file_in_folder("scene.gltf", data, size), &error);
    fuzz_check(scene != NULL, &error);
    if (!scene)
        return 0;
    check_parts(scene->gltf);
    check_lights(scene->gltf);
    trace(scene);
    return 0;
}
