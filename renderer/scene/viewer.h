/*
 * A Viewer draws a material on a mesh as a picture: it holds the mesh, the material as its method
 * put it on the graphics card, the MDF and the backdrop. (A “view” is a direction of a BTF or an
 * MDF.) Belongs to the thread of the GL context, which must be current and whose state it changes.
 */
#pragma once

#include "eigenmaps/eigenmaps.h"
#include "hatching.h"
#include "methods/method.h"
#include "relief/relief.h"
#include "relief/visibility.h"
#include "shapes/scene.h"
#include "synthesis/index_map.h"

/* A further lamp, infinitely far away or near. Light of a near lamp falls with the square of the
 * distance, and its direction differs from point to point. Brightness 1, as of the first lamp,
 * gives a white diffuser lit from its normal the radiance 1; with a near lamp, a diffuser at the
 * origin. */
#define VIEWER_MAX_LAMPS RELIEF_MAX_LAMPS
struct viewer_lamp {
    double theta_deg, phi_deg; /* direction from the origin */
    float rgb[3];
    double distance; /* from the origin, in radii of the mesh; 0: infinitely far away */
    /* Half the angle of a near lamp's cone of light, and the part of it in which light does not
     * fall towards the edge (KHR_lights_punctual); 0: it shines all around. */
    double cone_deg, inner_deg;
    double aim[3]; /* a point on the cone's axis, in radii; not where the lamp is */
};

/* World coordinates are the mesh's: z up. Azimuths are from +x, counter-clockwise seen from above.
 */
struct viewer_settings {
    double camera_azimuth_deg, camera_elevation_deg;
    double camera_distance; /* from the origin, in radii of the mesh; 0: the mesh just fits */
    double camera_pan[2]; /* offset of the point that the camera looks at: right and up, in radii of
                             the mesh */
    double camera_fov_deg;                 /* of the picture's shorter side */
    double light_theta_deg, light_phi_deg; /* direction of the light from the origin */
    double lamp;                           /* its brightness */
    double light_distance, light_cone_deg, light_inner_deg; /* as of viewer_lamp; it aims at the
                                                               origin */
    int n_lamps;                                            /* number of further lamps */
    struct viewer_lamp lamps[VIEWER_MAX_LAMPS];
    double environment_turn_deg; /* of the environment about the vertical axis, counter-clockwise
                                    seen from above */
    int environment_lamps;       /* lamps that stand for the environment, at most */
    double tiles_u, tiles_v;     /* 0: as the mesh has it */
    double exposure_ev;          /* 0: a white diffuser lit from its normal is 0.8 of full scale */
    /* Radiance of an even sky, relative to the light's irradiance / π. It is added everywhere; in
     * shadow it alone is left: ambient / π · L_a with L_a = ∫ T dω of Wang et al. 2005 §4.2, who
     * show L_a in shadow only. */
    double ambient;
    int samples; /* supersampling each way */
    struct method_style style;
    /* These three take viewer_set_mdf(). Silhouettes: a ray that misses the structure shows the
     * surface behind it (Wang et al. 2005 §4.1). Shadows: the mesh casts shadows; with silhouettes,
     * the structure casts and receives them, too (§4.2). */
    gboolean silhouettes, shadows; /* shadows: of every lamp */
    struct visibility_options visibility;
    int shadow_size; /* width and height of the first lamp's shadow map; see relief.h for others */
    gboolean backdrop; /* the environment is seen behind the mesh; takes viewer_set_environment() */
    gboolean plain;    /* draws one texture × n·l instead of the BTF, for comparison */
    /* The material without end, in hexagons (synthesis/endless.h). Methods without a material file,
     * viewer_render_flat() and plain pictures ignore it; all do while there is an index map. */
    gboolean endless;
};

extern const struct viewer_settings viewer_settings_default;

/* The error names the setting that is out of range, its value and the range. */
gboolean viewer_settings_check(const struct viewer_settings *settings, GError **error);

/* The factor on reflectance before the tone curve: 0.8 · 2^EV. */
double viewer_exposure(const struct viewer_settings *settings);

typedef struct Viewer Viewer;

/* Describes struct vertex to the inputs of mesh.vert, locations 0 … VIEWER_VERTEX_ATTRIBUTES − 1,
 * for the buffer and the vertex array that are bound. */
#define VIEWER_VERTEX_ATTRIBUTES 4
void viewer_vertex_attributes(void);

/* Makes a viewer of eigen-maps. NULL: call viewer_open() or viewer_set_method() before drawing. */
Viewer *viewer_new(const struct eigenmaps *material, GError **error);
void viewer_free(Viewer *viewer); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Viewer, viewer_free)

gboolean viewer_set_material(Viewer *viewer, const struct eigenmaps *material, GError **error);
gboolean viewer_open(Viewer *viewer, const struct method *method, const char *path, GError **error);
/* Takes the material that the method opened, if it succeeds. */
gboolean viewer_set_method(Viewer *viewer, const struct method *method, gpointer material,
                           GError **error);
/* Copies the parts. A part without an added material shows the main material. */
gboolean viewer_set_mesh(Viewer *viewer, const struct mesh *mesh, GError **error);

/* A scene has several materials: the functions above set the main one, number 0, and this one
 * adds another, which repeats `tiles` times in one unit of the texture coordinates. Returns its
 * number, −1 on error. The index map, viewer_render_flat() and plain pictures use the main
 * material alone. */
