#include "plate.h"

#include "mdf_file.h"
#include "ok.h"

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

struct mdf_table *plate_table(int rings) {
    enum { ROUND = 12 };
    const int n_views = rings * ROUND;
    g_autofree float *theta = g_new(float, n_views), *phi = g_new(float, n_views);
    for (int k = 0; k < n_views; k++) {
        theta[k] = 15.0F * (float)(1 + k / ROUND);
        phi[k] = 30.0F * (float)(k % ROUND);
    }
    struct mdf_table *t =
        mdf_table_new(PLATE_TEXELS, PLATE_ROWS, n_views, PLATE_TILE / PLATE_TEXELS, theta, phi);
    t->deepest_mm = PLATE_FLOOR;
    for (int k = 0; k < n_views * PLATE_ROWS * PLATE_TEXELS; k++) {
        const int view = k / (PLATE_ROWS * PLATE_TEXELS);
        const double x = (k % PLATE_TEXELS + 0.5) * PLATE_TILE / PLATE_TEXELS;
        const double dx = plate_slant((double)theta[view], (double)phi[view]);
        t->depth_mm[k] = (float)plate_depth(x, dx);
    }
    return t;
}

void plate_write(const char *path, int rings) {
    g_autoptr(MdfTable) table = plate_table(rings);
    g_autoptr(ExrFile) file = exr_file_new();
    const int n = table->width * table->height;
    for (int k = 0; k < table->n_views; k++) {
        const double theta_deg = (double)table->theta_deg[k];
        struct exr_part *part = mdf_file_add_view(file, k, table->width, table->height, theta_deg,
                                                  (double)table->phi_deg[k], table->texel_mm);
        for (int i = 0; i < n; i++)
            part->planes[0][i] = (float)((double)table->depth_mm[k * n + i] / cos(theta_deg * DEG));
    }
    ok(exr_write(path, file, EXR_ZIP, FALSE, ERR));
}
