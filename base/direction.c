#include "direction.h"

#include <glib.h>
#include <math.h>

void direction_from_deg(double theta_deg, double phi_deg, float ret[3]) {
    const double theta = theta_deg * G_PI / 180, phi = phi_deg * G_PI / 180;
    ret[0] = (float)(sin(theta) * cos(phi));
    ret[1] = (float)(sin(theta) * sin(phi));
    ret[2] = (float)cos(theta);
}

float rgb_luminance(const float rgb[3]) {
    return 0.2126F * rgb[0] + 0.7152F * rgb[1] + 0.0722F * rgb[2];
}
