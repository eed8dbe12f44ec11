/*
 * A Viewer draws a material on a mesh as a picture. It holds the mesh, the MDF, the backdrop, and
 * the material as its method has uploaded it to the graphics card. (The word “view” is used for a
 * direction of a BTF or an MDF.) A Viewer belongs to the thread of the GL context. The context must
 * be current, and its state is changed.
 */
#pragma once

#include "codecs/eigenmaps/eigenmaps.h"
#include "drawing/relief/relief.h"
#include "hatching.h"
#include "shapes/scene.h"
#include "synthesis/index_map.h"
#include "viewer_settings.h"

typedef struct Viewer Viewer;

/* Describes struct vertex to the inputs of mesh.vert, locations 0 … VIEWER_VERTEX_ATTRIBUTES − 1,
 * for the bound buffer and vertex array. */
#define VIEWER_VERTEX_ATTRIBUTES 4
void viewer_vertex_attributes(void);

/* Makes a viewer of eigen-maps. If material is NULL, call viewer_open() or viewer_set_method()
 * before drawing. */
Viewer *viewer_new(const struct eigenmaps *material, GError **error);
void viewer_free(Viewer *viewer); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Viewer, viewer_free)

gboolean viewer_set_material(Viewer *viewer, const struct eigenmaps *material, GError **error);
gboolean viewer_open(Viewer *viewer, const struct method *method, const char *path, GError **error);
/* Sets a material that the method has opened. Takes ownership of the material if it succeeds. */
gboolean viewer_set_method(Viewer *viewer, const struct method *method, gpointer material,
                           GError **error);
/* Sets the mesh and copies it. A part whose material has not been added shows the main material.
 * Fails if the mesh has more than VISIBILITY_MAX_PARTS parts. */
gboolean viewer_set_mesh(Viewer *viewer, const struct mesh *mesh, GError **error);

/* Adds a material to the main material (number 0), which the functions above set. The new material
 * repeats `tiles` times in one unit of the texture coordinates. Returns the number of the material,
 * or −1 on error. The index map, viewer_render_flat() and plain pictures only use the main
 * material. */
#define VIEWER_MAX_MATERIALS RELIEF_MAX_MATERIALS
int viewer_add_material(Viewer *viewer, const struct method *method, const char *path, double tiles,
                        GError **error);
/* Do the same as viewer_set_mdf() and viewer_open_mdf() for the material with this number. */
gboolean viewer_set_material_mdf(Viewer *viewer, int material, const struct mdf_source *mdf,
                                 GError **error);
gboolean viewer_open_material_mdf(Viewer *viewer, int material, const char *path, GError **error);

/* Sets the MDF of the material, in any of its forms. NULL removes it. Copies everything that it
 * needs. */
gboolean viewer_set_mdf(Viewer *viewer, const struct mdf_source *mdf, GError **error);
gboolean viewer_open_mdf(Viewer *viewer, const char *path, GError **error);

/* Sets the index map through which the material and its MDF are seen (gl/index_texture.h). With
 * NULL, the sample is repeated. Copies everything that it needs. The map must be made for the
 * sample of the material. Methods without a material file, viewer_render_flat() and plain pictures
 * ignore the map. If the settings leave the tiles to the mesh, their number becomes a multiple of
 * the length of the map in tiles. */
gboolean viewer_set_index(Viewer *viewer, const struct index_map *index, GError **error);
/* Opens an index map. Also fails if its sample and the open material have different sizes. */
gboolean viewer_open_index(Viewer *viewer, const char *path, GError **error);
/* Rounds the numbers of tiles to multiples of the map's size. *v is rounded first, and *u is then
 * chosen so that the shape of the tiles changes least. Without a map, the numbers are not
 * changed. */
void viewer_whole_tiles(const Viewer *viewer, double *u, double *v);
/* Returns the index map, or NULL if there is none. The viewer owns it. */
const struct index_map *viewer_index(const Viewer *viewer);

