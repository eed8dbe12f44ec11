/*
 * A scene for ray tracing: the triangles of a glTF file in Embree, their materials, lamps, a sky
 * and a camera. z is up, and lengths are as in the file. A directional lamp of brightness 1 has the
 * irradiance π. A white diffuser that it lights along the normal has radiance 1.
 */
#pragma once

#include "trace_choice.h"
#include "trace_error.h"
#include "trace_sky.h"
#include "trace_surface.h"

#include "base/work.h"
#include "shapes/gltf_scene.h"

struct trace_camera {
    /* `eye` is a position. `right`, `up` and `back` are unit vectors. `back` points from the scene
     * to the camera. */
    struct vec3 eye, right, up, back;
    double fov_y_rad;
};

/* A triangle that emits light on the side of its normal. */
struct trace_area {
    struct vec3 corner, edges[2], normal;
    double area;
    const double *emission; /* radiance of its surface, R, G, B; owned by the surface */
};

typedef struct trace_scene {
    GltfScene *gltf;
    /* of struct trace_surface: the materials of the file, and then the default material of glTF */
    GArray *surfaces;
    struct RTCDeviceTy *device; /* of Embree */
    struct RTCSceneTy *rays;    /* the triangles in Embree */
    double reach;               /* radius of a sphere around `middle` that contains all triangles */
    struct vec3 middle;
    GArray *areas;      /* struct trace_area */
    GArray *part_areas; /* gint64: index of the first area of each part, or −1 */
    /* draws an area, by size and radiance; n is 0 if no area emits light */
    struct trace_choice lit;
    GArray *lamps;          /* struct gltf_lamp */
    TraceSky *sky;          /* NULL for black */
    gboolean has_relief;    /* a surface has relief */
    GPtrArray *part_shapes; /* struct vertex_shape * of each part with relief; NULL for others */
    struct trace_camera camera;
} TraceScene;

/* Reads a glTF file, with its camera. If the file has no camera, the scene gets a camera that sees
 * the whole scene, from −90° azimuth and 30° elevation, with a field of view of 40°. */
TraceScene *trace_scene_read(const char *path, GError **error);
void trace_scene_free(TraceScene *scene); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TraceScene, trace_scene_free)

/* Replaces all glTF materials with the name `name` by a captured material. path is the directory of
 * a session, or a file that “mesorig compress” wrote. tiles is the number of tiles of the captured
 * material in one unit of the texture coordinates. A captured material emits no light.
 *
 * Fails if no glTF material has this name, if a mesh with this glTF material has no texture
 * coordinates, or if the captured material cannot be opened. */
gboolean trace_scene_set_material(TraceScene *scene, const char *name, const char *path,
                                  double tiles, GError **error);
/* Lets rays pass above the relief of all materials with the name `name`, which
 * trace_scene_set_material() must have replaced. At an outline, such a ray then shows the surface
 * behind the relief. At the edge of a shadow, the light of a lamp passes. mdf is the path of an
 * MDF. NULL means the MDF in the material's session. Fails if there is no MDF, or if the material
 * does not state the size of a texel. */
gboolean trace_scene_set_relief(TraceScene *scene, const char *name, const char *mdf,
                                GError **error);
/* Sets the sky and takes ownership of it. NULL means black. */
void trace_scene_set_sky(TraceScene *scene, TraceSky *sky);
/* Adds a lamp infinitely far away. The angles give the direction from the scene to the lamp. */
void trace_scene_add_lamp(TraceScene *scene, double theta_deg, double phi_deg, double brightness);
/* Sets a camera that sees the whole scene. The azimuth is counter-clockwise from +x, seen from
 * above. */
void trace_scene_look(TraceScene *scene, double azimuth_deg, double elevation_deg, double fov_deg);

/* Finds the nearest surface along a ray, and sets *ret to the hit. A surface is skipped if the ray
 * passes above its relief. Returns FALSE if the ray meets no surface. Any thread may call this
 * function and the next two. */
gboolean trace_scene_hit(const TraceScene *scene, struct vec3 from, struct vec3 direction,
                         struct trace_hit *ret);
/* Returns whether nothing lies between `from` and the point at this distance in this direction.
 * With the distance INFINITY, returns whether the sky is visible in this direction. */
gboolean trace_scene_is_free(const TraceScene *scene, struct vec3 from, struct vec3 direction,
                             double distance);
/* Returns the point from which a ray in this direction leaves the surface that was hit. The point
 * is moved off the surface, so that rounding errors do not make the ray hit it again. */
struct vec3 trace_scene_leave(const TraceScene *scene, const struct trace_hit *hit,
                              struct vec3 direction);
