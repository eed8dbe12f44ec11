/*
 * Pictures as the capture software of somebody else's rig would write them, by formulas: a printed
 * plane with plates, spheres and tubes on it, matt, under one lamp without a size or under a line
 * laser, seen by a pinhole with a distorting lens. Nothing here calls sim/, calib/ or processing/.
 * What goes wrong in here fails the test.
 */
#pragma once

#include "analytic.h"

/* Reflectance of colour c (0 … 2) at a point of a print. */
typedef double (*ForeignPrint)(double x_mm, double y_mm, int c);

struct foreign_sphere { /* sample frame */
    double centre_mm[3], radius_mm;
    double reflectance[3];
};

struct foreign_tube {                                  /* a closed cylinder, sample frame */
    double from_mm[3], along[3], length_mm, radius_mm; /* along: unit */
    double reflectance[3];
};

/* A rectangle in space: its middle, and unit vectors along its sides, in the sample frame. */
struct foreign_plate {
    double middle_mm[3], right[3], up[3], half_mm[2];
    ForeignPrint print; /* by mm along right and up */
};

struct foreign_scene {
    double plane_mm;    /* height of the print above the turntable */
    ForeignPrint print; /* at a point of the sample frame; it has no end */
    const struct foreign_sphere *spheres;
    int n_spheres;
    const struct foreign_tube *tubes;
    int n_tubes;
    const struct foreign_plate *plates;
    int n_plates;
};

struct foreign_shot {
    const struct pinhole *camera; /* its picture is that of a camera of 6000 DN/s per W/(sr m²) */
    const struct arc_lamp *lamp;
    double arc, turntable; /* radians */
    double exposure_ms;
    int samples;    /* of a pixel, each way */
    double fine_mm; /* pixels that show the print further than this from the axis have one sample;
                       0: none */
};

/* Radiance in the direction of the camera, as a share of white (4095 DN): 3 × height × width, the
 * planes of R, G and B, each pixel the mean over its area; g_free(). */
float *foreign_render(const struct foreign_scene *scene, const struct foreign_shot *shot);

/* A line laser's sweep: in frame k the sheet is at from + k·step. Across it, light falls off as a
 * Gaussian. The laser stands where laser, turned by arc, says. */
struct foreign_sweep {
    const struct pinhole *camera;
    const struct line_laser *laser;
    double arc, turntable; /* radians */
    double from_rad, step_rad;
    int steps;
    double sigma_rad; /* of the sheet's thickness, seen from the laser */
    double peak;      /* share of white that a white surface shows that faces the laser */
    int samples;
    double fine_mm;
};

/* Grey, of colour 1 of prints: steps × height × width; g_free(). */
float *foreign_render_sweep(const struct foreign_scene *scene, const struct foreign_sweep *sweep);

/* Whether a point of the print is lit, and seen by the camera. */
gboolean foreign_clear(const struct foreign_scene *scene, const struct foreign_shot *shot,
                       double x_mm, double y_mm);

/* Where the line of sight to a point of the sample frame first meets the scene: the distance behind
 * that point (below 0: before it). FALSE: nowhere. */
gboolean foreign_distance_mm(const struct foreign_scene *scene, const struct pinhole *camera,
                             double turntable, const double point_mm[3], double *ret_mm);

/* The radiance that the line of sight to a point of the sample frame shows, in W·sr⁻¹·m⁻². */
void foreign_seen(const struct foreign_scene *scene, const struct foreign_shot *shot,
                  const double point_mm[3], double ret[3]);

/* Adds photon and read noise to n shares of white, which is full_well_e electrons. */
struct foreign_sensor {
    double full_well_e, read_noise_e;
    guint64 state; /* of the random numbers; not 0 */
};
void foreign_expose(struct foreign_sensor *sensor, float *values, gsize n);

/* A PNG of 8 or 16 bits: height × width × channels (1 or 3) codes. */
void foreign_write_png(const char *path, const guint16 *codes, int width, int height, int channels,
                       int bits);
