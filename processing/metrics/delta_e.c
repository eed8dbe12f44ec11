#include "delta_e.h"

#include <glib.h>
#include <math.h>

static double lab_curve(double t) {
    return t > 216.0 / 24389 ? cbrt(t) : (24389.0 / 27 * t + 16) / 116;
}

void delta_e_lab(const float rgb[3], double ret[3]) {
    const double r = MAX(rgb[0], 0), g = MAX(rgb[1], 0), b = MAX(rgb[2], 0);
    const double x = lab_curve((0.4124564 * r + 0.3575761 * g + 0.1804375 * b) / 0.95047);
    const double y = lab_curve(0.2126729 * r + 0.7151522 * g + 0.0721750 * b);
    const double z = lab_curve((0.0193339 * r + 0.1191920 * g + 0.9503041 * b) / 1.08883);
    ret[0] = 116 * y - 16;
    ret[1] = 500 * (x - y);
    ret[2] = 200 * (y - z);
}

static double hue_deg(double a, double b) {
    const double hue = a == 0 && b == 0 ? 0 : atan2(b, a) * 180 / G_PI;
    return hue < 0 ? hue + 360 : hue;
}

static double sin_deg(double angle) {
    return sin(angle * G_PI / 180);
}

static double cos_deg(double angle) {
    return cos(angle * G_PI / 180);
}

/* Gives the difference h2 − h1 and the mean of two hues in degrees, along the shorter arc. A grey
 * colour has no hue: if one of the colours is grey, the difference is 0, and the mean is h1 +
 * h2. */
static void hues(double h1, double h2, gboolean grey, double *ret_difference, double *ret_mean) {
    double difference = grey ? 0 : h2 - h1, mean = grey ? h1 + h2 : (h1 + h2) / 2;
    if (!grey && fabs(h1 - h2) > 180) {
        difference += difference > 0 ? -360 : 360;
        mean += h1 + h2 < 360 ? 180 : -180;
    }
    *ret_difference = difference;
    *ret_mean = mean;
}

double delta_e_2000(const double lab1[3], const double lab2[3]) {
    const double chroma = (hypot(lab1[1], lab1[2]) + hypot(lab2[1], lab2[2])) / 2;
    const double g = 0.5 * (1 - sqrt(pow(chroma, 7) / (pow(chroma, 7) + pow(25, 7))));
    const double a1 = lab1[1] * (1 + g), a2 = lab2[1] * (1 + g);
    const double c1 = hypot(a1, lab1[2]), c2 = hypot(a2, lab2[2]), c = (c1 + c2) / 2;
    double dh, h;
    hues(hue_deg(a1, lab1[2]), hue_deg(a2, lab2[2]), c1 * c2 == 0, &dh, &h);
    const double dhue = 2 * sqrt(c1 * c2) * sin_deg(dh / 2), l = (lab1[0] + lab2[0]) / 2;
    const double t = 1 - 0.17 * cos_deg(h - 30) + 0.24 * cos_deg(2 * h) +
                     0.32 * cos_deg(3 * h + 6) - 0.20 * cos_deg(4 * h - 63);
    const double turn = 30 * exp(-pow((h - 275) / 25, 2));
    const double rc = 2 * sqrt(pow(c, 7) / (pow(c, 7) + pow(25, 7)));
    const double sl = 1 + 0.015 * (l - 50) * (l - 50) / sqrt(20 + (l - 50) * (l - 50));
    const double sc = 1 + 0.045 * c, sh = 1 + 0.015 * c * t;
    const double dl = (lab2[0] - lab1[0]) / sl, dc = (c2 - c1) / sc, dhs = dhue / sh;
    return sqrt(MAX(dl * dl + dc * dc + dhs * dhs - sin_deg(2 * turn) * rc * dc * dhs, 0));
}
