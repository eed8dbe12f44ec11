#include "trace_scene.h"

#include "base/direction.h"
#include "shapes/mesh_shape.h"
#include "trace_relief.h"

#include <embree3/rtcore.h>
#include <string.h>

#define LIFT       2e-5 /* height of a ray's origin above the surface, as a share of reach */
#define MAX_PASSES 64   /* largest number of times that a ray passes above a relief at an outline */

static void surface_clear(gpointer data) {
    struct trace_surface *surface = data;
    mesorig_material_close(surface->material);
    trace_texture_free(surface->texture);
    g_free(surface->warning);
    g_free(surface->path);
    g_free(surface->name);
}

static const struct gltf_part *scene_part(const TraceScene *scene, guint k) {
    return scene->gltf->parts->pdata[k];
}

static struct trace_surface *part_surface(const TraceScene *scene, const struct gltf_part *part) {
    const guint last = scene->surfaces->len - 1;
    return &g_array_index(scene->surfaces, struct trace_surface,
                          part->material >= 0 ? (guint)part->material : last);
}

static void scene_take_materials(TraceScene *scene) {
    const struct gltf_material none = {.name = "",
                                       .base = {1.0F, 1.0F, 1.0F},
                                       .metallic = 1.0F,
                                       .roughness = 1.0F,
                                       .specular = 1.0F};
    const GArray *from = scene->gltf->materials;
    for (guint k = 0; k <= from->len; k++) {
        const struct gltf_material *m =
            k < from->len ? &g_array_index(from, struct gltf_material, k) : &none;
        struct trace_surface to = {.name = g_strdup(m->name), .tiles = 1.0};
        to.plain.metallic = (double)m->metallic;
        to.plain.roughness = (double)m->roughness;
        to.plain.specular = (double)m->specular;
        for (int c = 0; c < 3; c++) {
            to.plain.base[c] = (double)m->base[c];
            to.emission[c] = (double)m->emission[c];
        }
        g_autoptr(GError) why = NULL;
        if (m->picture != NULL)
            to.texture = trace_texture_new(m->picture, m->wrap, &why);
        if (m->unread != NULL || why != NULL)
            to.warning = g_strdup_printf("material “%s” is shown without its texture: %s", m->name,
                                         why != NULL ? why->message : m->unread);
        g_array_append_val(scene->surfaces, to);
    }
}

static struct vec3 of_floats(const float a[3]) {
    return vec3((double)a[0], (double)a[1], (double)a[2]);
}

/* Sets `middle` to the middle of the bounding box, and `reach` to half of the diagonal of the box.
 */
static void scene_measure(TraceScene *scene) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (guint k = 0; k < scene->gltf->parts->len; k++) {
        const struct mesh *mesh = scene_part(scene, k)->mesh;
        for (guint v = 0; v < mesh->n_vertices; v++)
            for (int c = 0; c < 3; c++) {
                low[c] = fmin(low[c], (double)mesh->vertices[v].position[c]);
                high[c] = fmax(high[c], (double)mesh->vertices[v].position[c]);
            }
    }
    scene->middle =
        vec3(0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2]));
    scene->reach = 0.5 * hypot(hypot(high[0] - low[0], high[1] - low[1]), high[2] - low[2]);
}

