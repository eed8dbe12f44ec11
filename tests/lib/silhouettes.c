#include "silhouettes.h"

double overlap_share(const struct overlap *o) {
    return o->either > 0 ? (double)o->both / (double)o->either : 1.0;
}

void overlap_add(struct overlap *o, gboolean a, gboolean b) {
    o->both += a && b;
    o->either += a || b;
}

const struct silhouettes_shape silhouettes_torus = {"torus", 1.0, 0.4, 0, 1.4, 0.4};
const struct silhouettes_shape silhouettes_cylinder = {"cylinder", 0.6, 0, 1.6, 1.0, 0.8};

struct displaced_shape silhouettes_displaced(const struct silhouettes_shape *shape, int tiles_u,
                                             int tiles_v, gboolean floor, double tile_mm,
                                             double reference_mm) {
    return (struct displaced_shape){.radius = shape->radius,
                                    .tube_radius = shape->tube_radius,
                                    .height = shape->height,
                                    .tiles_u = tiles_u,
                                    .tiles_v = tiles_v,
                                    .floor = floor ? SILHOUETTES_FLOOR * shape->mesh_radius : 0,
                                    .tile_mm = tile_mm,
                                    .reference_mm = reference_mm};
}

struct displaced_camera silhouettes_camera(const struct silhouettes_shape *shape,
                                           const struct viewer_settings *s, int width, int height) {
    return (struct displaced_camera){
        .azimuth_deg = s->camera_azimuth_deg,
        .elevation_deg = s->camera_elevation_deg,
        .distance = s->camera_distance * shape->mesh_radius,
        .fov_deg = s->camera_fov_deg,
        .right = s->camera_pan[0] * shape->mesh_radius,
        .up = s->camera_pan[1] * shape->mesh_radius,
        .floor = shape->floor,
        .width = width,
        .height = height,
    };
}

struct displaced_pixel *silhouettes_trace(const struct silhouettes_shape *shape,
                                          Displaced *displaced, const struct viewer_settings *s,
                                          int width, int height) {
    struct displaced_pixel *pixels = g_new(struct displaced_pixel, (gsize)width * height);
    struct displaced_camera camera = silhouettes_camera(shape, s, width, height);
    double theta = s->light_theta_deg * G_PI / 180, phi = s->light_phi_deg * G_PI / 180;
    const double light[3] = {sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)};
    displaced_trace(displaced, &camera, light, pixels);
    return pixels;
}

double silhouettes_floor_distance(const struct displaced_camera *c, int i, int j) {
    double half = tan(c->fov_deg * G_PI / 360) / MIN(c->width, c->height);
    double e = c->elevation_deg * G_PI / 180;
    double x = (2 * i + 1 - c->width) * half, y = (c->height - 2 * j - 1) * half;
    double eye_z = c->distance * sin(e) + c->up * cos(e);
    double down = (sin(e) - y * cos(e)) / sqrt(1 + x * x + y * y);
    return (eye_z + c->floor) / down;
}

void silhouettes_floor_point(const struct displaced_camera *c, int i, int j, double ret[3]) {
    double half = tan(c->fov_deg * G_PI / 360) / MIN(c->width, c->height);
    double e = c->elevation_deg * G_PI / 180, a = c->azimuth_deg * G_PI / 180;
    double x = (2 * i + 1 - c->width) * half, y = (c->height - 2 * j - 1) * half;
    double back[3] = {cos(e) * cos(a), cos(e) * sin(a), sin(e)}, right[3] = {-sin(a), cos(a), 0};
    double up[3] = {-sin(e) * cos(a), -sin(e) * sin(a), cos(e)};
    double along = silhouettes_floor_distance(c, i, j) / sqrt(1 + x * x + y * y);
    for (int k = 0; k < 3; k++)
        ret[k] = (c->distance - along) * back[k] + (c->right + along * x) * right[k] +
                 (c->up + along * y) * up[k];
}

struct scores silhouettes_score(const struct silhouettes_shape *shape, const float *seen,
                                const struct displaced_pixel *truth,
                                const struct viewer_settings *s, int width, int height,
                                gboolean floor) {
    struct scores scores = {0};
    struct displaced_camera camera = silhouettes_camera(shape, s, width, height);
    for (int k = 0; k < width * height; k++) {
        const float *p = seen + 4 * (gsize)k;
        double distance = silhouettes_floor_distance(&camera, k % width, k / width);
        gboolean on_floor = floor && p[3] > 0.5 && fabs(p[2] - distance) < 2e-3 * distance;
        overlap_add(&scores.outline, p[3] > 0.5 && !on_floor, truth[k].part == DISPLACED_SHAPE);
        if (on_floor && truth[k].part == DISPLACED_FLOOR)
            overlap_add(&scores.shadow, p[0] < 0.5, truth[k].shadowed);
    }
    return scores;
}
