/*
 * Helpers for tests that draw pictures of mirror balls by a formula. They share no code with
 * calib/.
 */
#pragma once

#include "world_fixture.h"

#include <glib.h>
#include <math.h>

#define DEG (180 / G_PI)

struct xyz {
    double x, y, z;
};

static inline struct xyz plus(struct xyz a, struct xyz b, double s) {
    return (struct xyz){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
}

static inline double dot(struct xyz a, struct xyz b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct xyz unit(struct xyz v) {
    const double n = sqrt(dot(v, v));
    return (struct xyz){v.x / n, v.y / n, v.z / n};
}

static inline double apart_rad(struct xyz a, struct xyz b) {
    return acos(CLAMP(dot(unit(a), unit(b)), -1, 1));
}

static inline struct xyz polar(double theta_deg, double phi_deg) {
    const double t = theta_deg / DEG, p = phi_deg / DEG;
    return (struct xyz){sin(t) * cos(p), sin(t) * sin(p), cos(t)};
}

/* Returns the sRGB value of linear light; both are 0 … 1. */
static inline double ball_scene_srgb(double light) {
    return light <= 0.0031308 ? 12.92 * light : 1.055 * pow(light, 1 / 2.4) - 0.055;
}

/* Makes the folder "photos" of world_fixture_folder(), or empties it. */
void ball_scene_clear(void);

/* Writes a grey PNG into that folder. */
void ball_scene_write(const char *name, const guint8 *pixels, int width, int height);