static gboolean scene_build(TraceScene *scene, GError **error) {
    scene->device = rtcNewDevice("threads=1");
    if (scene->device == NULL) {
        const enum RTCError why = rtcGetDeviceError(NULL);
        g_set_error(
            error, TRACE_ERROR, TRACE_ERROR_SCENE,
            "Embree, which traces the rays, cannot be started (error %d)%s", (int)why,
            why == RTC_ERROR_UNSUPPORTED_CPU
                ? ": this processor has neither SSE2 nor NEON, which Embree needs; use another "
                  "computer"
            : why == RTC_ERROR_OUT_OF_MEMORY ? ": there is no memory left; close other programs"
                                             : "; install Embree again");
        return FALSE;
    }
    scene->rays = rtcNewScene(scene->device);
    rtcSetSceneFlags(scene->rays, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene->rays, RTC_BUILD_QUALITY_HIGH);
    for (guint k = 0; k < scene->gltf->parts->len; k++) {
        const struct mesh *mesh = scene_part(scene, k)->mesh;
        RTCGeometry geometry = rtcNewGeometry(scene->device, RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                   mesh->vertices, G_STRUCT_OFFSET(struct vertex, position),
                                   sizeof(struct vertex), mesh->n_vertices);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                   mesh->indices, 0, 3 * sizeof(guint32), mesh->n_indices / 3);
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(scene->rays, geometry, k);
        rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(scene->rays);
    const enum RTCError code = rtcGetDeviceError(scene->device);
    if (code != RTC_ERROR_NONE)
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                    "Embree, which traces the rays, cannot take the scene's triangles (error %d)%s",
                    (int)code,
                    code == RTC_ERROR_OUT_OF_MEMORY
                        ? ": there is no memory left; close other programs or simplify the scene"
                        : "; simplify the scene");
    return code == RTC_ERROR_NONE;
}

static void scene_add_area(TraceScene *scene, const struct mesh *mesh, guint triangle,
                           const double *emission) {
    struct vec3 p[3];
    for (int c = 0; c < 3; c++)
        p[c] = of_floats(mesh->vertices[mesh->indices[3 * triangle + (guint)c]].position);
    struct trace_area area = {
        p[0], {vec3_sub(p[1], p[0]), vec3_sub(p[2], p[0])}, {0}, 0.0, emission};
    const struct vec3 across = vec3_cross(area.edges[0], area.edges[1]);
    const double twice = vec3_length(across);
    area.area = 0.5 * twice;
    area.normal = twice > 0.0 ? vec3_scale(across, 1.0 / twice) : vec3(0, 0, 1);
    g_array_append_val(scene->areas, area);
}

/* Finds every triangle that emits light, and the probability with which it is drawn. */
static void scene_find_areas(TraceScene *scene) {
    trace_choice_clear(&scene->lit);
    g_array_set_size(scene->areas, 0);
    g_array_set_size(scene->part_areas, 0);
    for (guint k = 0; k < scene->gltf->parts->len; k++) {
        const struct gltf_part *part = scene_part(scene, k);
        const double *emission = part_surface(scene, part)->emission;
        const gboolean lit = emission[0] > 0.0 || emission[1] > 0.0 || emission[2] > 0.0;
        const gint64 first = lit ? (gint64)scene->areas->len : -1;
        g_array_append_val(scene->part_areas, first);
        for (guint t = 0; lit && t < part->mesh->n_indices / 3; t++)
            scene_add_area(scene, part->mesh, t, emission);
    }
    g_autofree double *power = g_new(double, scene->areas->len);
    for (guint k = 0; k < scene->areas->len; k++) {
        const struct trace_area *area = &g_array_index(scene->areas, struct trace_area, k);
        power[k] = area->area * (0.2126 * area->emission[0] + 0.7152 * area->emission[1] +
                                 0.0722 * area->emission[2]);
    }
    if (!trace_choice_init(&scene->lit, power, scene->areas->len))
        trace_choice_clear(&scene->lit);
}

static struct vec3 of_doubles(const double a[3]) {
    return vec3(a[0], a[1], a[2]);
}

