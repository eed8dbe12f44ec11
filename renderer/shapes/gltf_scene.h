/*
 * A glTF 2.0 scene for a path tracer: its triangles by material, where its nodes put them, its
 * materials, lamps and first camera. Unlike scene.h's meshes nothing is centred or scaled: lengths
 * are the file's. The file's y is up; here z is: (x, y, z) becomes (x, −z, y).
 *
 * A mesh that several nodes name appears once for each node. A material has its factors and its
 * base colour texture, with the first texture coordinates; other textures are ignored. Skins and
 * morph targets stay in their rest state.
 */
#pragma once

#include "scene.h"

#define GLTF_SCENE_MAX_LENGTH 1e6 /* of a coordinate */

/* How a texture continues beyond its edges. */
enum gltf_wrap { GLTF_WRAP_REPEAT, GLTF_WRAP_CLAMP, GLTF_WRAP_MIRROR };

/* pbrMetallicRoughness, with KHR_materials_specular and KHR_materials_emissive_strength. */
struct gltf_material {
    char *name; /* "" where the file has none */
    float base[3], metallic, roughness;
    float specular;    /* specularFactor; 0: non-metals have no surface reflection */
    float emission[3]; /* radiance that its front side emits */
    GBytes *picture; /* the file of its base colour's texture, which multiplies base; NULL: none */
    char *unread;    /* why that file could not be read; NULL: it was read, or there is none */
    enum gltf_wrap wrap[2]; /* of the picture, along u and v */
};

struct gltf_part {
    char *name; /* of its mesh, or "" */
    struct mesh *mesh;
    int material;     /* index, or −1: glTF's default */
    gboolean texture; /* it has texture coordinates; else they are 0 */
};

/* KHR_lights_punctual */
enum gltf_lamp_kind { GLTF_LAMP_DIRECTIONAL, GLTF_LAMP_POINT, GLTF_LAMP_SPOT };
struct gltf_lamp {
    enum gltf_lamp_kind kind;
    double position[3], towards[3]; /* towards: unit, the way its light goes */
    double rgb[3];                  /* irradiance of a directional lamp, else radiant intensity */
    double inner_cos, outer_cos;    /* of a spot's cone: full light, no light */
};

struct gltf_camera {
    double eye[3], right[3], up[3], back[3]; /* unit; back: from what it sees towards it */
    double fov_y_rad;
};

struct gltf_scene {
    GPtrArray *parts;  /* of struct gltf_part; at least one triangle together */
    GArray *materials; /* struct gltf_material */
    GArray *lamps;     /* struct gltf_lamp */
    gboolean has_camera;
    struct gltf_camera camera;
};

typedef struct gltf_scene GltfScene;

/* Errors are SCENE_ERROR; they name the file. */
struct gltf_scene *gltf_scene_read(const char *path, GError **error);
void gltf_scene_free(struct gltf_scene *scene); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(GltfScene, gltf_scene_free)
