/*
 * The shapes on which a material is drawn: meshes with texture coordinates and tangent frames.
 *
 * u increases along the tangent t, which is the texture's +x. v increases along the bitangent b,
 * which is the texture's +y, so row 0 of a texture lies at v = 1. b is tangent[3] · n × t. z is up.
 * One tile covers u or v from 0 to 1. A renderer multiplies u and v by the numbers of tiles.
 */
#pragma once

#include <glib.h>

#define SCENE_ERROR scene_error_quark()
GQuark scene_error_quark(void);
enum scene_error {
    SCENE_ERROR_IO,
    /* The file is neither OBJ nor glTF, or it is damaged, or all its positions are the same. Also:
     * an option --material names a material that the file does not have, or two options name the
     * same material. */
    SCENE_ERROR_FORMAT,
    SCENE_ERROR_NO_TEXTURE, /* no texture coordinates */
    SCENE_ERROR_TOO_LARGE,
    SCENE_ERROR_NO_SHAPE, /* neither the name of a shape nor of an .obj, .gltf or .glb file */
};

#define SCENE_MAX_FILE     (256 << 20) /* bytes */
#define SCENE_MAX_VERTICES (1 << 24)

struct vertex {
    float position[3];
    float normal[3];  /* unit */
    float tangent[4]; /* unit vector perpendicular to normal; [3] is 1, or −1 if mirrored */
    float uv[2];
};

/* The indices of one material; see mesh.parts. */
struct mesh_part {
    guint first_index, n_indices;
    int material; /* number of the material in the renderer, from 0 */
};

struct mesh {
    char *name;
    struct vertex *vertices;
    guint n_vertices;
    guint32 *indices; /* three for each triangle, counter-clockwise seen from outside */
    guint n_indices;
    float radius;            /* largest distance of a point from the origin, without the floor */
    double tiles_u, tiles_v; /* suggested number of tiles */
    /* The last vertices and indices belong to a floor. The floor receives shadows, but casts none.
     * It may extend beyond `radius` and beyond the picture. */
    guint n_floor_vertices, n_floor_indices;
    /* The parts are in the order of the indices. Each index belongs to exactly one part. Each part
     * lies either wholly in the floor or wholly outside it. If n_parts is 0, the whole mesh has
     * material 0. */
    struct mesh_part *parts;
    guint n_parts;
};

typedef struct mesh Mesh;
void mesh_free(Mesh *mesh); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Mesh, mesh_free)

/* The vertical axis of a file. The mesh is turned so that this axis becomes z. */
enum scene_up { SCENE_Z_UP, SCENE_Y_UP };

#define SCENE_SHAPES 5
/* "plane", "torus", "sphere", "cylinder", "torus-knot" */
extern const char *const scene_shape_names[SCENE_SHAPES];

/* Returns a shape, or NULL on error. name is one of scene_shape_names, or the path of an .obj,
 * .gltf or .glb file. */
struct mesh *scene_shape(const char *name, enum scene_up up, GError **error);

struct scene_options {
    double tiles_u, tiles_v; /* if one is 0, both are those of the shape */
    enum scene_up up;
    gboolean floor; /* whether to add a floor below the shape */
};
/* Makes a shape as scene_shape() does, with the tiles and the floor of the options. */
struct mesh *scene_make(const char *name, const struct scene_options *options, GError **error);

/* Makes a plane: −1 … 1 in x and y, normal +z. */
struct mesh *scene_plane(void);
/* Makes a torus around z of n_around × n_tube quadrilaterals. u increases around the axis, v around
 * the tube from its outermost circle upwards. */
struct mesh *scene_torus(double radius, double tube_radius, int n_around, int n_tube);
struct mesh *scene_sphere(void); /* radius 1; u increases around z, v from bottom to top */

/* Reads a Wavefront OBJ with the statements v, vt, vn and f. Other statements are ignored. A face
 * may have any number of corners, and must be convex. Negative indices are allowed. Missing normals
 * are computed. The mesh is centred and scaled to radius 1. */
struct mesh *scene_read_obj(const char *path, enum scene_up up, GError **error);

/* Reads the triangles of the scene of a glTF 2.0 file (text or binary), with the tangents of the
 * file if it has them. Everything else in the file is ignored. up is the vertical axis of the file;
 * by the standard, it is y. Buffers are within the file, or in files in its folder. A file that
 * requires an extension (for example compression) is refused. */
struct mesh *scene_read_gltf(const char *path, enum scene_up up, GError **error);

/* Does the same as scene_read_obj() with text in memory. text ends with NUL. name is for
 * messages. */
struct mesh *scene_parse_obj(const char *name, const char *text, enum scene_up up, GError **error);