#define VIEWER_MAX_MATERIALS RELIEF_MAX_MATERIALS
int viewer_add_material(Viewer *viewer, const struct method *method, const char *path, double tiles,
                        GError **error);
/* The same as viewer_set_mdf() and viewer_open_mdf(), for the material with this number. */
gboolean viewer_set_material_mdf(Viewer *viewer, int material, const struct mdf_source *mdf,
                                 GError **error);
gboolean viewer_open_material_mdf(Viewer *viewer, int material, const char *path, GError **error);

/* The MDF of the material in any of its forms; NULL: none. Copies what it needs. */
gboolean viewer_set_mdf(Viewer *viewer, const struct mdf_source *mdf, GError **error);
gboolean viewer_open_mdf(Viewer *viewer, const char *path, GError **error);

/* The index map through which the material and its MDF are seen (gl/index_texture.h); NULL: the
 * sample is repeated. Copies what it needs. The material's sample must be the map's; methods
 * without a material file, viewer_render_flat() and plain pictures ignore it. If settings leave the
 * tiles to the mesh, their number becomes a multiple of the map's length in tiles. */
gboolean viewer_set_index(Viewer *viewer, const struct index_map *index, GError **error);
/* FALSE also if the map's sample has another size than the open material. */
gboolean viewer_open_index(Viewer *viewer, const char *path, GError **error);
/* Rounds the numbers of tiles to multiples of the map's size, so that their size along v changes
 * least; without a map they stay. */
void viewer_whole_tiles(const Viewer *viewer, double *u, double *v);
/* The map, owned by the viewer; NULL: none. */
const struct index_map *viewer_index(const Viewer *viewer);

/* The hexagons of the picture that was drawn last, with these settings, and their lattice. Owned by
 * the viewer, until another material is set; NULL: none. */
const struct endless *viewer_endless(const Viewer *viewer, const struct viewer_settings *settings,
                                     struct endless_lattice *ret);

/* The environment map behind the mesh; copies it. Its light comes from lamps in the settings, see
 * environment_light(). */
struct environment;
gboolean viewer_set_environment(Viewer *viewer, const struct environment *environment,
                                GError **error);

/* GPU memory of the material, its MDF and its index map, in bytes: textures with all their mip
 * levels. */
struct viewer_memory {
    gint64 material, mdf, index;
};
struct viewer_memory viewer_memory(const Viewer *viewer);

/* For a session that is still being captured: pictures are hatched where the nearest planned view
 * is not measured yet (hatching.h). n = 0: no hatching. Copies. */
void viewer_set_planned(Viewer *viewer, const struct planned_view *views, guint n);

/* Sets camera_distance, if it is 0, and camera_pan so that the mesh fills a picture of aspect width
 * / height. Drawing does so by itself if this was not called, but again for every picture. */
void viewer_fit(const Viewer *viewer, struct viewer_settings *settings, double aspect);

/* Into a framebuffer object (0: the window's) of width × height pixels, as sRGB. */
gboolean viewer_draw(Viewer *viewer, const struct viewer_settings *settings, guint framebuffer,
                     int width, int height, GError **error);

/* width × height × 3 bytes, sRGB, top row first; g_free() it. */
guint8 *viewer_render(Viewer *viewer, const struct viewer_settings *settings, int width, int height,
                      GError **error);

/* width × height × 3 floats, top row first: the same picture as light, linear: exposed, but neither
 * toned nor rounded; g_free() it. */
float *viewer_render_light(Viewer *viewer, const struct viewer_settings *settings, int width,
                           int height, GError **error);

/* width × height × 4 floats, top row first: linear reflectance before exposure and tone, without
 * supersampling; the fourth is 0 where only the background is seen, which is exposed already. */
float *viewer_render_linear(Viewer *viewer, const struct viewer_settings *settings, int width,
                            int height, GError **error);

/* The values with which a sample of such a picture can be shaded elsewhere; the fourth float is as
 * above. Texels: two coordinates in tiles, +y along the texture's rows downwards, and 1 + the
 * number of the material, or 0 on a back face. Directions: unit vectors in the local frame. "lit":
 * the share of the lamp's light that arrives (0 … 1; for a near lamp times its irradiance on a
 * surface that faces it, relative to that at the origin); the distance from the mesh along the ray
 * to the structure; and the distance from the eye to the mesh. The lamp is the first, or where that
 * is off the first of the further ones, if there are any. */
enum viewer_geometry {
    VIEWER_GEOMETRY_TEXEL,
    VIEWER_GEOMETRY_VIEW,
    VIEWER_GEOMETRY_LIGHT,
    VIEWER_GEOMETRY_LIT,
};
float *viewer_render_geometry(Viewer *viewer, const struct viewer_settings *settings,
                              enum viewer_geometry which, int width, int height, GError **error);

/* Renders one flat tile, with one view direction and one light direction for all pixels (in the
 * tile's frame): width × height × 4 floats, top row first, linear reflectance under the lamp alone.
 */
float *viewer_render_flat(Viewer *viewer, const struct viewer_settings *settings,
                          const float to_view[3], const float to_light[3], int width, int height,
                          GError **error);

/* The other half of viewer_render(): a linear picture of samples × samples per pixel, exposed and
 * toned to width × height × 3 bytes. */
guint8 *viewer_resolve(Viewer *viewer, const struct viewer_settings *settings, const float *linear,
                       int width, int height, GError **error);

void viewer_finish(void); /* returns when everything asked for is drawn */
