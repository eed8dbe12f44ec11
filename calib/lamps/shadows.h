/*
 * Measures where the shadows of posts end on their plate. Pictures of one camera at one angle of
 * the turntable, lit by different lamps, belong together: what all of them show is the plate's own
 * pattern, and is divided out.
 *
 * A post's shadow from a point of light is the hull of two discs, its foot's and its top's as the
 * lamp throws it; that shape, blurred by the pixels, is fitted to the grey values around its end.
 * One thread a view.
 */
#pragma once

#include "lamps.h"

/* Where each of a camera's pixels looks at the plate's plane, rig frame; NaN: nowhere near. */
struct plate_map {
    int width, height;
    float *xy_mm; /* two a pixel */
};
struct plate_map *plate_map_new(const struct rig_camera *camera, const struct lamp_target *target);
void plate_map_free(struct plate_map *map); /* NULL is ignored */

typedef struct ShadowView ShadowView;

/* rig and map are borrowed. rig: lamps and arc as well as they are known. */
ShadowView *shadow_view_new(const struct rig *rig, int camera, double turntable_rad,
                            const struct lamp_target *target, const struct plate_map *map);
void shadow_view_free(ShadowView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ShadowView, shadow_view_free)

/* picture: linear grey, of the camera's size; index: for sights. FALSE: there is no light in it, or
 * it is of another size. */
gboolean shadow_view_add(ShadowView *view, const struct picture *picture, int index, int lamp,
                         double arc_rad, GError **error);

/* Finds how the plate lies, as a whole: up to reach_mm and reach_rad from where it should. Changes
 * the target's marks. Some views are enough. */
gboolean shadows_locate(ShadowView *const *views, int n, struct lamp_target *target,
                        double reach_mm, double reach_rad, GError **error);

/* Appends struct lamp_sight; and, for each shadow that was looked for in vain, a text that says in
 * which picture and why. near: posts and lamps have been adjusted before, so that the shadows are
 * close to where they are expected. */
void shadow_view_measure(ShadowView *view, const struct rig *rig, const struct lamp_target *target,
                         gboolean near, GArray *sights, GPtrArray *rejected);
