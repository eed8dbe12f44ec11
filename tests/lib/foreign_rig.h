/*
 * Pictures as the capture software of somebody else's rig would write them, by formulas: a printed
 * plane with spheres on it, matt, under one lamp without a size, seen by a pinhole. Nothing here
 * calls sim/, calib/ or processing/. What goes wrong in here fails the test.
 */
#pragma once

#include "analytic.h"

struct foreign_sphere { /* sample frame */
    double centre_mm[3], radius_mm;
    double reflectance[3];
};

struct foreign_scene {
    double plane_mm; /* height of the print above the turntable */
    /* Reflectance of colour c (0 … 2) at a point of the print, sample frame. */
    double (*print)(double x_mm, double y_mm, int c);
    const struct foreign_sphere *spheres;
    int n_spheres;
};

struct foreign_shot {
    const struct pinhole *camera; /* its picture is that of a camera of 6000 DN/s per W/(sr m²) */
    const struct arc_lamp *lamp;
    double arc, turntable; /* radians */
    double exposure_ms;
    int samples; /* of a pixel, each way */
};

/* Radiance in the direction of the camera, as a share of white (4095 DN): 3 × height × width, the
 * planes of R, G and B, each pixel the mean over its area; g_free(). */
float *foreign_render(const struct foreign_scene *scene, const struct foreign_shot *shot);

/* Whether a point of the print is lit, and seen by the camera. */
gboolean foreign_clear(const struct foreign_scene *scene, const struct foreign_shot *shot,
                       double x_mm, double y_mm);

/* A PNG of 8 or 16 bits: height × width × channels (1 or 3) codes. */
void foreign_write_png(const char *path, const guint16 *codes, int width, int height, int channels,
                       int bits);
