#include "viewer_settings.h"

#include <math.h>

#define WHITE 0.8 /* value of a white diffuser at an exposure of 0 EV */

const struct viewer_settings viewer_settings_default = {
    .camera_azimuth_deg = -90.0,
    .camera_elevation_deg = 40.0,
    .camera_fov_deg = 30.0,
    .light_theta_deg = 50.0,
    .light_phi_deg = 200.0,
    .exposure_ev = 0.7,
    .ambient = 0.05,
    .environment_lamps = VIEWER_MAX_LAMPS,
    .lamp = 1.0,
    .samples = 1,
    .visibility = {.layers = VISIBILITY_MAX_LAYERS},
    .shadow_size = 1024,
};

gboolean viewer_settings_check(const struct viewer_settings *s, GError **error) {
    const struct {
        const char *name;
        double value, low, high;
    } ranges[] = {
        {"camera azimuth", s->camera_azimuth_deg, -1e6, 1e6},
        {"camera elevation", s->camera_elevation_deg, -90.0, 90.0},
        {"camera distance", s->camera_distance, 0.0, 1000.0},
        {"camera pan", s->camera_pan[0], -1000.0, 1000.0},
        {"camera pan", s->camera_pan[1], -1000.0, 1000.0},
        {"camera field of view", s->camera_fov_deg, 1.0, 120.0},
        {"light theta", s->light_theta_deg, 0.0, 180.0},
        {"light size", s->light_size_deg, 0.0, 60.0},
        {"light phi", s->light_phi_deg, -1e6, 1e6},
        {"tiles", s->tiles_u, 0.0, 1000.0},
        {"tiles", s->tiles_v, 0.0, 1000.0},
        {"exposure", s->exposure_ev, -20.0, 20.0},
        {"ambient", s->ambient, 0.0, 100.0},
        {"light brightness", s->lamp, 0.0, 100.0},
        {"light distance", s->light_distance, 0.0, 1000.0},
        {"light cone", s->light_cone_deg, 0.0, 90.0},
        {"inner cone of the light", s->light_inner_deg, 0.0, 90.0},
        {"number of lamps in addition to a near light", s->n_lamps, 0.0,
         VIEWER_MAX_LAMPS - (s->light_distance > 0.0 && s->lamp > 0.0)},
        {"environment's turn", s->environment_turn_deg, -1e6, 1e6},
        {"environment's lamps", s->environment_lamps, 1.0, VIEWER_MAX_LAMPS},
        {"supersampling", s->samples, 1.0, 8.0},
        {"layers", s->visibility.layers, 1.0, VISIBILITY_MAX_LAYERS},
        {"shadow map", s->shadow_size, 16.0, 16384.0},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(ranges); k++)
        if (!(ranges[k].value >= ranges[k].low && ranges[k].value <= ranges[k].high)) {
            g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                        "%s is %g, but must be %g … %g", ranges[k].name, ranges[k].value,
                        ranges[k].low, ranges[k].high);
            return FALSE;
        }
    for (int k = 0; k < s->n_lamps; k++) {
        const struct viewer_lamp *l = &s->lamps[k];
        if (!(l->distance >= 0.0 && l->distance <= 1000.0 && l->cone_deg >= 0.0 &&
              l->cone_deg <= 90.0 && l->inner_deg >= 0.0 && l->inner_deg <= 90.0)) {
            g_set_error(
                error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                "further lamp %d has the distance %g, the cone %g° and the inner cone %g°; the "
                "distance must be within 0 … 1000 radii of the mesh, and both cones within 0 … 90°",
                k + 1, l->distance, l->cone_deg, l->inner_deg);
            return FALSE;
        }
    }
    return TRUE;
}

double viewer_settings_exposure(const struct viewer_settings *s) {
    return WHITE * exp2(s->exposure_ev);
}
