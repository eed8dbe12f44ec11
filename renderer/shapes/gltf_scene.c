#include "gltf_scene.h"

#include "gltf_nodes.h"

#include <math.h>
#include <string.h>

#define MAX_PARTS 20000

struct gltf_loading {
    struct gltf_scene *scene;
    const struct gltf_transform *p; /* transform of the node that is being read */
    const char *name;               /* name of its mesh, or "" */
};

/* Returns a member as a number, clamped to least … most. Returns fallback if there is no such
 * member, or if it is not a finite number. */
static double number(JsonObject *object, const char *name, double fallback, double least,
                     double most) {
    JsonNode *node = object != NULL ? json_object_get_member(object, name) : NULL;
    if (node == NULL || !JSON_NODE_HOLDS_VALUE(node))
        return fallback;
    const double value = json_node_get_double(node);
    return isfinite(value) ? CLAMP(value, least, most) : fallback;
}

static JsonObject *extension(JsonObject *object, const char *name) {
    JsonObject *all = gltf_object(object, "extensions");
    return all != NULL ? gltf_object(all, name) : NULL;
}

static void read_colour(JsonObject *object, const char *name, guint n, double most, double scale,
                        float ret[3]) {
    double values[4];
    if (object == NULL || !gltf_numbers(object, name, values, n))
        return;
    for (int c = 0; c < 3; c++)
        ret[c] = (float)(isfinite(values[c]) ? CLAMP(values[c], 0.0, most) * scale : 0.0);
}

static struct gltf_material read_material(JsonObject *from) {
    JsonObject *pbr = gltf_object(from, "pbrMetallicRoughness");
    JsonObject *specular = extension(from, "KHR_materials_specular");
    JsonObject *strength = extension(from, "KHR_materials_emissive_strength");
    const char *name = gltf_string(from, "name");
    struct gltf_material ret = {.name = g_strdup(name != NULL ? name : ""),
                                .base = {1.0F, 1.0F, 1.0F}};
    read_colour(pbr, "baseColorFactor", 4, 1.0, 1.0, ret.base);
    ret.metallic = (float)number(pbr, "metallicFactor", 1.0, 0.0, 1.0);
    ret.roughness = (float)number(pbr, "roughnessFactor", 1.0, 0.0, 1.0);
    ret.specular = (float)number(specular, "specularFactor", 1.0, 0.0, 1.0);
    read_colour(from, "emissiveFactor", 3, 1.0, number(strength, "emissiveStrength", 1.0, 0.0, 1e6),
                ret.emission);
    return ret;
}

/* Reads the base colour texture of a material. Returns FALSE with an error if the entries of the
 * texture or of its picture in the file are wrong. */
static gboolean read_picture(struct gltf *gltf, JsonObject *material, struct gltf_material *ret,
                             GError **error) {
    static const char *const axes[2] = {"wrapS", "wrapT"};
    JsonObject *pbr = gltf_object(material, "pbrMetallicRoughness");
    JsonObject *info = pbr != NULL ? gltf_object(pbr, "baseColorTexture") : NULL;
    if (info == NULL || gltf_int(info, "texCoord", 0) != 0)
        return TRUE;
    JsonObject *texture = gltf_item(gltf, "textures", gltf_int(info, "index", -1), error);
    if (texture == NULL)
        return FALSE;
    if (!json_object_has_member(texture, "source")) /* the texture has the format of an extension */
        return TRUE;
    JsonObject *sampler = NULL;
    if (json_object_has_member(texture, "sampler") &&
        (sampler = gltf_item(gltf, "samplers", gltf_int(texture, "sampler", -1), error)) == NULL)
        return FALSE;
    for (int axis = 0; axis < 2; axis++) {
        const gint64 wrap = sampler != NULL ? gltf_int(sampler, axes[axis], 10497) : 10497;
        ret->wrap[axis] = wrap == 33071   ? GLTF_WRAP_CLAMP
                          : wrap == 33648 ? GLTF_WRAP_MIRROR
                                          : GLTF_WRAP_REPEAT;
    }
    ret->picture = gltf_image(gltf, gltf_int(texture, "source", -1), error);
    return ret->picture != NULL;
}

static gboolean read_materials(struct gltf *gltf, struct gltf_scene *scene, GError **error) {
    JsonArray *materials = gltf_array(gltf->root, "materials");
    const guint n = materials != NULL ? json_array_get_length(materials) : 0;
    for (guint k = 0; k < n; k++) {
        JsonObject *object = gltf_item(gltf, "materials", k, error);
        if (object == NULL)
            return FALSE;
        struct gltf_material material = read_material(object);
        g_autoptr(GError) why = NULL;
        if (!read_picture(gltf, object, &material, &why))
            material.unread = g_strdup(why->message);
        g_array_append_val(scene->materials, material);
    }
    return TRUE;
}