TraceScene *trace_scene_read(const char *path, GError **error) {
    g_autoptr(GltfScene) gltf = gltf_scene_read(path, error);
    if (gltf == NULL)
        return NULL;
    TraceScene *scene = g_new0(TraceScene, 1);
    scene->gltf = g_steal_pointer(&gltf);
    scene->surfaces = g_array_new(FALSE, FALSE, sizeof(struct trace_surface));
    scene->areas = g_array_new(FALSE, FALSE, sizeof(struct trace_area));
    scene->part_areas = g_array_new(FALSE, FALSE, sizeof(gint64));
    scene->part_shapes = g_ptr_array_new_full(scene->gltf->parts->len, g_free);
    g_ptr_array_set_size(scene->part_shapes, (int)scene->gltf->parts->len);
    scene->lamps = g_array_ref(scene->gltf->lamps);
    g_array_set_clear_func(scene->surfaces, surface_clear);
    scene_take_materials(scene);
    scene_measure(scene);
    if (!(scene->reach > 0.0)) {
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                    "%s: all positions are the same; export objects that have a size", path);
        trace_scene_free(scene);
        return NULL;
    }
    if (!scene_build(scene, error)) {
        trace_scene_free(scene);
        return NULL;
    }
    scene_find_areas(scene);
    const struct gltf_camera *camera = &scene->gltf->camera;
    if (scene->gltf->has_camera)
        scene->camera = (struct trace_camera){of_doubles(camera->eye), of_doubles(camera->right),
                                              of_doubles(camera->up), of_doubles(camera->back),
                                              camera->fov_y_rad};
    else
        trace_scene_look(scene, -90.0, 30.0, 40.0);
    return scene;
}

void trace_scene_free(TraceScene *scene) {
    if (scene == NULL)
        return;
    if (scene->rays != NULL)
        rtcReleaseScene(scene->rays);
    if (scene->device != NULL)
        rtcReleaseDevice(scene->device);
    trace_choice_clear(&scene->lit);
    trace_sky_free(scene->sky);
    g_array_unref(scene->surfaces);
    g_array_unref(scene->areas);
    g_array_unref(scene->part_areas);
    g_ptr_array_unref(scene->part_shapes);
    g_array_unref(scene->lamps);
    gltf_scene_free(scene->gltf);
    g_free(scene);
}

static char *scene_names(const TraceScene *scene) {
    GString *names = g_string_new(NULL);
    for (guint k = 0; k + 1 < scene->surfaces->len; k++)
        g_string_append_printf(names, "%s“%s”", k > 0 ? ", " : "",
                               g_array_index(scene->surfaces, struct trace_surface, k).name);
    return g_string_free(names, FALSE);
}

/* Checks that there is a surface with this name, and that all its meshes have texture coordinates.
 */
static gboolean scene_check_name(const TraceScene *scene, const char *name, GError **error) {
    gboolean found = FALSE;
    for (guint k = 0; k + 1 < scene->surfaces->len; k++)
        found |= g_str_equal(g_array_index(scene->surfaces, struct trace_surface, k).name, name);
    if (!found) {
        g_autofree char *names = scene_names(scene);
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                    "the scene has no material “%s”; its materials are %s", name,
                    *names ? names : "none");
        return FALSE;
    }
    for (guint k = 0; k < scene->gltf->parts->len; k++) {
        const struct gltf_part *part = scene_part(scene, k);
        if (!part->texture && g_str_equal(part_surface(scene, part)->name, name)) {
            g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                        "the mesh “%s” of material “%s” has no texture coordinates (TEXCOORD_0); "
                        "unwrap it and save it again",
                        part->name, name);
            return FALSE;
        }
    }
    return TRUE;
}

gboolean trace_scene_set_material(TraceScene *scene, const char *name, const char *path,
                                  double tiles, GError **error) {
    if (!(tiles > 0.0) || !isfinite(tiles)) {
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SETTING,
                    "material “%s”: %g tiles are not possible; give a number above 0", name, tiles);
        return FALSE;
    }
    if (!scene_check_name(scene, name, error))
        return FALSE;
    for (guint k = 0; k + 1 < scene->surfaces->len; k++) {
        struct trace_surface *surface = &g_array_index(scene->surfaces, struct trace_surface, k);
        struct mesorig_error why;
        if (!g_str_equal(surface->name, name))
            continue;
        mesorig_material *material = mesorig_material_open(path, NULL, &why);
        if (material == NULL) {
            g_set_error_literal(error, TRACE_ERROR, TRACE_ERROR_MATERIAL, why.text);
            return FALSE;
        }
        mesorig_material_close(surface->material);
        surface->material = material;
        surface->tiles = tiles;
        surface->has_relief = FALSE;
        g_free(surface->path);
        surface->path = g_strdup(path);
        memset(surface->emission, 0, sizeof surface->emission);
    }
    scene_find_areas(scene);
    return TRUE;
}

