/*
 * This module holds the result of a calibration: values, standard errors, date and pictures used.
 * It also reads and writes the key file of the result.
 *
 * The file begins with the text of rig_to_text(), so rig_from_text() can read it, and a calibration
 * may be given wherever the geometry of a rig is expected. Then follow a section [part NAME] for
 * each calibrated part, sections of standard errors, and sections of other programs, which are
 * preserved.
 *
 * To add a section of numbers, define a struct that begins with `gboolean known`, and add it, or an
 * array of it, to struct calibration. In calibration_text.c, add a table of its fields (fields.h),
 * and a row to groups[]. The section is written if known is set.
 *
 * Any thread may use a calibration, but only one thread at a time.
 */
#pragma once

#include "radiometry/colour.h"
#include "radiometry/photon_transfer.h"
#include "radiometry/radiometry.h"

enum calibration_kind {
    CALIBRATION_CAMERAS, /* the cameras and the turntable */
    CALIBRATION_LIGHTS,  /* the lamps and the arc */
    CALIBRATION_LASER,
    CALIBRATION_RADIOMETRY,
    CALIBRATION_PARTS,
};

struct calibration_part {
    gboolean done;
    char *date;          /* UTC, ISO 8601: "2026-01-31T12:00:00Z" */
    char *method;        /* one line */
    double residual_rms; /* RMS of the residuals after the fit, in residual_unit */
    /* The RMS of the residuals that the noise of the data alone would cause, in residual_unit,
     * or 0 if it is not known. */
    double residual_expected;
    char *residual_unit; /* "px", "%" … */
    int degrees_of_freedom;
    /* Number of pictures on which the part is based. A picture counts even if some of its sights or
     * sweeps were rejected. */
    int pictures;
    char *checksum;      /* calibration_checksum() of these pictures */
    GPtrArray *rejected; /* of char *: "picture: reason"; empty if nothing was rejected */
};

/* Order of a camera's parameters in its covariance. TURN_X, TURN_Y and TURN_Z are a small rotation
 * vector ω in radians about the rig's axes: R_true ≈ R_found (1 + [ω]×). */
enum calibration_camera_parameter {
    CALIBRATION_FX,
    CALIBRATION_FY,
    CALIBRATION_CX,
    CALIBRATION_CY,
    CALIBRATION_K1,
    CALIBRATION_K2,
    CALIBRATION_K3,
    CALIBRATION_P1,
    CALIBRATION_P2,
    CALIBRATION_TURN_X,
    CALIBRATION_TURN_Y,
    CALIBRATION_TURN_Z,
    CALIBRATION_SHIFT_X, /* SHIFT_X, SHIFT_Y, SHIFT_Z are translation_mm */
    CALIBRATION_SHIFT_Y,
    CALIBRATION_SHIFT_Z,
    CALIBRATION_CAMERA_PARAMETERS,
    /* Further coefficients of the lens model: a rational lens has all three, and a fisheye only
     * k4. */
    CALIBRATION_K4 = CALIBRATION_CAMERA_PARAMETERS,
    CALIBRATION_K5,
    CALIBRATION_K6,
    CALIBRATION_ALL_CAMERA_PARAMETERS,
};

/* Each of the next structs holds the standard errors of a calibrated device. The comment of the
 * struct names the member of struct rig that holds the values of the device. If that member is an
 * array, each of its elements has a struct with the same index. */

struct calibration_camera { /* for rig.cameras */
    gboolean known;
    /* The unit of each element is the product of the units of its two parameters. The rows and
     * columns of parameters that were not estimated are 0. */
    double covariance[CALIBRATION_CAMERA_PARAMETERS][CALIBRATION_CAMERA_PARAMETERS];
    /* Row i has the covariances of k4, k5 or k6 with all parameters. */
    double further_covariance[3][CALIBRATION_ALL_CAMERA_PARAMETERS];
    double lateral_colour[3]; /* standard errors of rig_camera.lateral_colour; 0: unknown */
    double residual_rms_px;
    double expected_px; /* RMS expected from the noise of the corners alone; 0 if not known */
    int points;         /* number of corners that were used */
};

struct calibration_lamp { /* for rig.lamps */
    gboolean known;
    double position_covariance_mm2[3][3];
};

struct calibration_turntable { /* for rig.wobble */
    gboolean known;
    double wobble_rad; /* standard error of the tilt, RMS over a turn */
};

/* For rig.arc. The values are standard errors; 0 for a value that was not estimated. */
struct calibration_arc {
    gboolean known;
    double zero_rad, tilt_rad[2], centre_mm[2];
};

/* Values of a laser. The lines that were measured on the plates may leave some of these values
 * undetermined. */
enum calibration_laser_value {
    CALIBRATION_LASER_POSITION,
    CALIBRATION_LASER_AXIS,
    CALIBRATION_LASER_NORMAL,
    CALIBRATION_LASER_STRETCH,
    CALIBRATION_LASER_VALUES,
};

/* For rig.lasers. The members up to bend_rad are standard errors. */
struct calibration_laser {
    gboolean known;
    /* Only the component of the position across the axis has an error. The lines do not determine
     * the component along the axis. */
    double position_mm[3];
    double axis_rad, normal_rad, stretch;
    double bend_rad;
    /* 1 for each value (enum calibration_laser_value) that the lines hardly determine, otherwise
     * 0. A large part of the error of such a value comes from the error of the arc's axis in an
     * earlier calibration. In the laser sheets, these errors partly cancel; the errors of the
     * sheets are in `sheet`. */
    int from_prior[CALIBRATION_LASER_VALUES];
    /* Errors of the laser sheet near the sample. They include the part of the residual that noise
     * does not explain. They are 0 if the file was written by a version that did not store them. */
    struct rig_sheet_errors sheet;
    double residual_rms_mm;
    double expected_rms_mm; /* RMS expected from the noise of the lines alone; 0 if not known */
    /* Width of the line on the plates: the standard deviation of its profile, as a sweep angle. It
     * is 0 if it is not known. */
    double line_rad;
};

