/*
 * A scene to trace rays through: a glTF file's triangles in Embree, what each is made of, lamps, a
 * sky and a camera. z is up; lengths are the file's. Radiance 1 is that of a white diffuser under a
 * directional lamp of brightness 1 from its normal, whose irradiance is π.
 */
#pragma once

#include "trace_choice.h"
#include "trace_sky.h"
#include "trace_surface.h"

#include "base/work.h"
#include "shapes/gltf_scene.h"

#define TRACE_ERROR trace_error_quark()
GQuark trace_error_quark(void);
enum trace_error {
    TRACE_ERROR_SCENE,    /* the scene lacks something, or a name is not in it */
    TRACE_ERROR_MATERIAL, /* a material's file cannot be used */
    TRACE_ERROR_SETTING,  /* out of range */
};

struct trace_camera {
    struct vec3 eye, right, up, back; /* unit; back: from what it sees towards it */
    double fov_y_rad;
};

/* A triangle that gives light, on the side that its normal shows. */
struct trace_area {
    struct vec3 corner, edges[2], normal;
    double area;
    const double *emission;
};

/* What a ray hits, and how the texture lies there. */
struct trace_hit {
    const struct trace_surface *surface;
    struct vec3 position;
    struct vec3 facet;   /* normal of the triangle, towards where the ray came from */
    struct vec3 x, y, z; /* the surface's frame; z on the same side as facet */
    struct trace_texel texel;
    double distance;
    gint64 area; /* index into areas if its lit side was hit, else −1 */
    guint part;  /* of the file */
    gboolean is_front;
    double unit[2]; /* length of a unit of the texture's u and v there; 0: without coordinates */
};

typedef struct trace_scene {
    GltfScene *gltf;
    GArray *surfaces; /* struct trace_surface: the file's materials, then glTF's default */
    struct RTCDeviceTy *device; /* of Embree */
    struct RTCSceneTy *rays;
    double reach; /* radius of the sphere around middle that holds everything */
    struct vec3 middle;
    GArray *areas;           /* struct trace_area */
    GArray *part_areas;      /* gint64: index of the first area of each part, or −1 */
    struct trace_choice lit; /* which area, by area and radiance; n = 0: there are none */
    GArray *lamps;           /* struct gltf_lamp */
    TraceSky *sky;           /* NULL: black */
    gboolean has_relief;     /* some surface has relief */
    struct trace_camera camera;
} TraceScene;

/* Reads the glTF file. Its camera, or without one trace_scene_look(). */
TraceScene *trace_scene_read(const char *path, GError **error);
void trace_scene_free(TraceScene *scene); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TraceScene, trace_scene_free)

/* The captured material of this file takes the place of all of the glTF's materials of that name;
 * tiles of it lie in one unit of the texture coordinates. */
gboolean trace_scene_set_material(TraceScene *scene, const char *name, const char *path,
                                  double tiles, GError **error);
/* Rays pass above the relief of the materials of this name, which are captured ones: at outlines
 * they see what lies behind, and light comes through where shadows end. mdf: the file of its
 * distances; NULL: those of its session. */
gboolean trace_scene_set_relief(TraceScene *scene, const char *name, const char *mdf,
                                GError **error);
/* Takes the sky; NULL: black. */
void trace_scene_set_sky(TraceScene *scene, TraceSky *sky);
/* A lamp far away; towards: from the scene to the lamp. */
void trace_scene_add_lamp(TraceScene *scene, double theta_deg, double phi_deg, double brightness);
/* A camera that sees all of it; azimuth counter-clockwise from +x seen from above. */
void trace_scene_look(TraceScene *scene, double azimuth_deg, double elevation_deg, double fov_deg);

/* The nearest surface along a ray; with relief, the nearest that the ray does not pass. Any
 * thread. */
gboolean trace_scene_hit(const TraceScene *scene, struct vec3 from, struct vec3 direction,
                         struct trace_hit *ret);
/* Whether nothing lies between two points, or, with distance INFINITY, up to the sky. */
gboolean trace_scene_is_free(const TraceScene *scene, struct vec3 from, struct vec3 direction,
                             double distance);
/* Where a ray leaves a surface towards direction: off it by what rounding needs. */
struct vec3 trace_scene_leave(const TraceScene *scene, const struct trace_hit *hit,
                              struct vec3 direction);
