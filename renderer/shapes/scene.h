/*
 * The shapes that a material is drawn on: meshes with texture coordinates and tangent frames.
 *
 * u runs along the tangent t (the texture's +x), v along the bitangent b (the texture's +y, so that
 * row 0 of a texture lies at v = 1), b = tangent[3] · n × t. Coordinates are z-up; one tile covers
 * u or v from 0 to 1, and a renderer multiplies them by the number of tiles.
 */
#pragma once

#include <glib.h>

#define SCENE_ERROR scene_error_quark()
GQuark scene_error_quark(void);
enum scene_error {
    SCENE_ERROR_IO,
    SCENE_ERROR_FORMAT,     /* neither OBJ nor glTF, or damaged; the message says where */
    SCENE_ERROR_NO_TEXTURE, /* without texture coordinates */
    SCENE_ERROR_TOO_LARGE,
    SCENE_ERROR_NO_SHAPE, /* neither a shape's name nor such a file */
};

#define SCENE_MAX_FILE     (256 << 20) /* bytes */
#define SCENE_MAX_VERTICES (1 << 24)

struct vertex {
    float position[3];
    float normal[3];  /* unit */
    float tangent[4]; /* unit, at right angles to normal; [3] is 1 or, mirrored, −1 */
    float uv[2];
};

/* Indices of one material, see mesh.parts. */
struct mesh_part {
    guint first_index, n_indices;
    int material; /* number of the renderer's, from 0 */
};

struct mesh {
    char *name;
    struct vertex *vertices;
    guint n_vertices;
    guint32 *indices; /* three a triangle, counter-clockwise from outside */
    guint n_indices;
    float radius;            /* of the sphere around the origin that holds it */
    double tiles_u, tiles_v; /* suggested number of tiles */
    /* The last vertices and indices belong to a floor, which receives shadows and casts none. It
     * need not lie within the radius nor fit into the picture. */
    guint n_floor_vertices, n_floor_indices;
    /* In the order of the indices; each index belongs to exactly one part. A part lies wholly in
     * the floor or wholly outside it. n_parts 0: the whole mesh has material 0. */
    struct mesh_part *parts;
    guint n_parts;
};

typedef struct mesh Mesh;
void mesh_free(Mesh *mesh); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Mesh, mesh_free)

enum scene_up { SCENE_Z_UP, SCENE_Y_UP };

#define SCENE_SHAPES 5
/* "plane", "torus", "sphere", "cylinder", "torus-knot" */
extern const char *const scene_shape_names[SCENE_SHAPES];

/* One of these names, or the path of an .obj, .gltf or .glb file. */
struct mesh *scene_shape(const char *name, enum scene_up up, GError **error);

struct scene_options {
    double tiles_u, tiles_v; /* 0: as the shape has it */
    enum scene_up up;
    gboolean floor;
};
struct mesh *scene_make(const char *name, const struct scene_options *options, GError **error);

/* plane: −1 … 1 in x and y, normal +z. */
struct mesh *scene_plane(void);
/* Around z; u runs around the axis, v around the tube from its outermost circle upwards. */
struct mesh *scene_torus(double radius, double tube_radius, int n_around, int n_tube);
struct mesh *scene_sphere(void); /* radius 1 */

/* Wavefront OBJ: v, vt, vn and f with any number of corners (convex), negative indices too; other
 * statements are ignored. Missing normals are computed. The mesh is centred and scaled to radius 1.
 */
struct mesh *scene_read_obj(const char *path, enum scene_up up, GError **error);

/* glTF 2.0, text or binary: triangles of its scene, with tangents of the file where there are any.
 * up is that of the file, y by its standard. Buffers are within the file, or files beside it.
 * Everything else in the file is ignored; a file that requires an extension (compression) is
 * refused. */
struct mesh *scene_read_gltf(const char *path, enum scene_up up, GError **error);

/* text is ended by NUL; name is for messages. */
struct mesh *scene_parse_obj(const char *name, const char *text, enum scene_up up, GError **error);
