/*
 * A Viewer draws a material on a mesh as a picture. It holds the mesh, the MDF, the backdrop, and
 * the material as its method has uploaded it to the graphics card. (The word “view” is used for a
 * direction of a BTF or an MDF.) A Viewer belongs to the thread of the GL context. The context must
 * be current. The functions change the state of the context.
 */
#pragma once

#include "codecs/eigenmaps/eigenmaps.h"
#include "drawing/relief/relief.h"
#include "hatching.h"
#include "shapes/scene.h"
#include "synthesis/index_map.h"
#include "viewer_settings.h"

typedef struct Viewer Viewer;

/* Sets the layout of struct vertex for the inputs of mesh.vert, which have the locations 0 …
 * VIEWER_VERTEX_ATTRIBUTES − 1. Acts on the bound buffer and vertex array. */
#define VIEWER_VERTEX_ATTRIBUTES 4
void viewer_vertex_attributes(void);

/* Makes a viewer that draws eigen-maps. If material is NULL, call viewer_open() or
 * viewer_set_method() before drawing. */
Viewer *viewer_new(const struct eigenmaps *material, GError **error);
void viewer_free(Viewer *viewer); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Viewer, viewer_free)

/* These two functions replace the main material and its method. They do not change the MDF. On
 * error, the previous material stays. viewer_set_material() copies eigen-maps to the graphics card.
 * viewer_open() opens a file with a method (method_open()). */
gboolean viewer_set_material(Viewer *viewer, const struct eigenmaps *material, GError **error);
gboolean viewer_open(Viewer *viewer, const struct method *method, const char *path, GError **error);
/* Sets a material that the method has opened. Takes ownership of the material if the function
 * succeeds. */
gboolean viewer_set_method(Viewer *viewer, const struct method *method, gpointer material,
                           GError **error);
/* Sets the mesh and copies it. If the material of a part has not been added, the part shows the
 * main material. Fails if the mesh has more than VISIBILITY_MAX_PARTS parts. */
gboolean viewer_set_mesh(Viewer *viewer, const struct mesh *mesh, GError **error);

/* Adds a further material. The main material, which the functions above set, has number 0. The new
 * material repeats `tiles` times in one unit of the texture coordinates. Returns the number of the
 * new material, or −1 on error. The index map, viewer_render_flat() and plain pictures use the main
 * material only. */
#define VIEWER_MAX_MATERIALS RELIEF_MAX_MATERIALS
int viewer_add_material(Viewer *viewer, const struct method *method, const char *path, double tiles,
                        GError **error);
/* These functions do for the material with this number what viewer_set_mdf() and viewer_open_mdf()
 * do for the main material. */
gboolean viewer_set_material_mdf(Viewer *viewer, int material, const struct mdf_source *mdf,
                                 GError **error);
gboolean viewer_open_material_mdf(Viewer *viewer, int material, const char *path, GError **error);

/* viewer_set_mdf() sets the MDF of the main material, in any of its forms, and copies everything
 * that it needs. NULL removes the MDF. viewer_open_mdf() opens a file of an MDF. */
gboolean viewer_set_mdf(Viewer *viewer, const struct mdf_source *mdf, GError **error);
gboolean viewer_open_mdf(Viewer *viewer, const char *path, GError **error);

/* Sets the index map through which the main material and its MDF are seen (gl/index_texture.h), and
 * copies everything that it needs. With NULL, the sample is repeated. The map must be made for the
 * sample of the material. Methods without a material file, viewer_render_flat() and plain pictures
 * ignore the map.
 *
 * The settings may leave the numbers of tiles to the mesh. These numbers then become multiples of
 * the size of the map in tiles. */
gboolean viewer_set_index(Viewer *viewer, const struct index_map *index, GError **error);
/* Opens the file of an index map and sets the map. Also fails if the map was made for a sample of
 * another size than that of the main material. */
gboolean viewer_open_index(Viewer *viewer, const char *path, GError **error);
/* Rounds the numbers of tiles *u and *v to multiples of the size of the index map in tiles. *v is
 * rounded first. *u is then chosen so that the shape of the tiles changes least. Without an index
 * map, the numbers are not changed. */
void viewer_whole_tiles(const Viewer *viewer, double *u, double *v);
/* Returns the index map, or NULL if there is none. The viewer owns it. */
const struct index_map *viewer_index(const Viewer *viewer);

/* Returns the hexagons by which a picture with these settings continues the material endlessly
 * (`endless` in struct viewer_settings). *ret receives the lattice of the hexagons with these
 * settings. The viewer owns the hexagons, which are valid until another material is set.
 *
 * The first picture that needs hexagons makes them. Before that, the function returns NULL and does
 * not set *ret. It does the same if a picture with these settings has no hexagons. */
const struct endless *viewer_endless(const Viewer *viewer, const struct viewer_settings *settings,
                                     struct endless_lattice *ret);

/* Sets the environment map that is visible behind the mesh, and copies it. The light of the
 * environment comes from lamps in the settings; see environment_light(). */
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

/* If camera_distance is 0, sets camera_distance and camera_pan so that the mesh fills a picture
 * with aspect = width / height. Changes nothing if camera_distance is not 0. Without this call,
 * drawing computes both values again for every picture. */
void viewer_fit(const Viewer *viewer, struct viewer_settings *settings, double aspect);

/* Draws into a framebuffer object (0 is the window's framebuffer) of width × height pixels, as
 * sRGB. */
gboolean viewer_draw(Viewer *viewer, const struct viewer_settings *settings, guint framebuffer,
                     int width, int height, GError **error);

/* Returns the picture of viewer_draw() as linear light, width × height × 3 floats, top row first.
 * The picture is exposed, but the tone curve and rounding are not applied. Free it with
 * g_free(). */
float *viewer_render_light(Viewer *viewer, const struct viewer_settings *settings, int width,
                           int height, GError **error);

/* Returns linear reflectance before exposure and tone curve, without supersampling: width × height
 * × 4 floats, top row first. The fourth float is 0 where only the background is seen. The
 * background is already exposed. */
float *viewer_render_linear(Viewer *viewer, const struct viewer_settings *settings, int width,
                            int height, GError **error);

/* The values of a sample that viewer_render_geometry() returns. */
enum viewer_geometry {
    /* [0] and [1]: texture coordinates in tiles, with +y along the texture's rows downwards. [2]: 1
     * plus the number of the material, or 0 on a back face. */
    VIEWER_GEOMETRY_TEXEL,
    /* Unit vector towards the eye, in the local frame. */
    VIEWER_GEOMETRY_VIEW,
    /* Unit vector towards the lamp, in the local frame. */
    VIEWER_GEOMETRY_LIGHT,
    /* [0]: the share of the lamp's light that arrives, 0 … 1. For a near lamp, this share is
     * multiplied by the irradiance on a surface that faces the lamp, relative to the irradiance at
     * the origin. [1]: the distance from the mesh along the ray to the structure. [2]: the distance
     * from the eye to the mesh. */
    VIEWER_GEOMETRY_LIT,
};
/* Returns values with which each sample of a picture of viewer_render_linear() can be shaded
 * elsewhere: width × height × 4 floats, top row first. Three floats are the values that `which`
 * names. The fourth float is that of viewer_render_linear(). The lamp is the first lamp. If the
 * first lamp is off, it is the first of the further lamps, if there is one. Free the result with
 * g_free(). */
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
