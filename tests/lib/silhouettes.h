/*
 * How well outlines and shadow boundaries that the viewer draws agree with those of displaced
 * geometry (displaced.h): the part of the two areas' union that they share.
 */
#pragma once

#include "displaced.h"
#include "exr/exr.h"
#include "scene/viewer.h"

#include <math.h>

#define TORUS_RADIUS      1.0
#define TORUS_TUBE        0.4
#define TORUS_FLOOR       4.0 /* half its width in radii, as scene_make() has it */
#define TORUS_MESH_RADIUS (TORUS_RADIUS + TORUS_TUBE)

struct overlap {
    gint64 both, either;
};

struct scores {
    struct overlap outline; /* of the torus */
    struct overlap shadow;  /* on the floor, where both see the floor */
};

static inline double overlap_share(const struct overlap *o) {
    return o->either > 0 ? (double)o->both / (double)o->either : 1.0;
}

static inline void overlap_add(struct overlap *o, gboolean a, gboolean b) {
    o->both += a && b;
    o->either += a || b;
}

static inline struct displaced_camera camera_of(const struct viewer_settings *s, int width,
                                                int height) {
    return (struct displaced_camera){
        .azimuth_deg = s->camera_azimuth_deg,
        .elevation_deg = s->camera_elevation_deg,
        .distance = s->camera_distance * TORUS_MESH_RADIUS,
        .fov_deg = s->camera_fov_deg,
        .right = s->camera_pan[0] * TORUS_MESH_RADIUS,
        .up = s->camera_pan[1] * TORUS_MESH_RADIUS,
        .width = width,
        .height = height,
    };
}

static inline void light_of(const struct viewer_settings *s, double ret[3]) {
    double theta = s->light_theta_deg * G_PI / 180, phi = s->light_phi_deg * G_PI / 180;
    ret[0] = sin(theta) * cos(phi);
    ret[1] = sin(theta) * sin(phi);
    ret[2] = cos(theta);
}

static inline struct displaced_pixel *trace(Displaced *displaced, const struct viewer_settings *s,
                                            int width, int height) {
    struct displaced_pixel *pixels = g_new(struct displaced_pixel, (gsize)width * height);
    struct displaced_camera camera = camera_of(s, width, height);
    double light[3];
    light_of(s, light);
    displaced_trace(displaced, &camera, light, pixels);
    return pixels;
}

/* Distance along the ray through a pixel's middle to the plane that the floor lies in. */
static inline double floor_distance(const struct displaced_camera *c, int i, int j) {
    double half = tan(c->fov_deg * G_PI / 360) / MIN(c->width, c->height);
    double e = c->elevation_deg * G_PI / 180;
    double x = (2 * i + 1 - c->width) * half, y = (c->height - 2 * j - 1) * half;
    double eye_z = c->distance * sin(e) + c->up * cos(e);
    double down = (sin(e) - y * cos(e)) / sqrt(1 + x * x + y * y);
    return (eye_z + TORUS_TUBE) / down;
}

static inline void floor_point(const struct displaced_camera *c, int i, int j, double ret[3]) {
    double half = tan(c->fov_deg * G_PI / 360) / MIN(c->width, c->height);
    double e = c->elevation_deg * G_PI / 180, a = c->azimuth_deg * G_PI / 180;
    double x = (2 * i + 1 - c->width) * half, y = (c->height - 2 * j - 1) * half;
    double back[3] = {cos(e) * cos(a), cos(e) * sin(a), sin(e)}, right[3] = {-sin(a), cos(a), 0};
    double up[3] = {-sin(e) * cos(a), -sin(e) * sin(a), cos(e)};
    double along = floor_distance(c, i, j) / sqrt(1 + x * x + y * y);
    for (int k = 0; k < 3; k++)
        ret[k] = (c->distance - along) * back[k] + (c->right + along * x) * right[k] +
                 (c->up + along * y) * up[k];
}

/* What viewer_render_geometry(…, VIEWER_GEOMETRY_LIT, …) returned against what was traced. */
static inline struct scores score(const float *seen, const struct displaced_pixel *truth,
                                  const struct viewer_settings *s, int width, int height,
                                  gboolean floor) {
    struct scores scores = {0};
    struct displaced_camera camera = camera_of(s, width, height);
    for (int k = 0; k < width * height; k++) {
        const float *p = seen + 4 * (gsize)k;
        double distance = floor_distance(&camera, k % width, k / width);
        gboolean on_floor = floor && p[3] > 0.5 && fabs(p[2] - distance) < 2e-3 * distance;
        overlap_add(&scores.outline, p[3] > 0.5 && !on_floor, truth[k].part == DISPLACED_TORUS);
        if (on_floor && truth[k].part == DISPLACED_FLOOR)
            overlap_add(&scores.shadow, p[0] < 0.5, truth[k].shadowed);
    }
    return scores;
}