/* Reads the relief of a surface with a captured material. */
static gboolean scene_take_relief(struct trace_surface *surface, const char *mdf, GError **error) {
    struct mesorig_material_info info = {.size = sizeof info};
    if (mdf != NULL) {
        struct mesorig_error why;
        mesorig_material *material = mesorig_material_open(surface->path, mdf, &why);
        if (material == NULL) {
            g_set_error_literal(error, TRACE_ERROR, TRACE_ERROR_MATERIAL, why.text);
            return FALSE;
        }
        mesorig_material_close(surface->material);
        surface->material = material;
    }
    mesorig_material_info(surface->material, &info);
    if (!info.has_relief || !(info.texel_mm > 0.0)) {
        g_autofree char *text = g_strdup_printf(
            info.has_relief ? "%s does not say how many mm a texel has; compress the material again"
                            : "%s has no distances (MDF); give the file of its distances, such as "
                              "products/mdf.exr of its session",
            surface->path);
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_MATERIAL,
                    "material “%s” cannot have a relief: %s", surface->name, text);
        return FALSE;
    }
    surface->has_relief = TRUE;
    return TRUE;
}

/* Computes the shape of the parts with relief. */
static void scene_measure_parts(TraceScene *scene) {
    for (guint k = 0; k < scene->gltf->parts->len; k++) {
        const struct gltf_part *part = scene_part(scene, k);
        gpointer *shapes = &g_ptr_array_index(scene->part_shapes, k);
        if (*shapes == NULL && part_surface(scene, part)->has_relief)
            *shapes = mesh_shapes(part->mesh);
    }
}

gboolean trace_scene_set_relief(TraceScene *scene, const char *name, const char *mdf,
                                GError **error) {
    gboolean found = FALSE;
    for (guint k = 0; k + 1 < scene->surfaces->len; k++) {
        struct trace_surface *surface = &g_array_index(scene->surfaces, struct trace_surface, k);
        if (!g_str_equal(surface->name, name) || surface->material == NULL)
            continue;
        if (!scene_take_relief(surface, mdf, error))
            return FALSE;
        found = TRUE;
    }
    if (!found)
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SETTING,
                    "relief “%s”: the scene has no captured material of that name; give the name "
                    "with --material as well",
                    name);
    scene->has_relief |= found;
    scene_measure_parts(scene);
    return found;
}

void trace_scene_set_sky(TraceScene *scene, TraceSky *sky) {
    trace_sky_free(scene->sky);
    scene->sky = sky;
}

void trace_scene_add_lamp(TraceScene *scene, double theta_deg, double phi_deg, double brightness) {
    struct gltf_lamp lamp = {.kind = GLTF_LAMP_DIRECTIONAL};
    float to_lamp[3];
    direction_from_deg(theta_deg, phi_deg, to_lamp);
    for (int c = 0; c < 3; c++) {
        lamp.towards[c] = -(double)to_lamp[c];
        lamp.rgb[c] = G_PI * brightness;
    }
    g_array_append_val(scene->lamps, lamp);
}

