/*
 * White marks on the turntable (rig_mark), found in a picture: what they show of the lamp, and
 * where they are. A mark must stand out: nothing as bright may lie nearer to its edge than its
 * radius.
 *
 * Pure functions over plain data: any thread.
 */
#pragma once

#include "radiometry/radiometry.h"

struct mark_scene { /* what a picture was taken of, as it was commanded; pointers are borrowed */
    const struct rig *rig;
    int camera, lamp;
    double turntable_rad, arc_rad;
    const struct radiometry_camera *radiometry;    /* of the camera, and */
    const struct radiometry_lamp *lamp_radiometry; /* of the lamp; NULL: not known */
};

struct mark_seen {
    int camera, mark;
    double turntable_rad;
    double x_px, y_px; /* its middle in the picture: centroid of its area */
    double error_px;   /* standard error of each, by noise, pixels, and an uneven surround */
    double expected_x_px, expected_y_px;
    double output, output_error; /* of the lamp, of what the rig says it gives; the error is
                                    infinite where the mark is too small in the picture to tell */
};

/* Appends (struct mark_seen) the marks that are wholly in the picture and lit; returns how many.
 * mosaic: DN a millisecond above dark, height rows of width; cfa as in frames/rectify.h. Marks
 * are found up to their radius away from where they are expected. */
int marks_measure(const struct mark_scene *scene, const char *cfa, const float *mosaic,
                  GArray *seen);

/* The mean of n marks (of one shot, of all cameras), each counted by its standard error. FALSE: of
 * none. */
gboolean marks_output(const struct mark_seen *seen, int n, double *ret_output, double *ret_error);

/* What sightings at several turntable angles, by several cameras, say of one mark. */
struct mark_fit {
    struct vec3 centre_mm;
    double centre_error_mm[3];
    double white, white_error; /* of the reflectance that the rig says it has */
    int n_seen;
};

/* Among n sightings those of the mark. Cameras and turntable are taken to be right; if they are not
 * calibrated, place is FALSE: the mark stays where the rig has it. FALSE: seen too seldom. */
gboolean marks_fit(const struct rig *rig, const struct mark_seen *seen, int n, int mark,
                   gboolean place, struct mark_fit *ret);

/* Whether marks are where the calibration says; what explains it best if not: the turntable's zero,
 * or one camera after the other. */
struct marks_check {
    int n_seen;
    double rms_px; /* of how far off they are, before anything is explained */
    gboolean slipped;
    double slip_deg, slip_error_deg; /* of the turntable, counter-clockwise */
    struct {
        int n_seen;
        gboolean moved;
        double turn_deg, turn_error_deg; /* of the camera about its own centre */
    } cameras[RIG_MAX_CAMERAS];
};

/* systematic_px: by how much a good calibration may be off; it is added to the marks' errors.
 * least_deg: what is smaller is nothing. Angles are reported from both four standard errors and
 * this on. */
void marks_check(const struct rig *rig, const struct mark_seen *seen, int n, double systematic_px,
                 double least_deg, struct marks_check *ret);

/* "camera cam30 is turned by 0.10° ± 0.01°"; NULL if nothing has moved; g_free(). */
char *marks_describe(const struct rig *rig, const struct marks_check *check);
