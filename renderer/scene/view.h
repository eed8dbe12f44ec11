/* A material on a mesh, as a picture. Needs a current GL context, of which it changes the state. */
#pragma once

#include "eigenmaps/eigenmaps.h"
#include "hatching.h"
#include "methods/method.h"
#include "relief/relief.h"
#include "relief/visibility.h"
#include "shapes/scene.h"

/* Far away; its light, like that of the first, is 1 where a white diffuser
 * that it lights from its normal is. */
#define VIEW_MAX_LAMPS RELIEF_MAX_LAMPS
struct view_lamp {
    double theta_deg, phi_deg;
    float rgb[3];
};

/* World coordinates are the mesh's: z up. Azimuths are from +x, counter-clockwise seen from above.
 */
struct view_settings {
    double camera_azimuth_deg, camera_elevation_deg;
    double camera_distance; /* from the origin, in radii of the mesh; 0: the mesh just fits */
    double camera_pan[2];   /* of what it looks at: to the right and up, in radii of the mesh */
    double camera_fov_deg;  /* of the picture's shorter side */
    double light_theta_deg, light_phi_deg; /* a light far away */
    double lamp;                           /* how bright it is */
    int n_lamps;                           /* further ones */
    struct view_lamp lamps[VIEW_MAX_LAMPS];
    double tiles_u, tiles_v; /* 0: as the mesh has it */
    double exposure_ev;      /* 0: a white diffuser lit from its normal is 0.8 of full scale */
    double ambient;          /* radiance of an even sky, relative to the light's irradiance / π */
    int samples;             /* supersampling each way */
    struct method_style style;
    /* These three take view_set_mdf(). Silhouettes: where a ray misses the structure, what is
     * behind is seen (Wang et al. 2005 §4.1). Shadows: those that the mesh casts, with silhouettes
     * of the structure too, and on it (§4.2); without an MDF or silhouettes the mesh's own. */
    gboolean silhouettes, shadows; /* shadows: of every lamp */
    struct visibility_options visibility;
    int shadow_size;   /* of the first lamp's map, each way; of more than 4 further ones a half, of
                          more than 16 a quarter */
    gboolean backdrop; /* the environment is seen behind the mesh; takes view_set_environment() */
    gboolean plain;    /* instead of the BTF one texture × n·l, to compare with */
};

extern const struct view_settings view_settings_default;

/* Says what is out of range, and the range. */
gboolean view_settings_check(const struct view_settings *settings, GError **error);

/* What reflectance is multiplied by before it is toned. */
double view_exposure(const struct view_settings *settings);

typedef struct View View;

/* Of eigen-maps; NULL: view_open() or view_set_method() follows before anything is drawn. */
View *view_new(const struct eigenmaps *material, GError **error);
void view_free(View *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(View, view_free)

gboolean view_set_material(View *view, const struct eigenmaps *material, GError **error);
gboolean view_open(View *view, const struct method *method, const char *path, GError **error);
/* Takes the material that the method opened, if it succeeds. */
gboolean view_set_method(View *view, const struct method *method, gpointer material,
                         GError **error);
gboolean view_set_mesh(View *view, const struct mesh *mesh, GError **error); /* copies */

/* The MDF of the material in any of its forms; NULL: none. Copies what it needs. */
gboolean view_set_mdf(View *view, const struct mdf_source *mdf, GError **error);
gboolean view_open_mdf(View *view, const char *path, GError **error);

/* A picture of all directions; copies it. Lamps that give its light are settings'. */
struct environment;
gboolean view_set_environment(View *view, const struct environment *environment, GError **error);

/* Bytes that the material and its MDF take on the card, in textures with all their levels. */
struct view_memory {
    gint64 material, mdf;
};
struct view_memory view_memory(const View *view);

/* Of a session that is still being captured: where the nearest of these views is missing, pictures
 * are striped (hatching.h). 0: no stripes. Copies. */
void view_set_planned(View *view, const struct planned_view *views, guint n);

/* Sets camera_distance, if it is 0, and camera_pan so that the mesh fills the picture (width /
 * height); what draws does that by itself, but anew for every picture. */
void view_fit(const View *view, struct view_settings *settings, double aspect);

/* Into a framebuffer object (0: the window's) of width × height pixels, as sRGB. */
gboolean view_draw(View *view, const struct view_settings *settings, guint framebuffer, int width,
                   int height, GError **error);

/* width × height × 3 bytes, sRGB, top row first; g_free() it. */
guint8 *view_render(View *view, const struct view_settings *settings, int width, int height,
                    GError **error);

/* width × height × 3 floats, top row first: the same picture as light, linear: exposed, but neither
 * toned nor rounded; g_free() it. */
float *view_render_light(View *view, const struct view_settings *settings, int width, int height,
                         GError **error);

/* width × height × 4 floats, top row first: linear reflectance before exposure and tone, without
 * supersampling; the fourth is 0 where only the background is seen, which is exposed already. */
float *view_render_linear(View *view, const struct view_settings *settings, int width, int height,
                          GError **error);

/* What a sample of such a picture needs to be shaded elsewhere; the fourth float as above. Texels
 * are in tiles, +y along the texture's rows downwards; directions are unit, in the local frame;
 * "lit" is how much of the lamp's light arrives (0 … 1), the way from the mesh along the ray to the
 * structure, and that from the eye to the mesh. */
enum view_geometry {
    VIEW_GEOMETRY_TEXEL,
    VIEW_GEOMETRY_VIEW,
    VIEW_GEOMETRY_LIGHT,
    VIEW_GEOMETRY_LIT,
};
float *view_render_geometry(View *view, const struct view_settings *settings,
                            enum view_geometry which, int width, int height, GError **error);

/* One tile seen flat, a texel of it wherever a pixel is, all from the same directions in its frame:
 * width × height × 4 floats, top row first, linear reflectance under the lamp alone. */
float *view_render_flat(View *view, const struct view_settings *settings, const float to_view[3],
                        const float to_light[3], int width, int height, GError **error);

/* The other half of view_render(): a linear picture of samples × samples a pixel, exposed and toned
 * to width × height × 3 bytes. */
guint8 *view_resolve(View *view, const struct view_settings *settings, const float *linear,
                     int width, int height, GError **error);

void view_finish(void); /* returns when everything asked for is drawn */
