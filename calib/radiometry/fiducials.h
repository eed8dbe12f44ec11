/*
 * Fiducials are white discs on the turntable (rig_fiducial). A picture of a fiducial gives the
 * output of the lamp and the position of the fiducial. Around the fiducial, a ring that is one
 * radius wide must be darker than the fiducial.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include "radiometry.h"

/* A fiducial_scene is the commanded state in which a picture was taken. The struct does not own
 * what its pointers refer to. */
struct fiducial_scene {
    const struct rig *rig;
    int camera, lamp;
    double turntable_rad, arc_rad;
    /* radiometry of the camera; fiducials_white() also accepts NULL */
    const struct radiometry_camera *radiometry;
    const struct radiometry_lamp *lamp_radiometry; /* of the lamp; NULL if it is not known */
};

struct fiducial_seen {
    int camera, fiducial;
    double turntable_rad;
    double x_px, y_px; /* centroid of the fiducial's area in the picture */
    /* standard error of x_px and of y_px, from noise, pixel size and an uneven surround */
    double error_px;
    double expected_x_px, expected_y_px;
    /* Output of the lamp, relative to its calibration, and its standard error. The error is
     * infinite if the fiducial has too few pixels or is unevenly lit. */
    double output, output_error;
};

/* Appends a struct fiducial_seen for each fiducial that is lit and wholly in the picture, and
 * returns their number. mosaic is height × width, in DN per ms above dark. cfa is as in
 * frames/rectify.h. The camera's veiling glare is subtracted. A fiducial is found if it is at most
 * its radius away from its expected position. */
int fiducials_measure(const struct fiducial_scene *scene, const char *cfa, const float *mosaic,
                      GArray *seen);

/* Returns the expected value at the centre of a fiducial in DN per ms, as a mean over the colours,
 * if the lamp has its calibrated output. The outputs that fiducials_measure() finds are relative to
 * this value. Returns 0 if the centre is not in the picture or not lit. */
double fiducials_white(const struct fiducial_scene *scene, int fiducial);

/* Computes the mean output of a lamp in one shot from n sightings by all cameras. The weights are
 * 1/σ², where σ is the standard error of a sighting's output. If no sighting has an output, returns
 * FALSE and sets the output to 1 and the error to 0. */
gboolean fiducials_output(const struct fiducial_seen *seen, int n, double *ret_output,
                          double *ret_error);

/* An estimate of one fiducial from sightings at several turntable angles by several cameras. */
struct fiducial_fit {
    struct vec3 centre_mm;
    double centre_error_mm[3];
    double white, white_error; /* relative to the reflectance in the rig file */
    int n_seen;
};

/* Estimates the position and the reflectance of a fiducial. Sightings of other fiducials are
 * ignored. The positions of cameras and turntable are taken as correct. If they are not calibrated,
 * set `place` to FALSE; the fiducial then keeps its position. Returns FALSE if there are too few
 * sightings. */
gboolean fiducials_fit(const struct rig *rig, const struct fiducial_seen *seen, int n, int fiducial,
                       gboolean place, struct fiducial_fit *ret);

/* The result of comparing the positions of fiducials with the calibration. It names the best
 * explanation of a deviation: the turntable has slipped, or one or several cameras have rotated. */
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

/* What has moved since the calibration. */
struct fiducials_moved {
    struct camera_set cameras;
    gboolean turntable; /* it slipped */
};
struct fiducials_moved fiducials_moved(const struct rig *rig, const struct fiducials_check *check);
/* Operations on two sets a and b of what has moved:
 * - fiducials_moved_both() returns what is in a and in b.
 * - fiducials_moved_without() returns what is in a but not in b.
 * - fiducials_moved_union() returns what is in a, in b or in both.
 *
 * fiducials_moved_any() returns whether a set is not empty. */
struct fiducials_moved fiducials_moved_both(struct fiducials_moved a, struct fiducials_moved b);
struct fiducials_moved fiducials_moved_without(struct fiducials_moved a, struct fiducials_moved b);
struct fiducials_moved fiducials_moved_union(struct fiducials_moved a, struct fiducials_moved b);
gboolean fiducials_moved_any(struct fiducials_moved moved);

/* Compares n sightings with the calibration. systematic_px is the error that remains after a good
 * calibration; its square is added to the square of each sighting's standard error. The check
 * reports a motion (`slipped` or `moved`) only if its angle exceeds least_deg and also exceeds four
 * standard errors of the angle. */
void fiducials_check(const struct rig *rig, const struct fiducial_seen *seen, int n,
                     double systematic_px, double least_deg, struct fiducials_check *ret);

/* Returns text such as "camera cam30 is turned by 0.10° ± 0.01°", or NULL if nothing has moved.
 * Free it with g_free(). */
char *fiducials_describe(const struct rig *rig, const struct fiducials_check *check);
