/*
 * The settings of a picture: camera, lamps, and what is drawn of the material. Plain data.
 */
#pragma once

#include "drawing/methods/method.h"
#include "drawing/relief/relief.h"
#include "drawing/relief/visibility.h"

#define VIEWER_MAX_LAMPS RELIEF_MAX_LAMPS
/* A further lamp, infinitely far away or near. The light of a near lamp decreases with the square
 * of the distance, and comes from a different direction at each point.
 *
 * As for the first lamp, brightness 1 gives the radiance 1 to a white diffuser that is lit along
 * its normal. For a near lamp, this diffuser is at the origin. */
struct viewer_lamp {
    double theta_deg, phi_deg; /* direction of the lamp from the origin */
    float rgb[3];
    double distance; /* from the origin, in radii of the mesh; 0 means infinitely far away */
    /* `cone_deg` is half the angle of a near lamp's cone of light; 0 if the lamp shines in all
     * directions. `inner_deg` is half the angle of the inner cone, within which the light has full
     * strength (KHR_lights_punctual). */
    double cone_deg, inner_deg;
    /* a point on the axis of the cone, in radii of the mesh; not the position of the lamp */
    double aim[3];
};

/* World coordinates are the coordinates of the mesh, with z up. Azimuths are from +x,
 * counter-clockwise seen from above. */
struct viewer_settings {
    double camera_azimuth_deg, camera_elevation_deg;
    /* Distance from the point that the camera looks at, in radii of the mesh; 0 means that the mesh
     * just fits into the picture. */
    double camera_distance;
    /* Offset from the origin to the point that the camera looks at: to the right and up, in radii
     * of the mesh. */
    double camera_pan[2];
    double camera_fov_deg;                 /* field of view along the picture's shorter side */
    double light_theta_deg, light_phi_deg; /* direction of the first lamp from the origin */
    double lamp;                           /* brightness of the first lamp */
    /* Distance and cone of the first lamp, as in struct viewer_lamp. The cone aims at the origin.
     */
    double light_distance, light_cone_deg, light_inner_deg;
    int n_lamps; /* number of further lamps */
    struct viewer_lamp lamps[VIEWER_MAX_LAMPS];
    /* Rotation of the environment about the vertical axis, counter-clockwise seen from above. */
    double environment_turn_deg;
    int environment_lamps;   /* largest number of lamps that represent the environment */
    double tiles_u, tiles_v; /* if one is 0, both are those of the mesh */
    /* Exposure in stops. At 0, a white diffuser that is lit along its normal has 0.8 of full
     * scale. */
    double exposure_ev;
    /* Radiance of an even sky, relative to the light's irradiance / π. The light of the sky is
     * added everywhere. In a shadow, it is the only light: ambient / π · L_a, with L_a = ∫ T dω of
     * Wang et al. 2005 §4.2. In the paper, L_a is added only in shadows. */
    double ambient;
    int samples; /* number of samples of a pixel in each direction */
    struct method_style style;
    /* `silhouettes`: a ray that misses the structure shows the surface behind it (Wang et al. 2005
     * §4.1). This needs an MDF (viewer_set_mdf()). `shadows`: the mesh casts shadows. If both are
     * set, the structure also casts and receives shadows (§4.2). */
    gboolean silhouettes, shadows; /* shadows of every lamp */
    struct visibility_options visibility;
    /* With silhouettes by the shell, measured views are moved along the surface before they are
     * mixed (along.glsl). A reference also moves the views if it has an MDF
     * (reference_move_along_surface()). */
    gboolean along_surface;
    /* Angle that the first lamp covers in the sky, seen from the mesh. 0 gives sharp shadows. Other
     * lamps always have sharp shadows. */
    double light_size_deg;
    /* Width and height of the first lamp's shadow map, in pixels; see relief.h for the others. */
    int shadow_size;
    /* The environment is visible behind the mesh; needs viewer_set_environment(). */
    gboolean backdrop;
    gboolean plain; /* draws one texture × n·l instead of the BTF, for comparison */
    /* Continues the material endlessly, in hexagons (synthesis/endless.h). Methods without a
     * material file, viewer_render_flat() and plain pictures ignore it. It is also ignored while
     * there is an index map. */
    gboolean endless;
};

extern const struct viewer_settings viewer_settings_default;

/* Checks settings. The error names the setting that is out of range, its value and the range. */
gboolean viewer_settings_check(const struct viewer_settings *settings, GError **error);

/* Returns the factor on reflectance before the tone curve: 0.8 · 2^EV. */
double viewer_settings_exposure(const struct viewer_settings *settings);