/* Returns the hexagons of the picture that was drawn last, and their lattice with these settings.
 * Returns NULL if there are none. The viewer owns them until another material is set. */
const struct endless *viewer_endless(const Viewer *viewer, const struct viewer_settings *settings,
                                     struct endless_lattice *ret);

/* Sets the environment map behind the mesh and copies it. Its light comes from lamps in the
 * settings; see environment_light(). */
struct environment;
gboolean viewer_set_environment(Viewer *viewer, const struct environment *environment,
                                GError **error);

/* The GPU memory of all materials, of all MDFs and of the index map, in bytes. Textures count with
 * all their mip levels. */
struct viewer_memory {
    gint64 material, mdf, index;
};
struct viewer_memory viewer_memory(const Viewer *viewer);

/* For a session that is still being captured: hatches pictures where the nearest planned view is
 * not measured yet (hatching.h). n = 0 removes the hatching. Copies the views. */
void viewer_set_planned(Viewer *viewer, const struct planned_view *views, guint n);

/* If camera_distance is 0, sets it and camera_pan so that the mesh fills a picture of the aspect
 * width / height. Otherwise changes nothing. Without this call, drawing computes both again for
 * every picture. */
void viewer_fit(const Viewer *viewer, struct viewer_settings *settings, double aspect);

/* Draws into a framebuffer object (0 is the window's framebuffer) of width × height pixels, as
 * sRGB. */
gboolean viewer_draw(Viewer *viewer, const struct viewer_settings *settings, guint framebuffer,
                     int width, int height, GError **error);

/* Returns the picture of viewer_draw() as linear light, width × height × 3 floats, top row first.
 * It is exposed, but the tone curve and rounding are not applied. Free it with g_free(). */
float *viewer_render_light(Viewer *viewer, const struct viewer_settings *settings, int width,
                           int height, GError **error);

/* Returns linear reflectance before exposure and tone, without supersampling: width × height × 4
 * floats, top row first. The fourth is 0 where only the background is seen. The background is
 * already exposed. */
float *viewer_render_linear(Viewer *viewer, const struct viewer_settings *settings, int width,
                            int height, GError **error);

/* Returns values with which the samples of a picture of viewer_render_linear() can be shaded
 * elsewhere. The fourth float is the same as in that picture. Texel: two coordinates in tiles, +y
 * along the texture's rows downwards, and 1 + the number of the material, or 0 on a back face. View
 * and light: unit vectors in the local frame. Lit: three values. The first is the share of the
 * lamp's light that arrives, 0 … 1. For a near lamp it is multiplied by the irradiance on a surface
 * that faces the lamp, relative to the irradiance at the origin. The second is the distance from
 * the mesh along the ray to the structure, and the third the distance from the eye to the mesh. The
 * lamp is the first lamp. If it is off, the first of the further lamps is used, if there is one. */
enum viewer_geometry {
    VIEWER_GEOMETRY_TEXEL,
    VIEWER_GEOMETRY_VIEW,
    VIEWER_GEOMETRY_LIGHT,
    VIEWER_GEOMETRY_LIT,
};
float *viewer_render_geometry(Viewer *viewer, const struct viewer_settings *settings,
                              enum viewer_geometry which, int width, int height, GError **error);

/* Renders one flat tile, with one view direction and one light direction for all pixels, in the
 * frame of the tile. Returns linear reflectance under the lamp only: width × height × 4 floats, top
 * row first. */
float *viewer_render_flat(Viewer *viewer, const struct viewer_settings *settings,
                          const float to_view[3], const float to_light[3], int width, int height,
                          GError **error);

/* Does the second half of viewer_draw(): applies exposure and tone curve to a linear picture of
 * samples × samples per pixel. Returns width × height × 3 bytes. */
guint8 *viewer_resolve(Viewer *viewer, const struct viewer_settings *settings, const float *linear,
                       int width, int height, GError **error);

void viewer_finish(void); /* waits until all drawing has finished */
