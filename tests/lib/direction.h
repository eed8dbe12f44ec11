/* Directions by their angles, in doubles. */
#pragma once

#include "base/vec.h"

#include <glib.h>

/* Returns the unit vector with the polar angle θ (from +z) and the azimuth φ (from +x). */
static inline struct vec3 direction_of_deg(double theta_deg, double phi_deg) {
    const double theta = theta_deg * G_PI / 180, phi = phi_deg * G_PI / 180;
    return vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
}
