/* The nodes of a glTF file's scene, and the triangles of its meshes. */
#pragma once

#include "gltf_file.h"
#include "soup.h"

struct gltf_transform {
    double m[4][4]; /* [row][column] */
};

/* Transforms a point (w = 1) or a direction (w = 0). */
void gltf_move_point(const struct gltf_transform *p, const float v[3], double w, float ret[3]);
/* Transforms by the cofactors, so that a normal stays perpendicular to the surface. */
void gltf_move_normal(const struct gltf_transform *p, const float v[3], float ret[3]);
/* Returns the determinant. If it is negative, the transform mirrors. */
double gltf_determinant(const struct gltf_transform *p);

/* Reads a member that is an array of n numbers. Returns FALSE if the member is missing or not such
 * an array. Some elements of values may then be set. */
gboolean gltf_numbers(JsonObject *node, const char *name, double *values, guint n);

/* Called for each node. If the file has no scenes, it is called for each mesh instead, with node
 * NULL. p transforms from the node to the world. mesh is the index of the mesh, or −1 if the node
 * has none. Returns FALSE with an error on failure. */
typedef gboolean (*GltfVisit)(struct gltf *gltf, const struct gltf_transform *p, JsonObject *node,
                              gint64 mesh, gpointer data, GError **error);
/* Calls visit for every node of the file's scene. If there is no scene, calls visit for every mesh.
 * Stops and returns FALSE when a call fails. */
gboolean gltf_visit(struct gltf *gltf, GltfVisit visit, gpointer data, GError **error);

/* Called for a primitive of a mesh. Returns FALSE with an error on failure. */
typedef gboolean (*GltfUse)(struct gltf *gltf, JsonObject *primitive, gpointer data,
                            GError **error);
/* Calls `use` for every primitive of a mesh. Stops and returns FALSE when a call fails. */
gboolean gltf_each_primitive(struct gltf *gltf, gint64 mesh, GltfUse use, gpointer data,
                             GError **error);

/* Adds the triangles of a primitive, transformed by p. Adds nothing for points and lines. If the
 * primitive has no texture coordinates, the function fails if bare is FALSE, and sets them to 0 if
 * bare is TRUE. */
gboolean gltf_add_primitive(struct gltf *gltf, const struct gltf_transform *p,
                            JsonObject *primitive, enum scene_up up, gboolean bare,
                            struct soup *soup, GError **error);
/* Returns FALSE with an error if a coordinate of the soup is not finite or not within ±1e18. */
gboolean gltf_check_positions(const struct gltf *gltf, const struct soup *soup, GError **error);
