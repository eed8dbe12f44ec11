/*
 * This module measures the ends of the shadows of posts on their plate. A view has pictures of one
 * camera at one angle of the turntable under different lamps. What all pictures show is the plate's
 * own pattern, which is divided out.
 *
 * A post's shadow from a point light is the convex hull of two discs: the post's foot, and the
 * projection of its top. This shape, blurred by the pixels, is fitted to the grey values around its
 * end. Different threads may use different views at the same time.
 */
#pragma once

#include "lamps.h"

/* The point of the plate's plane that each pixel sees, in the rig frame; NaN far from the plate. */
struct plate_map {
    int width, height;
    float *xy_mm; /* x, y of each pixel: height × width × 2 */
};
/* Makes the map of a camera. Free it with plate_map_free(). */
struct plate_map *plate_map_new(const struct rig_camera *camera, const struct lamp_target *target);
void plate_map_free(struct plate_map *map); /* NULL is ignored */

typedef struct ShadowView ShadowView;

/* Makes a view. `map` is not copied and must live as long as the view. `rig` is copied. Its lamps
 * and its arc have the positions that are known so far, nominal or estimated. */
ShadowView *shadow_view_new(const struct rig *rig, int camera, double turntable_rad,
                            const struct lamp_target *target, const struct plate_map *map);
void shadow_view_free(ShadowView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ShadowView, shadow_view_free)

/* Adds a picture, linear grey and of the camera's size. index is copied to the sights. Returns
 * FALSE with an error if the picture has another size, or if the plate is dark in the picture. Also
 * returns FALSE with an error if, according to rig and target, the camera does not see the plate or
 * the lamp does not light the plate. */
gboolean shadow_view_add(ShadowView *view, const struct picture *picture, int index, int lamp,
                         double arc_rad, GError **error);

/* Estimates the pose of the whole plate, up to reach_mm and reach_rad from the nominal one, and
 * moves the target's marks to that pose. The views need not be all views of the session. Returns
 * FALSE with an error, and does not change the target, if the score of the best pose is below
 * SHADOWS_MIN_SCORE. */
gboolean shadows_locate(ShadowView *const *views, int n, struct lamp_target *target,
                        double reach_mm, double reach_rad, GError **error);

/* Returns the score of the best pose, without changing the target: the share of the predicted
 * shadows that is dark, 0 to 1. */
double shadows_score(ShadowView *const *views, int n, const struct lamp_target *target,
                     double reach_mm, double reach_rad);
/* Smallest score at which shadows_locate() succeeds. */
#define SHADOWS_MIN_SCORE 0.5

/* Appends a struct lamp_sight for each shadow that was found. If a shadow should be visible but was
 * not found, appends a text with the picture and the reason to rejected. If a lamp is high above
 * the plate, also measures the posts themselves, once for the view; lamp_sight.lamp of these sights
 * is −1. `near` is TRUE if posts and lamps have been adjusted before. The shadows are then close to
 * their prediction. */
void shadow_view_measure(ShadowView *view, const struct rig *rig, const struct lamp_target *target,
                         gboolean near, GArray *sights, GPtrArray *rejected);