/* Computes the unit direction in the world of an axis of a node. Returns FALSE if the scale of the
 * node reduces the axis to length 0. */
static gboolean node_axis(const struct gltf_transform *p, int axis, double sign, double ret[3]) {
    float unit[3] = {0.0F, 0.0F, 0.0F}, moved[3];
    unit[axis] = (float)sign;
    gltf_move_point(p, unit, 0.0, moved);
    soup_y_to_z_up(moved);
    const double length = sqrt((double)moved[0] * moved[0] + (double)moved[1] * moved[1] +
                               (double)moved[2] * moved[2]);
    if (!(length > 1e-12) || !isfinite(length))
        return FALSE;
    for (int c = 0; c < 3; c++)
        ret[c] = moved[c] / length;
    return TRUE;
}

static void node_position(const struct gltf_transform *p, double ret[3]) {
    float moved[3];
    gltf_move_point(p, (const float[3]){0.0F, 0.0F, 0.0F}, 1.0, moved);
    soup_y_to_z_up(moved);
    for (int c = 0; c < 3; c++)
        ret[c] = moved[c];
}

/* Reads a camera. Only the first perspective camera of the file is kept. In glTF, the axis −z of a
 * camera or lamp points at the scene. */
static gboolean read_camera(struct gltf *gltf, const struct gltf_transform *p, gint64 k,
                            struct gltf_scene *scene, GError **error) {
    JsonObject *from = gltf_item(gltf, "cameras", k, error);
    struct gltf_camera camera;
    if (from == NULL)
        return FALSE;
    JsonObject *lens = gltf_object(from, "perspective");
    if (scene->has_camera || lens == NULL)
        return TRUE;
    camera.fov_y_rad = number(lens, "yfov", 0.8, 0.01, 3.0);
    node_position(p, camera.eye);
    if (!node_axis(p, 0, 1.0, camera.right) || !node_axis(p, 1, 1.0, camera.up) ||
        !node_axis(p, 2, 1.0, camera.back))
        return gltf_bad(
            gltf, error,
            "the node of a camera has the scale 0 along an axis; give it another scale");
    scene->camera = camera;
    scene->has_camera = TRUE;
    return TRUE;
}

static gboolean read_lamp(struct gltf *gltf, const struct gltf_transform *p, gint64 k,
                          struct gltf_scene *scene, GError **error) {
    static const char *const kinds[] = {"directional", "point", "spot"};
    JsonObject *table = extension(gltf->root, "KHR_lights_punctual");
    JsonArray *lamps = table != NULL ? gltf_array(table, "lights") : NULL;
    JsonNode *node = lamps != NULL && k >= 0 && k < json_array_get_length(lamps)
                         ? json_array_get_element(lamps, (guint)k)
                         : NULL;
    if (node == NULL || !JSON_NODE_HOLDS_OBJECT(node))
        return gltf_bad(gltf, error,
                        "a node names lamp %d, but KHR_lights_punctual has %u lamps, counted from "
                        "0; export the file again",
                        (int)k, lamps != NULL ? json_array_get_length(lamps) : 0);
    JsonObject *from = json_node_get_object(node), *cone = gltf_object(from, "spot");
    const char *type = gltf_string(from, "type");
    float rgb[3] = {1.0F, 1.0F, 1.0F};
    struct gltf_lamp lamp = {.inner_cos = cos(number(cone, "innerConeAngle", 0.0, 0.0, 1.57)),
                             .outer_cos = cos(number(cone, "outerConeAngle", G_PI / 4, 0.0, 1.57))};
    int kind = 0;
    while (kind < 3 && g_strcmp0(type, kinds[kind]) != 0)
        kind++;
    if (kind == 3)
        return gltf_bad(gltf, error,
                        "lamp %d has the type “%s”, but must be directional, point or spot; export "
                        "the file again",
                        (int)k, type != NULL ? type : "");
    lamp.kind = (enum gltf_lamp_kind)kind;
    read_colour(from, "color", 3, 1.0, 1.0, rgb);
    for (int c = 0; c < 3; c++)
        lamp.rgb[c] = rgb[c] * number(from, "intensity", 1.0, 0.0, 1e12);
    node_position(p, lamp.position);
    if (!node_axis(p, 2, -1.0, lamp.towards))
        return gltf_bad(
            gltf, error,
            "the node of lamp %d has the scale 0 along its z axis; give it another scale", (int)k);
    g_array_append_val(scene->lamps, lamp);
    return TRUE;
}

static gboolean part_check(const struct gltf *gltf, const struct mesh *mesh, GError **error) {
    for (guint k = 0; k < mesh->n_vertices; k++)
        for (int c = 0; c < 3; c++)
            if (!(fabs((double)mesh->vertices[k].position[c]) <= GLTF_SCENE_MAX_LENGTH))
                return gltf_bad(gltf, error,
                                "a vertex has the coordinate %g; scale the scene so that all "
                                "coordinates lie within ±%g",
                                (double)mesh->vertices[k].position[c], GLTF_SCENE_MAX_LENGTH);
    return TRUE;
}

