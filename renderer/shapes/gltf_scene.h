/*
 * A glTF 2.0 scene for a path tracer: its triangles by material, at the places of its nodes, and
 * its materials, lamps and first camera. Unlike the meshes of scene.h, nothing is centred or
 * scaled, so lengths are as in the file. In the file, y is up. Here z is up: (x, y, z) becomes (x,
 * −z, y).
 *
 * If several nodes refer to a mesh, it appears once for each node. A material has its factors and
 * its base colour texture, with the first texture coordinates. Other textures are ignored. Skins
 * and morph targets stay in their rest state.
 */
#pragma once

#include "scene.h"

#define GLTF_SCENE_MAX_LENGTH 1e6 /* largest absolute value of a coordinate */

/* How a texture continues beyond its edges. */
enum gltf_wrap { GLTF_WRAP_REPEAT, GLTF_WRAP_CLAMP, GLTF_WRAP_MIRROR };

/* A material: glTF's pbrMetallicRoughness, with KHR_materials_specular and
 * KHR_materials_emissive_strength. */
struct gltf_material {
    char *name; /* "" if the file has none */
    float base[3], metallic, roughness;
    float specular;    /* specularFactor; 0 means that non-metals have no surface reflection */
    float emission[3]; /* radiance that its front side emits */
    /* Bytes of the file of the base colour texture, which multiplies `base`. NULL if there is none.
     */
    GBytes *picture;
    /* Reason why the file of the texture could not be read. NULL if there is no such reason. */
    char *unread;
    enum gltf_wrap wrap[2]; /* of the picture, along u and v */
};

struct gltf_part {
    char *name; /* name of its mesh, or "" */
    struct mesh *mesh;
    int material; /* index into materials, or −1 for glTF's default material */
    gboolean
        texture; /* whether the mesh has texture coordinates in the file; otherwise they are 0 */
};

/* the kinds of KHR_lights_punctual */
enum gltf_lamp_kind { GLTF_LAMP_DIRECTIONAL, GLTF_LAMP_POINT, GLTF_LAMP_SPOT };
struct gltf_lamp {
    enum gltf_lamp_kind kind;
    double position[3], towards[3]; /* `towards`: unit vector along which the light goes */
    /* Irradiance of a directional lamp. Radiant intensity of a point lamp or spot lamp. */
    double rgb[3];
    /* Cosines of half the angle of a spot lamp's inner cone and outer cone. Within the inner cone,
     * the light has full strength. Outside the outer cone, there is no light. */
    double inner_cos, outer_cos;
};

struct gltf_camera {
    /* `eye` is the position. `right`, `up` and `back` are unit vectors. `back` points from the
     * scene to the camera. */
    double eye[3], right[3], up[3], back[3];
    double fov_y_rad;
};

struct gltf_scene {
    GPtrArray *parts;  /* of struct gltf_part; they have at least one triangle in total */
    GArray *materials; /* struct gltf_material */
    GArray *lamps;     /* struct gltf_lamp */
    gboolean has_camera;
    struct gltf_camera camera;
};

typedef struct gltf_scene GltfScene;

/* Reads a scene. Errors are SCENE_ERROR and name the file. */
struct gltf_scene *gltf_scene_read(const char *path, GError **error);
void gltf_scene_free(struct gltf_scene *scene); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(GltfScene, gltf_scene_free)
