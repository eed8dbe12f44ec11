#include "camera.h"

#include "base/direction.h"
#include "base/vec.h"

#include <glib.h>

#define MARGIN 0.92 /* share of the picture's width or height that a shape fills */

/* Unit vectors to the right, upwards, and back towards the eye. */
struct axes {
    struct vec3 right, up, back;
};

static struct vec3 direction(double theta_deg, double phi_deg) {
    float to[3];
    direction_from_deg(theta_deg, phi_deg, to);
    return vec3((double)to[0], (double)to[1], (double)to[2]);
}

/* Returns the axes of the picture. The vertical axis is perpendicular to the line of sight, even if
 * the camera looks straight down. */
static struct axes camera_axes(const struct viewer_settings *s) {
    struct axes axes;
    axes.back = direction(90.0 - s->camera_elevation_deg, s->camera_azimuth_deg);
    axes.up = direction(-s->camera_elevation_deg, s->camera_azimuth_deg);
    axes.right = vec3_cross(axes.up, axes.back);
    return axes;
}

static void half_angles(const struct viewer_settings *s, double aspect, double *ret_x,
                        double *ret_y) {
    double half = tan(0.5 * s->camera_fov_deg * G_PI / 180.0);
    *ret_x = aspect >= 1.0 ? half * aspect : half;
    *ret_y = aspect >= 1.0 ? half : half / aspect;
}

void camera_matrix(const struct viewer_settings *s, double radius, double reach, double aspect,
                   float ret_projection[16], float ret_eye[3]) {
    const struct axes axes = camera_axes(s);
    double half_x, half_y;
    half_angles(s, aspect, &half_x, &half_y);
    const double distance = s->camera_distance * radius, far = distance + 1.05 * reach;
    const double near = MAX(distance - 1.05 * reach, 0.01 * radius), depth = 1.0 / (near - far);
    const struct vec3 centre = vec3_add(vec3_scale(axes.right, s->camera_pan[0] * radius),
                                        vec3_scale(axes.up, s->camera_pan[1] * radius));
    const struct vec3 eye = vec3_add(centre, vec3_scale(axes.back, distance));
    /* The first three values of each row of the matrix. The fourth value is −row · eye. In the
     * third row, a constant is added to the fourth value. */
    const struct vec3 rows[4] = {
        vec3_scale(axes.right, 1.0 / half_x), vec3_scale(axes.up, 1.0 / half_y),
        vec3_scale(axes.back, (near + far) * depth), vec3_scale(axes.back, -1.0)};
    for (int k = 0; k < 4; k++) { /* column by column */
        ret_projection[k] = (float)rows[k].x;
        ret_projection[4 + k] = (float)rows[k].y;
        ret_projection[8 + k] = (float)rows[k].z;
        ret_projection[12 + k] =
            (float)((k == 2 ? 2.0 * near * far * depth : 0.0) - vec3_dot(rows[k], eye));
    }
    ret_eye[0] = (float)eye.x;
    ret_eye[1] = (float)eye.y;
    ret_eye[2] = (float)eye.z;
}

/* The bounds of the points along one axis of the picture, as camera_fit() needs them. `high` is the
 * maximum of x + k z over all points, and `low` is the maximum of −x + k z. x is the coordinate of
 * a point along the axis, z its coordinate towards the camera, and k the tangent of half the field
 * of view.
 *
 * A point is inside the picture if |x − c| ≤ k (d − z). Here d is the distance of the camera, and c
 * its pan. The smallest distance is therefore d = (high + low) / 2k, with c = (high − low) / 2. */
struct extent {
    double high, low;
};

static void extend(struct extent *e, double x, double k, double z) {
    e->high = MAX(e->high, x + k * z);
    e->low = MAX(e->low, k * z - x);
}

static struct vec3 point(const float *points, guint i) {
    const float *p = points + 3 * (gsize)i;
    return vec3((double)p[0], (double)p[1], (double)p[2]);
}

/* Returns the pan along one axis of the picture at which the points, in perspective, extend equally
 * far to both sides of the middle. The iteration begins at `pan`. The pan from struct extent
 * centres the points only along the axis in which they fill the picture. */
static double camera_centre(const float *points, guint n, struct vec3 axis, struct vec3 back,
                            double distance, double pan) {
    for (int round = 0; round < 4; round++) {
        double low = G_MAXDOUBLE, high = -G_MAXDOUBLE;
        for (guint i = 0; i < n; i++) {
            const struct vec3 p = point(points, i);
            const double x = vec3_dot(p, axis) - pan, z = vec3_dot(p, back);
            const double shown = x / MAX(distance - z, 1e-3 * distance);
            low = MIN(low, shown);
            high = MAX(high, shown);
        }
        pan += 0.5 * (low + high) * distance;
    }
    return pan;
}

void camera_fit(struct viewer_settings *s, const float *points, guint n, double radius,
                double aspect) {
    const struct axes axes = camera_axes(s);
    struct extent across = {-G_MAXDOUBLE, -G_MAXDOUBLE}, along = across;
    double kx, ky;
    half_angles(s, aspect, &kx, &ky);
    kx *= MARGIN;
    ky *= MARGIN;
    for (guint i = 0; i < n; i++) {
        const struct vec3 p = point(points, i);
        const double z = vec3_dot(p, axes.back);
        extend(&across, vec3_dot(p, axes.right), kx, z);
        extend(&along, vec3_dot(p, axes.up), ky, z);
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