static gboolean part_add(struct gltf *gltf, JsonObject *primitive, gpointer data, GError **error) {
    struct gltf_loading *loading = data;
    struct gltf_scene *scene = loading->scene;
    JsonObject *attributes = gltf_object(primitive, "attributes");
    const gint64 material = gltf_int(primitive, "material", -1);
    if (material < -1 || material >= (gint64)scene->materials->len)
        return gltf_bad(gltf, error,
                        "a primitive names material %" G_GINT64_FORMAT
                        ", but the file has %u materials, counted from 0; export the file again",
                        material, scene->materials->len);
    if (scene->parts->len >= MAX_PARTS)
        return gltf_fail(gltf, SCENE_ERROR_TOO_LARGE, error,
                         "it has more than %d primitives; join meshes of the same material",
                         MAX_PARTS);
    struct soup soup;
    soup_init(&soup);
    struct mesh *mesh = NULL;
    const gboolean good =
        gltf_add_primitive(gltf, loading->p, primitive, SCENE_Y_UP, TRUE, &soup, error) &&
        gltf_check_positions(gltf, &soup, error);
    const gboolean empty = good && soup.polygons->len == 0; /* points and lines only */
    if (good && !empty)
        mesh = soup_mesh(&soup, loading->name, gltf->path, FALSE, error);
    soup_clear(&soup);
    if (mesh == NULL || !part_check(gltf, mesh, error)) {
        mesh_free(mesh);
        return empty;
    }
    struct gltf_part *part = g_new(struct gltf_part, 1);
    *part =
        (struct gltf_part){g_strdup(loading->name), mesh, (int)material,
                           attributes != NULL && json_object_has_member(attributes, "TEXCOORD_0")};
    g_ptr_array_add(scene->parts, part);
    return TRUE;
}

static gboolean scene_visit(struct gltf *gltf, const struct gltf_transform *p, JsonObject *node,
                            gint64 mesh, gpointer data, GError **error) {
    struct gltf_loading *loading = data;
    JsonObject *lamp = node != NULL ? extension(node, "KHR_lights_punctual") : NULL;
    if (node != NULL && json_object_has_member(node, "camera") &&
        !read_camera(gltf, p, gltf_int(node, "camera", -1), loading->scene, error))
        return FALSE;
    if (lamp != NULL && !read_lamp(gltf, p, gltf_int(lamp, "light", -1), loading->scene, error))
        return FALSE;
    if (mesh < 0)
        return TRUE;
    JsonObject *object = gltf_item(gltf, "meshes", mesh, error);
    const char *name = object != NULL ? gltf_string(object, "name") : NULL;
    loading->p = p;
    loading->name = name != NULL ? name : "";
    return object != NULL && gltf_each_primitive(gltf, mesh, part_add, loading, error);
}

static void part_free(gpointer data) {
    struct gltf_part *part = data;
    mesh_free(part->mesh);
    g_free(part->name);
    g_free(part);
}

static void material_clear(gpointer data) {
    struct gltf_material *material = data;
    g_free(material->name);
    g_free(material->unread);
    g_clear_pointer(&material->picture, g_bytes_unref);
}

struct gltf_scene *gltf_scene_read(const char *path, GError **error) {
    struct gltf_scene *scene = g_new0(struct gltf_scene, 1);
    scene->parts = g_ptr_array_new_with_free_func(part_free);
    scene->materials = g_array_new(FALSE, FALSE, sizeof(struct gltf_material));
    scene->lamps = g_array_new(FALSE, FALSE, sizeof(struct gltf_lamp));
    g_array_set_clear_func(scene->materials, material_clear);
    struct gltf_loading loading = {.scene = scene};
    struct gltf gltf;
    guint n = 0;
    gboolean good = gltf_open(&gltf, path, error) && read_materials(&gltf, scene, error) &&
                    gltf_visit(&gltf, scene_visit, &loading, error);
    for (guint k = 0; good && k < scene->parts->len; k++)
        n += ((struct gltf_part *)scene->parts->pdata[k])->mesh->n_indices;
    if (good && n == 0)
        good = gltf_bad(&gltf, error, "the scene has no triangles; export at least one mesh");
    gltf_clear(&gltf);
    if (!good)
        g_clear_pointer(&scene, gltf_scene_free);
    return scene;
}

void gltf_scene_free(struct gltf_scene *scene) {
    if (scene == NULL)
        return;
    g_ptr_array_unref(scene->parts);
    g_array_unref(scene->materials);
    g_array_unref(scene->lamps);
    g_free(scene);
}