struct calibration_noise { /* for rig.cameras */
    gboolean known;
    struct transfer transfer;
};

struct calibration_fiducial { /* for rig.fiducials; standard errors */
    gboolean known;
    double centre_mm[3], reflectance[3];
};

struct calibration {
    struct rig rig;
    struct calibration_part parts[CALIBRATION_PARTS];
    struct calibration_camera cameras[RIG_MAX_CAMERAS];
    struct calibration_turntable turntable;
    struct calibration_arc arc;
    struct calibration_lamp lamps[RIG_MAX_LAMPS];
    struct calibration_laser lasers[RIG_MAX_LASERS];
    struct radiometry_camera camera_radiometry[RIG_MAX_CAMERAS];
    struct radiometry_lamp lamp_radiometry[RIG_MAX_LAMPS];
    struct calibration_noise noise[RIG_MAX_CAMERAS];
    struct calibration_fiducial fiducials[RIG_MAX_FIDUCIALS];
    struct colour_matrix colour;
    GKeyFile *extra; /* sections of other programs */
};

/* Makes a calibration without results, which has the values of the nominal rig. */
struct calibration *calibration_new(const struct rig *nominal);
void calibration_free(struct calibration *calibration); /* NULL is ignored */
typedef struct calibration Calibration;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Calibration, calibration_free)

/* Turns the rig frame, so that every azimuth a becomes a + angle_rad. This turns cameras, lamps,
 * lasers, fiducials, the axes of arc, camera arm and light probe, the wobble, and their errors. The
 * covariance of the x and y of a laser, a fiducial or the arc's axis is not stored and counts
 * as 0. */
void calibration_turn(struct calibration *calibration, double angle_rad);

/* Returns "cameras", "lights", "laser" or "radiometry". */
const char *calibration_part_name(enum calibration_kind kind);

/* Returns a line for users. If at least one part is calibrated, the line has the name of the file,
 * `from`, and says which parts are calibrated and which are not. If no part is calibrated, the line
 * says so, and contains the text how_to in brackets. how_to tells the user how to give a
 * calibration. Free the line with g_free(). */
char *calibration_line(const struct calibration *calibration, const char *from, const char *how_to);

/* Sets the description of a part, with the present date, and returns the part, which belongs to the
 * calibration. residual_unit becomes "px". The other members of the part become 0, and the caller
 * sets them. Takes ownership of rejected, an array of char *; NULL means that no picture was
 * rejected. */
struct calibration_part *calibration_set_part(struct calibration *calibration,
                                              enum calibration_kind kind, const char *method,
                                              int pictures, const char *checksum,
                                              GPtrArray *rejected);

/* Returns the SHA-256 checksum of n checksums (or other strings) in their order. Free it with
 * g_free(). */
char *calibration_checksum(const char *const *checksums, int n);

/* Returns the text of the key file. Free it with g_free(). */
char *calibration_to_text(const struct calibration *calibration);
/* Reads the text of the key file. Also reads the text of rig_to_text(), as a calibration without
 * results. On failure returns NULL and the error RIG_ERROR, which names the path and, if a value
 * is wrong, the section and the key. */
struct calibration *calibration_from_text(const char *text, const char *path, GError **error);

/* Writes the file atomically, by renaming a temporary file. The new text is first read back. If it
 * cannot be read back, or if writing fails, returns FALSE with an error, and an existing file is
 * not changed. */
gboolean calibration_write(const struct calibration *calibration, const char *path, GError **error);
/* The same as calibration_from_text() for a file of at most 16 MiB. Returns NULL with G_FILE_ERROR
 * for an error of the system, and with RIG_ERROR if the file is not a calibration. */
struct calibration *calibration_read(const char *path, GError **error);

/* Checks that the calibration belongs to this rig. The id, and the numbers and names of cameras,
 * lamps and lasers, must be the same. The size of each camera and its place on the camera arm must
 * be the same. The arc must carry the same lamps and lasers. Returns FALSE with RIG_ERROR_VALUE
 * otherwise. */
gboolean calibration_check_rig(const struct calibration *calibration, const char *path,
                               const struct rig *nominal, GError **error);

/* Computes the covariance, in px², of the place at which a camera sees a point of the rig frame. It
 * follows from the covariance of the camera's parameters. Returns FALSE and a covariance of 0 if
 * the camera is not calibrated, or does not see the point. */
gboolean calibration_sight(const struct calibration *calibration, int camera, struct vec3 point_mm,
                           double ret_px2[2][2]);

/* Returns the factor that converts a lamp's output relative to the calibration `from` to its output
 * relative to the calibration `to`. Outputs are those that fiducials_measure() finds in pictures of
 * this camera. Each calibration predicts the value of each fiducial as if it were white
 * (fiducials_white()). The factor is the mean ratio of the value by `from` to the value by `to`,
 * over the fiducials for which both values are above 0. The factor is 1 if there is no such
 * fiducial. */
double calibration_output_factor(const struct calibration *from, const struct calibration *to,
                                 int camera, int lamp, double turntable_rad, double arc_rad);

/* Returns the number of days since a part was calibrated, or −1 if it was not calibrated or its
 * date is not in ISO 8601. The number is negative if the date is in the future. */
double calibration_age_days(const struct calibration *calibration, enum calibration_kind kind);