void trace_scene_look(TraceScene *scene, double azimuth_deg, double elevation_deg, double fov_deg) {
    float back[3], up[3];
    direction_from_deg(90.0 - elevation_deg, azimuth_deg, back);
    direction_from_deg(-elevation_deg, azimuth_deg, up);
    struct trace_camera *camera = &scene->camera;
    camera->fov_y_rad = fov_deg * G_PI / 180.0;
    camera->back = of_floats(back);
    camera->up = of_floats(up);
    camera->right = vec3_cross(camera->up, camera->back);
    const double distance = scene->reach / sin(0.5 * camera->fov_y_rad);
    camera->eye = vec3_add(scene->middle, vec3_scale(camera->back, distance));
}

static struct RTCRay scene_ray(struct vec3 from, struct vec3 direction, double far) {
    return (struct RTCRay){.org_x = (float)from.x,
                           .org_y = (float)from.y,
                           .org_z = (float)from.z,
                           .dir_x = (float)direction.x,
                           .dir_y = (float)direction.y,
                           .dir_z = (float)direction.z,
                           .tfar = (float)far,
                           .mask = G_MAXUINT32};
}

/* Returns the local shape of a mesh with relief at a point of a triangle, interpolated from the
 * corners. share has the barycentric coordinates of the point. */
static struct mesorig_surface scene_mesh_at(const struct vertex_shape *shapes,
                                            const guint32 corners[3], const double share[3],
                                            double tiles) {
    struct mesorig_surface ret = {0};
    for (int c = 0; c < 3; c++) {
        const struct vertex_shape *s = &shapes[corners[c]];
        for (int k = 0; k < 2; k++)
            ret.tile[k] += (float)(share[c] * (double)s->scale[k] / tiles);
        for (int k = 0; k < 3; k++)
            ret.bend[k] += (float)(share[c] * (double)s->bend[k]);
        for (int k = 0; k < 4; k++)
            ret.stretch[k] += (float)(share[c] * (double)s->stretch[k]);
    }
    return ret;
}

/* Interpolates the values of the vertices at the point that a ray hits, and computes the frame
 * there. z of the frame is the interpolated normal, on the side of the facet from which the ray
 * comes. If the ray would come from below the horizon of this normal, z is the normal of the facet
 * instead. */
static void scene_fill_hit(const TraceScene *scene, const struct RTCRayHit *ray, struct vec3 from,
                           struct vec3 direction, struct trace_hit *ret) {
    const struct gltf_part *part = scene_part(scene, ray->hit.geomID);
    const guint32 *corners = part->mesh->indices + 3 * (gsize)ray->hit.primID;
    const double share[3] = {1.0 - (double)ray->hit.u - (double)ray->hit.v, (double)ray->hit.u,
                             (double)ray->hit.v};
    struct vec3 normal = vec3(0, 0, 0), tangent = vec3(0, 0, 0), position = vec3(0, 0, 0);
    struct vec3 facet = vec3((double)ray->hit.Ng_x, (double)ray->hit.Ng_y, (double)ray->hit.Ng_z);
    double sense = 1.0;
    ret->texel = (struct trace_texel){0.0, 0.0};
    for (int c = 0; c < 3; c++) {
        const struct vertex *v = &part->mesh->vertices[corners[c]];
        position = vec3_add(position, vec3_scale(of_floats(v->position), share[c]));
        normal = vec3_add(normal, vec3_scale(of_floats(v->normal), share[c]));
        tangent = vec3_add(tangent, vec3_scale(of_floats(v->tangent), share[c]));
        ret->texel.u += share[c] * (double)v->uv[0];
        ret->texel.v += share[c] * (double)v->uv[1];
        sense = (double)v->tangent[3];
    }
    facet = vec3_unit(facet);
    const gboolean front = vec3_dot(facet, direction) < 0.0;
    const gint64 first = g_array_index(scene->part_areas, gint64, ray->hit.geomID);
    ret->area = first >= 0 && front ? first + (gint64)ray->hit.primID : -1;
    if (!front)
        facet = vec3_scale(facet, -1.0);
    if (vec3_dot(normal, facet) < 0.0)
        normal = vec3_scale(normal, -1.0);
    if (!(vec3_length(normal) > 1e-6) || vec3_dot(normal, direction) >= 0.0)
        normal = facet;
    ret->part = ray->hit.geomID;
    ret->is_front = front;
    ret->surface = part_surface(scene, part);
    const struct vertex_shape *shapes = g_ptr_array_index(scene->part_shapes, ray->hit.geomID);
    if (shapes != NULL)
        ret->mesh = scene_mesh_at(shapes, corners, share, ret->surface->tiles);
    ret->position = position;
    ret->facet = facet;
    ret->z = vec3_unit(normal);
    tangent = vec3_sub(tangent, vec3_scale(ret->z, vec3_dot(tangent, ret->z)));
    if (!(vec3_length(tangent) > 1e-6)) /* any tangent perpendicular to the normal */
        tangent = vec3_cross(ret->z, fabs(ret->z.x) < 0.7 ? vec3(1, 0, 0) : vec3(0, 1, 0));
    ret->x = vec3_unit(tangent);
    ret->y = vec3_scale(vec3_cross(ret->z, ret->x), sense * (front ? 1.0 : -1.0));
    ret->distance = vec3_length(vec3_sub(position, from));
}

