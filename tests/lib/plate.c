#include "plate.h"

#include <math.h>

#define DEG (G_PI / 180.0)

double plate_depth(double x, double dx) {
    for (int tile = -2; tile <= 2; tile++) {
        const double left = PLATE_LEFT + tile * PLATE_TILE, right = PLATE_RIGHT + tile * PLATE_TILE;
        const double at_top = x + dx * PLATE_TOP, at_bottom = x + dx * PLATE_BOTTOM;
        if (at_top > left && at_top < right)
            return PLATE_TOP;
        if (dx > 0.0 && at_top <= left && at_bottom > left)
            return (left - x) / dx;
        if (dx < 0.0 && at_top >= right && at_bottom < right)
            return (right - x) / dx;
    }
    return PLATE_FLOOR;
}

double plate_slant(double theta_deg, double phi_deg) {
    return -tan(theta_deg * DEG) * cos(phi_deg * DEG);
}

struct mdf_table *plate_table(void) {
    enum { RINGS = 5, ROUND = 12, VIEWS = RINGS * ROUND };
    float theta[VIEWS], phi[VIEWS];
    for (int k = 0; k < VIEWS; k++) {
        theta[k] = 15.0F * (float)(1 + k / ROUND);
        phi[k] = 30.0F * (float)(k % ROUND);
    }
    struct mdf_table *t =
        mdf_table_new(PLATE_TEXELS, PLATE_TEXELS, VIEWS, PLATE_TILE / PLATE_TEXELS, theta, phi);
    t->deepest_mm = PLATE_FLOOR;
    for (int k = 0; k < VIEWS * PLATE_TEXELS * PLATE_TEXELS; k++) {
        const int view = k / (PLATE_TEXELS * PLATE_TEXELS);
        const double x = (k % PLATE_TEXELS + 0.5) * PLATE_TILE / PLATE_TEXELS;
        const double dx = plate_slant((double)theta[view], (double)phi[view]);
        t->depth_mm[k] = (float)plate_depth(x, dx);
    }
    return t;
}
