#include "camera.h"

#include "base/direction.h"

#include <cglm/cglm.h>

#define MARGIN 0.92 /* share of the picture's width or height that a shape fills */

/* Unit vectors to the right, upwards, and back towards the eye. */
struct axes {
    vec3 right, up, back;
};

/* Finds the axes of the picture. Its vertical axis leans with the elevation, so it is never along
 * the line of sight. */
static void camera_find_axes(const struct viewer_settings *s, struct axes *ret) {
    direction_from_deg(90.0 - s->camera_elevation_deg, s->camera_azimuth_deg, ret->back);
    direction_from_deg(-s->camera_elevation_deg, s->camera_azimuth_deg, ret->up);
    glm_vec3_cross(ret->up, ret->back, ret->right);
}

static void half_angles(const struct viewer_settings *s, double aspect, double *ret_x,
                        double *ret_y) {
    double half = tan(0.5 * s->camera_fov_deg * G_PI / 180.0);
    *ret_x = aspect >= 1.0 ? half * aspect : half;
    *ret_y = aspect >= 1.0 ? half : half / aspect;
}

void camera_matrix(const struct viewer_settings *s, double radius, double reach, double aspect,
                   float ret_projection[16], float ret_eye[3]) {
    struct axes axes;
    mat4 look, lens, both;
    vec3 centre = {0.0f, 0.0f, 0.0f};
    double half_x, half_y, distance = s->camera_distance * radius;
    camera_find_axes(s, &axes);
    half_angles(s, aspect, &half_x, &half_y);
    glm_vec3_muladds(axes.right, s->camera_pan[0] * radius, centre);
    glm_vec3_muladds(axes.up, s->camera_pan[1] * radius, centre);
    glm_vec3_copy(centre, ret_eye);
    glm_vec3_muladds(axes.back, distance, ret_eye);
    glm_lookat(ret_eye, centre, axes.up, look);
    double near = MAX(distance - 1.05 * reach, 0.01 * radius);
    glm_perspective(2.0 * atan(half_y), aspect, near, distance + 1.05 * reach, lens);
    glm_mat4_mul(lens, look, both);
    memcpy(ret_projection, both, sizeof both);
}

/* With the camera at distance d and pan c, a point (x, z) is inside the picture if |x − c| ≤ k (d −
 * z). k is the tangent of half the field of view. The smallest d and its c follow from the maxima
 * of x + k z (high) and −x + k z (low): d = (high + low) / 2k, c = (high − low) / 2. */
struct extent {
    double high, low;
};

static void extend(struct extent *e, double x, double k, double z) {
    e->high = MAX(e->high, x + k * z);
    e->low = MAX(e->low, k * z - x);
}

/* Refines the pan so that the projected points are centred. Perspective shrinks distant parts.
 * Without this, the middle of the points would not be in the middle of the picture along the axis
 * that does not fill it. */
static double camera_centre(const float *points, guint n, const vec3 axis, const vec3 back,
                            double distance, double pan) {
    for (int round = 0; round < 4; round++) {
        double low = G_MAXDOUBLE, high = -G_MAXDOUBLE;
        for (guint i = 0; i < n; i++) {
            const float *p = points + 3 * (gsize)i;
            double z = p[0] * back[0] + p[1] * back[1] + p[2] * back[2];
            double x = p[0] * axis[0] + p[1] * axis[1] + p[2] * axis[2] - pan;
            double shown = x / MAX(distance - z, 1e-3 * distance);
            low = MIN(low, shown);
            high = MAX(high, shown);
        }
        pan += 0.5 * (low + high) * distance;
    }
    return pan;
}

void camera_fit(struct viewer_settings *s, const float *points, guint n, double radius,
                double aspect) {
    struct axes axes;
    struct extent across = {-G_MAXDOUBLE, -G_MAXDOUBLE}, along = across;
    double kx, ky;
    camera_find_axes(s, &axes);
    half_angles(s, aspect, &kx, &ky);
    kx *= MARGIN;
    ky *= MARGIN;
    for (guint i = 0; i < n; i++) {
        vec3 p = {points[3 * (gsize)i], points[3 * (gsize)i + 1], points[3 * (gsize)i + 2]};
        double z = glm_vec3_dot(p, axes.back);
        extend(&across, glm_vec3_dot(p, axes.right), kx, z);
        extend(&along, glm_vec3_dot(p, axes.up), ky, z);
    }
    double distance =
        MAX(0.5 * (across.high + across.low) / kx, 0.5 * (along.high + along.low) / ky);
    if (n == 0)
        return;
    s->camera_distance = CLAMP(distance / radius, 0.01, 1000.0);
    double pan_x =
        camera_centre(points, n, axes.right, axes.back, distance, 0.5 * (across.high - across.low));
    double pan_y =
        camera_centre(points, n, axes.up, axes.back, distance, 0.5 * (along.high - along.low));
    s->camera_pan[0] = pan_x / radius;
    s->camera_pan[1] = pan_y / radius;
}
