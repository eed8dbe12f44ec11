#include "optics.h"

#include <string.h>

struct v3 optics_spin(struct v3 a, struct v3 axis, double angle) {
    double c = cos(angle), s = sin(angle);
    struct v3 r = v3_mad(v3_cross(axis, a), s, v3_mad(a, c, v3(0, 0, 0)));
    return v3_mad(axis, v3_dot(axis, a) * (1 - c), r);
}

void optics_camera_place(struct optics_camera *camera, double theta, double phi,
                         double distance_mm) {
    struct v3 out = v3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
    camera->centre_mm = v3_mad(out, distance_mm, v3(0, 0, 0));
    camera->forward = v3(-out.x, -out.y, -out.z);
    camera->right = v3(-sin(phi), cos(phi), 0);
    camera->down = v3_cross(camera->forward, camera->right);
}

void optics_camera_turn(struct optics_camera *camera, double rx, double ry, double rz) {
    struct v3 axis[3] = {camera->right, camera->down, camera->forward};
    double angle[3] = {rx, ry, rz};
    for (int i = 0; i < 3; i++) {
        camera->right = optics_spin(camera->right, axis[i], angle[i]);
        camera->down = optics_spin(camera->down, axis[i], angle[i]);
        camera->forward = optics_spin(camera->forward, axis[i], angle[i]);
    }
}

/* Computes the ideal point of a distorted point (xd, yd). The two equations of the distortion are
 * solved by Newton's method, beginning at the distorted point. This takes two or three steps if the
 * lens does not fold the picture. */
static void undistort(const struct optics_camera *camera, double xd, double yd, double *ret_x,
                      double *ret_y) {
    double x = xd, y = yd, p1 = camera->p1, p2 = camera->p2;
    for (int i = 0; i < 20; i++) {
        double r2 = x * x + y * y, scale = 1 + r2 * (camera->k1 + r2 * camera->k2);
        double slope = 2 * camera->k1 + 4 * camera->k2 * r2;
        double fx = x * scale + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - xd;
        double fy = y * scale + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - yd;
        double a = scale + slope * x * x + 2 * p1 * y + 6 * p2 * x;
        double b = slope * x * y + 2 * p1 * x + 2 * p2 * y;
        double d = scale + slope * y * y + 6 * p1 * y + 2 * p2 * x;
        double det = a * d - b * b;
        x -= (d * fx - b * fy) / det;
        y -= (a * fy - b * fx) / det;
        if (fabs(fx) + fabs(fy) < 1e-15)
            break;
    }
    *ret_x = x;
    *ret_y = y;
}

double optics_magnification(const struct optics_camera *camera, const double weights[3]) {
    const double sum = weights[0] + weights[1] + weights[2];
    return sum > 0 ? 1 + camera->lateral_colour * (weights[0] - weights[2]) / sum : 1;
}

struct v3 optics_ray(const struct optics_camera *camera, double x_px, double y_px) {
    double x = (x_px - camera->centre_x_px) / camera->focal_px;
    double y = (y_px - camera->centre_y_px) / camera->focal_px;
    undistort(camera, x, y, &x, &y);
    return v3_norm(v3_mad(camera->right, x, v3_mad(camera->down, y, camera->forward)));
}

double optics_response(const struct optics_camera *camera, double x_px, double y_px,
                       enum cfa_colour colour) {
    double dx = x_px - camera->centre_x_px, dy = y_px - camera->centre_y_px;
    double corner2 =
        camera->centre_x_px * camera->centre_x_px + camera->centre_y_px * camera->centre_y_px;
    double r2 = dx * dx + dy * dy;
    double value = camera->response * camera->colour[colour];
    if (corner2 > 0)
        value *= MAX(0, 1 - camera->vignetting * r2 / corner2);
    if (camera->falloff > 0)
        value *= pow(1 + r2 / (camera->focal_px * camera->focal_px), -camera->falloff / 2);
    return value;
}

void optics_arc_lean(struct optics_arc *arc, double towards_x, double towards_y) {
    double angle = hypot(towards_x, towards_y);
    arc->x = v3(1, 0, 0);
    arc->y = v3(0, 1, 0);
    arc->z = v3(0, 0, 1);
    if (angle == 0)
        return;
    struct v3 about = v3(-towards_y / angle, towards_x / angle, 0);
    arc->x = optics_spin(arc->x, about, angle);
    arc->y = optics_spin(arc->y, about, angle);
    arc->z = optics_spin(arc->z, about, angle);
}

struct v3 optics_arc_direction(const struct optics_arc *arc, double angle, struct v3 v) {
    struct v3 t = v3_turn_z(v, cos(angle + arc->zero), sin(angle + arc->zero));
    return v3_mad(arc->x, t.x, v3_mad(arc->y, t.y, v3_mad(arc->z, t.z, v3(0, 0, 0))));
}

struct v3 optics_arc_point(const struct optics_arc *arc, double angle, struct v3 p) {
    return v3_mad(arc->centre_mm, 1, optics_arc_direction(arc, angle, p));
}

struct v3 optics_swing_direction(const struct optics_swing *swing, double angle, struct v3 v) {
    return optics_spin(v, swing->axis, angle + swing->zero);
}

struct v3 optics_swing_point(const struct optics_swing *swing, double angle, struct v3 p) {
    struct v3 turned = optics_swing_direction(swing, angle, v3_minus(p, swing->centre_mm));
    return v3_mad(turned, 1, swing->centre_mm);
}

double optics_lamp_irradiance(const struct optics_lamp *lamp, struct v3 point_mm) {
    struct v3 way = v3_minus(point_mm, lamp->position_mm);
    double r2 = v3_dot(way, way), cosine = v3_dot(way, lamp->aim) / sqrt(r2);
    if (!(cosine > 0))
        return 0;
    double shape = lamp->exponent == 2 ? cosine * cosine : pow(cosine, lamp->exponent);
    return lamp->intensity * shape / (r2 * 1e-6);
}

double optics_laser_angle(const struct optics_laser *laser, struct v3 point_mm) {
    struct v3 way = v3_minus(point_mm, laser->position_mm);
    double ahead = v3_dot(way, laser->forward);
    double aside = v3_dot(way, v3_cross(laser->axis, laser->forward));
    double tangent2 = v3_dot(way, laser->axis) * v3_dot(way, laser->axis) /
                      MAX(ahead * ahead + aside * aside, 1e-12);
    return atan2(aside, ahead) + laser->start - laser->bend * tangent2;
}

double optics_laser_peak(const struct optics_laser *laser, struct v3 point_mm) {
    struct v3 way = v3_minus(point_mm, laser->position_mm);
    double along = v3_dot(way, laser->axis);
    double r2 = v3_dot(way, way), across = sqrt(MAX(r2 - along * along, 1e-12));
    if (fabs(atan2(along, across)) > laser->fan / 2)
        return 0;
    double line = laser->power_w / (laser->fan * sqrt(r2) * 1e-3); /* W per metre of width */
    return line / (sqrt(2 * G_PI) * laser->sigma * across * 1e-3);
}
