/*
 * Pictures like those that the capture software of another laboratory would write, computed by
 * formulas. They show a printed plane with plates, spheres and tubes on it. All surfaces are matt.
 * The light is one point-like lamp or a line laser, and the camera is a pinhole whose lens has
 * distortion. Nothing here calls sim/, calib/ or processing/. Errors in these functions fail the
 * test.
 */
#pragma once

#include "analytic.h"

/* Returns the reflectance of colour c (0 … 2) at a point of a print. */
typedef double (*ForeignPrint)(double x_mm, double y_mm, int c);

struct foreign_sphere { /* sample frame */
    double centre_mm[3], radius_mm;
    double reflectance[3];
};

struct foreign_tube {                                  /* a closed cylinder, sample frame */
    double from_mm[3], along[3], length_mm, radius_mm; /* along: unit */
    double reflectance[3];
};

/* A rectangle in space, in the sample frame: its middle, and unit vectors along its sides. */
struct foreign_plate {
    double middle_mm[3], right[3], up[3], half_mm[2];
    ForeignPrint print; /* its arguments are mm along right and up */
};

struct foreign_scene {
    double plane_mm;    /* height of the print above the turntable */
    ForeignPrint print; /* its arguments are x and y in the sample frame; it is infinitely large */
    const struct foreign_sphere *spheres;
    int n_spheres;
    const struct foreign_tube *tubes;
    int n_tubes;
    const struct foreign_plate *plates;
    int n_plates;
};

struct foreign_shot {
    const struct pinhole *camera; /* its response is 6000 DN/s per W/(sr m²) */
    const struct arc_lamp *lamp;
    double arc, turntable; /* radians */
    double exposure_ms;
    int samples; /* samples of a pixel in each direction */
    /* pixels that show the print farther than this from the axis have one sample; 0 means no
     * limit */
    double fine_mm;
};

/* Returns the radiance towards the camera, relative to white (4095 DN): 3 × height × width, the
 * planes of R, G and B. The value of a pixel is the mean over its area; g_free(). */
float *foreign_render(const struct foreign_scene *scene, const struct foreign_shot *shot);

/* The sweep of a line laser. In frame k the sheet is at from_rad + k · step_rad. The profile of the
 * sheet is a Gaussian. The laser is at the place given by laser, rotated by arc. */
struct foreign_sweep {
    const struct pinhole *camera;
    const struct line_laser *laser;
    double arc, turntable; /* radians */
    double from_rad, step_rad;
    int steps;
    /* standard deviation of the sheet's profile, as an angle seen from the laser */
    double sigma_rad;
    double peak; /* value of a white surface that faces the laser, relative to white */
    int samples;
    double fine_mm;
};

/* Returns grey pictures, with colour 1 of the prints: steps × height × width; g_free(). */
float *foreign_render_sweep(const struct foreign_scene *scene, const struct foreign_sweep *sweep);

/* Returns whether a point of the print is lit by the lamp and visible to the camera. */
gboolean foreign_clear(const struct foreign_scene *scene, const struct foreign_shot *shot,
                       double x_mm, double y_mm);

/* Finds where the line of sight through a point of the sample frame first meets the scene. *ret_mm
 * is the distance of the scene behind point_mm along this line; it is negative if the line meets
 * the scene in front of point_mm. Returns FALSE if the line meets nothing. */
gboolean foreign_distance_mm(const struct foreign_scene *scene, const struct pinhole *camera,
                             double turntable, const double point_mm[3], double *ret_mm);

/* Computes the radiance along the line of sight through a point of the sample frame, in
 * W·sr⁻¹·m⁻². */
void foreign_seen(const struct foreign_scene *scene, const struct foreign_shot *shot,
                  const double point_mm[3], double ret[3]);

/* Adds photon noise and read noise to n values relative to white. White is full_well_e
 * electrons. */
struct foreign_sensor {
    double full_well_e, read_noise_e;
    guint64 state; /* state of the random numbers; not 0 */
};
void foreign_expose(struct foreign_sensor *sensor, float *values, gsize n);

/* Writes a PNG of 8 or 16 bits. codes is height × width × channels (1 or 3). */
void foreign_write_png(const char *path, const guint16 *codes, int width, int height, int channels,
                       int bits);
