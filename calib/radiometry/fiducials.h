/*
 * Fiducials: white discs on the turntable (rig_fiducial). Their pictures give the output of the
 * lamp and their position. A fiducial must stand out: nothing equally bright may be nearer to its
 * edge than its radius.
 *
 * Pure functions over plain data: any thread.
 */
#pragma once

#include "radiometry.h"

struct fiducial_scene { /* the commanded state in which a picture was taken; pointers are borrowed
                         */
    const struct rig *rig;
    int camera, lamp;
    double turntable_rad, arc_rad;
    const struct radiometry_camera *radiometry;    /* radiometry of the camera; NULL: unknown */
    const struct radiometry_lamp *lamp_radiometry; /* radiometry of the lamp; NULL: unknown */
};

struct fiducial_seen {
    int camera, fiducial;
    double turntable_rad;
    double x_px, y_px; /* centroid of its area in the picture */
    double error_px;   /* standard error of each: noise, pixel response, uneven surround */
    double expected_x_px, expected_y_px;
    double output, output_error; /* of the lamp, relative to its calibration; the error is infinite
                                    if the fiducial has too few pixels */
};

/* Appends (struct fiducial_seen) the fiducials that are wholly in the picture and lit; returns
 * their number. mosaic: height × width, DN per ms above dark; cfa as in frames/rectify.h. The
 * camera's veiling glare is subtracted. Fiducials are found up to their radius away from their
 * expected position. */
int fiducials_measure(const struct fiducial_scene *scene, const char *cfa, const float *mosaic,
                      GArray *seen);

/* Mean output of n fiducials (of one shot, all cameras), weighted by their standard errors.
 * FALSE: there is none. */
gboolean fiducials_output(const struct fiducial_seen *seen, int n, double *ret_output,
                          double *ret_error);

/* Estimate of one fiducial from sightings at several turntable angles by several cameras. */
struct fiducial_fit {
    struct vec3 centre_mm;
    double centre_error_mm[3];
    double white, white_error; /* relative to the reflectance in the rig file */
    int n_seen;
};

/* Uses those of the n sightings that show the fiducial. Cameras and turntable are taken as correct;
 * set place to FALSE if they are not calibrated: the fiducial then keeps its position. FALSE: too
 * few sightings. */
gboolean fiducials_fit(const struct rig *rig, const struct fiducial_seen *seen, int n, int fiducial,
                       gboolean place, struct fiducial_fit *ret);

/* Checks the positions of fiducials against the calibration, and finds the best explanation of a
 * deviation: the zero of the turntable, or one or several cameras. */
struct fiducials_check {
    int n_seen;
    double rms_px; /* RMS of the displacements before any cause is fitted */
    gboolean slipped;
    double slip_deg, slip_error_deg; /* rotation of the turntable, counter-clockwise */
    struct {
        int n_seen;
        gboolean moved;
        double turn_deg, turn_error_deg; /* rotation of the camera about its own centre */
    } cameras[RIG_MAX_CAMERAS];
};

/* systematic_px: error of a good calibration; it is added to the standard errors. least_deg:
 * smaller angles are ignored. Angles are reported if they exceed both it and four standard
 * errors. */
void fiducials_check(const struct rig *rig, const struct fiducial_seen *seen, int n,
                     double systematic_px, double least_deg, struct fiducials_check *ret);

/* Text such as "camera cam30 is turned by 0.10° ± 0.01°"; NULL if nothing has moved; g_free(). */
char *fiducials_describe(const struct rig *rig, const struct fiducials_check *check);