static gboolean scene_nearest(const TraceScene *scene, struct vec3 from, struct vec3 direction,
                              struct trace_hit *ret) {
    struct RTCIntersectContext context;
    struct RTCRayHit ray = {.ray = scene_ray(from, direction, INFINITY)};
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene->rays, &context, &ray);
    if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return FALSE;
    scene_fill_hit(scene, &ray, from, direction, ret);
    return TRUE;
}

/* Returns whether the ray goes below the mesh and out again without meeting the relief. If so, sets
 * *ret_from to the point from which the ray continues. */
static gboolean scene_passes(const TraceScene *scene, const struct trace_hit *hit,
                             struct vec3 direction, struct vec3 *ret_from) {
    struct trace_hit back;
    if (!hit->surface->has_relief || !hit->is_front ||
        !scene_nearest(scene, trace_scene_leave(scene, hit, direction), direction, &back) ||
        back.part != hit->part || back.is_front || trace_relief_meets(hit, &back, direction))
        return FALSE;
    *ret_from = trace_scene_leave(scene, &back, direction);
    return TRUE;
}

gboolean trace_scene_hit(const TraceScene *scene, struct vec3 from, struct vec3 direction,
                         struct trace_hit *ret) {
    struct vec3 start = from;
    for (int k = 0; k < MAX_PASSES; k++) {
        if (!scene_nearest(scene, start, direction, ret))
            return FALSE;
        if (!scene->has_relief || !scene_passes(scene, ret, direction, &start))
            break;
    }
    ret->distance = vec3_length(vec3_sub(ret->position, from));
    return TRUE;
}

gboolean trace_scene_is_free(const TraceScene *scene, struct vec3 from, struct vec3 direction,
                             double distance) {
    /* The end of the ray lies on a surface, so the ray is shortened a little. */
    const double far = isfinite(distance) ? distance - 2.0 * LIFT * scene->reach : INFINITY;
    struct RTCIntersectContext context;
    struct RTCRay ray = scene_ray(from, direction, far);
    if (far <= 0.0)
        return TRUE;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene->rays, &context, &ray);
    if (ray.tfar >= 0.0F || !scene->has_relief)
        return ray.tfar >= 0.0F;
    struct trace_hit hit;
    return !trace_scene_hit(scene, from, direction, &hit) || hit.distance >= far;
}

struct vec3 trace_scene_leave(const TraceScene *scene, const struct trace_hit *hit,
                              struct vec3 direction) {
    const double side = vec3_dot(hit->facet, direction) >= 0.0 ? 1.0 : -1.0;
    return vec3_add(hit->position, vec3_scale(hit->facet, side * LIFT * scene->reach));
}
