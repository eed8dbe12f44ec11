#include "analytic.h"

double analytic_dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

void analytic_turn(const double *a, double angle, double *ret) {
    double c = cos(angle), s = sin(angle), x = a[0], y = a[1];
    ret[0] = c * x - s * y, ret[1] = s * x + c * y, ret[2] = a[2];
}

static void pinhole_axes(const struct pinhole *p, double *right, double *down, double *forward) {
    double s = sin(p->theta), c = cos(p->theta);
    right[0] = 0, right[1] = 1, right[2] = 0;
    down[0] = c, down[1] = 0, down[2] = -s;
    forward[0] = -s, forward[1] = 0, forward[2] = -c;
    analytic_turn(right, p->azimuth, right);
    analytic_turn(down, p->azimuth, down);
    analytic_turn(forward, p->azimuth, forward);
}

void pinhole_eye(const struct pinhole *p, double *eye) {
    eye[0] = p->distance_mm * sin(p->theta), eye[1] = 0, eye[2] = p->distance_mm * cos(p->theta);
    analytic_turn(eye, p->azimuth, eye);
}

void pinhole_project(const struct pinhole *p, const double *point, double *ret_x, double *ret_y) {
    double right[3], down[3], forward[3], eye[3];
    pinhole_axes(p, right, down, forward);
    pinhole_eye(p, eye);
    double way[3] = {point[0] - eye[0], point[1] - eye[1], point[2] - eye[2]};
    double depth = analytic_dot(way, forward);
    const double u = analytic_dot(way, right) / depth, v = analytic_dot(way, down) / depth;
    const double factor = p->focal_px * (1 + p->k1 * (u * u + v * v));
    *ret_x = 0.5 * (p->width - 1) + p->off_px[0] + factor * u;
    *ret_y = 0.5 * (p->height - 1) + p->off_px[1] + factor * v;
}

void pinhole_ray(const struct pinhole *p, double x, double y, double *ret) {
    double right[3], down[3], forward[3];
    pinhole_axes(p, right, down, forward);
    const double shown_u = (x - 0.5 * (p->width - 1) - p->off_px[0]) / p->focal_px;
    const double shown_v = (y - 0.5 * (p->height - 1) - p->off_px[1]) / p->focal_px;
    double u = shown_u, v = shown_v;
    /* each step reduces the error by the factor k1 r² */
    for (int i = 0; p->k1 != 0 && i < 6; i++) {
        const double factor = 1 + p->k1 * (u * u + v * v);
        u = shown_u / factor, v = shown_v / factor;
    }
    const double length = sqrt(1 + u * u + v * v);
    for (int i = 0; i < 3; i++)
        ret[i] = (u * right[i] + v * down[i] + forward[i]) / length;
}

struct rig_camera pinhole_to_rig(const struct pinhole *p, const char *name) {
    struct rig_camera camera = {.width = p->width,
                                .height = p->height,
                                .fx_px = p->focal_px,
                                .fy_px = p->focal_px,
                                .cx_px = 0.5 * (p->width - 1) + p->off_px[0],
                                .cy_px = 0.5 * (p->height - 1) + p->off_px[1],
                                .k1 = p->k1,
                                .response = 6000};
    double rows[3][3];
    g_strlcpy(camera.name, name, sizeof camera.name);
    pinhole_axes(p, rows[0], rows[1], rows[2]);
    memcpy(camera.rotation.m, rows, sizeof rows);
    camera.translation_mm = vec3(0, 0, p->distance_mm);
    return camera;
}

void line_laser_position(const struct line_laser *laser, double arc, double *ret) {
    double start[3] = {laser->distance_mm * sin(laser->theta), 0,
                       laser->distance_mm * cos(laser->theta)};
    analytic_turn(start, arc, ret);
}

double line_laser_sweep(const struct line_laser *laser, double arc, const double *point) {
    double p[3], s = sin(laser->theta), c = cos(laser->theta);
    analytic_turn(point, -arc, p);
    double along = (laser->distance_mm * s - p[0]) * s + (laser->distance_mm * c - p[2]) * c;
    double across = p[2] * s - p[0] * c;
    return atan2(across, along);
}

struct rig_laser line_laser_to_rig(const struct line_laser *laser, const char *name) {
    double s = sin(laser->theta), c = cos(laser->theta);
    struct rig_laser rig = {.position_mm = vec3(laser->distance_mm * s, 0, laser->distance_mm * c),
                            .axis = vec3(0, 1, 0),
                            .normal = vec3(-c, 0, s)};
    g_strlcpy(rig.name, name, sizeof rig.name);
    return rig;
}

struct rig_lamp arc_lamp_to_rig(const struct arc_lamp *lamp, const char *name) {
    double s = sin(lamp->theta), c = cos(lamp->theta);
    struct rig_lamp rig = {.position_mm = vec3(lamp->distance_mm * s, 0, lamp->distance_mm * c),
                           .aim = vec3(-s, 0, -c),
                           .exponent = lamp->exponent,
                           .intensity = lamp->intensity};
    g_strlcpy(rig.name, name, sizeof rig.name);
    return rig;
}
