/*
 * The result of a calibration: values, standard errors, date and pictures used; and its key file.
 *
 * The file contains all that rig_to_text() writes, so that rig_from_text() reads it: a
 * calibration may be given wherever a rig's geometry is expected. Then follow one section [part
 * NAME] for each calibrated part, sections of standard errors, and sections of others, which are
 * preserved.
 *
 * A section of numbers is one row of the table in calibration_text.c: a struct that begins with
 * `gboolean known`, an array of them here, and its fields (fields.h). It is written if known.
 *
 * Plain data; any thread, one at a time.
 */
#pragma once

#include "radiometry/colour.h"
#include "radiometry/photon_transfer.h"
#include "radiometry/radiometry.h"

enum calibration_kind {
    CALIBRATION_CAMERAS, /* and the turntable */
    CALIBRATION_LIGHTS,  /* lamps and the arc */
    CALIBRATION_LASER,
    CALIBRATION_RADIOMETRY,
    CALIBRATION_PARTS,
};

struct calibration_part {
    gboolean done;
    char *date;   /* UTC, ISO 8601: "2026-01-31T12:00:00Z" */
    char *method; /* one line */
    double residual_rms;
    double residual_expected; /* what the noise of the data explains, in the same unit; 0: not known
                               */
    char *residual_unit;      /* "px", "%" … */
    int degrees_of_freedom;
    int pictures;        /* used, without the rejected ones */
    char *checksum;      /* SHA-256 of all pictures' checksums in order; calibration_checksum() */
    GPtrArray *rejected; /* of char *: "picture: reason"; empty if none */
};

/* Order of a camera's parameters in its covariance. The rotation is a small rotation vector ω in
 * radians about the rig's axes: R_true ≈ R_found (1 + [ω]×). */
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
    CALIBRATION_SHIFT_X, /* of translation_mm */
    CALIBRATION_SHIFT_Y,
    CALIBRATION_SHIFT_Z,
    CALIBRATION_CAMERA_PARAMETERS,
    /* Only rational and fisheye lenses have these, next to k1, k2 and k3 above. */
    CALIBRATION_K4 = CALIBRATION_CAMERA_PARAMETERS,
    CALIBRATION_K5,
    CALIBRATION_K6,
    CALIBRATION_ALL_CAMERA_PARAMETERS,
};

struct calibration_camera { /* with rig.cameras */
    gboolean known;
    /* In the units of the parameters; 0 in rows of fixed parameters. */
    double covariance[CALIBRATION_CAMERA_PARAMETERS][CALIBRATION_CAMERA_PARAMETERS];
    /* Rows k4, k5, k6 against all parameters. */
    double further_covariance[3][CALIBRATION_ALL_CAMERA_PARAMETERS];
    double lateral_colour[3]; /* standard errors of red, green, blue; 0: not looked for */
    double residual_rms_px;
    double expected_px; /* what the noise of the corners explains of it; 0: not known */
    int points;         /* corners it was calibrated from */
};

struct calibration_lamp { /* with rig.lamps */
    gboolean known;
    double position_covariance_mm2[3][3];
};

struct calibration_turntable { /* with rig.wobble; standard error */
    gboolean known;
    double wobble_rad; /* of the tilt, mean over a turn */
};

struct calibration_arc { /* with rig.arc; standard errors, 0 for values that were not estimated */
    gboolean known;
    double zero_rad, tilt_rad[2], centre_mm[2];
};

/* Values of a laser that may be known from before rather than from its lines. */
enum calibration_laser_value {
    CALIBRATION_LASER_POSITION,
    CALIBRATION_LASER_AXIS,
    CALIBRATION_LASER_NORMAL,
    CALIBRATION_LASER_STRETCH,
    CALIBRATION_LASER_VALUES,
};

struct calibration_laser { /* with rig.lasers; standard errors */
    gboolean known;
    double position_mm[3]; /* across the axis; along it the position is undetermined */
    double axis_rad, normal_rad, stretch;
    double bend_rad;
    /* 1 if the lines do not determine a value. Its error is then the error of the arc's axis from
     * an earlier calibration. Such errors cancel each other. The errors of the sheets are in
     * sheet. */
    int from_prior[CALIBRATION_LASER_VALUES];
    /* Of the sheet near the sample, with what noise does not explain of the residual; 0 in files of
     * earlier versions. */
    struct rig_sheet_errors sheet;
    double residual_rms_mm;
    double expected_rms_mm; /* what the noise of the lines explains of it; 0: not known */
    double line_rad;        /* standard deviation of the line's profile on the plates, as a sweep
                               angle; 0: not known */
};

struct calibration_noise { /* with rig.cameras */
    gboolean known;
    struct transfer transfer;
};

struct calibration_fiducial { /* with rig.fiducials; standard errors */
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

/* A calibration without results: the nominal rig. */
struct calibration *calibration_new(const struct rig *nominal);
void calibration_free(struct calibration *calibration); /* NULL is ignored */
typedef struct calibration Calibration;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Calibration, calibration_free)

/* Turns the rig frame: azimuth a becomes a + angle, of cameras, lamps, lasers, arc, fiducials and
 * their errors. Their positions relative to each other stay as they are. */
void calibration_turn(struct calibration *calibration, double angle_rad);

/* "cameras", "lights", "laser", "radiometry". */
const char *calibration_part_name(enum calibration_kind kind);

/* Returns one line for people: where the calibration is from and which parts it has; or, if there
 * is none, this and the text how_to, which says how to give one. g_free(). */
char *calibration_line(const struct calibration *calibration, const char *from, const char *how_to);

/* Replaces the description of a part, dated now. Takes ownership of rejected (of char *; NULL:
 * none). */
struct calibration_part *calibration_set_part(struct calibration *calibration,
                                              enum calibration_kind kind, const char *method,
                                              int pictures, const char *checksum,
                                              GPtrArray *rejected);

/* Checksum of n checksums (or other strings) in order; g_free(). */
char *calibration_checksum(const char *const *checksums, int n);

/* g_free() */
char *calibration_to_text(const struct calibration *calibration);
/* Also reads the text of rig_to_text(), as a calibration without results. NULL: RIG_ERROR with
 * path, section and key. */
struct calibration *calibration_from_text(const char *text, const char *path, GError **error);

/* Writes atomically: a temporary file is renamed. */
gboolean calibration_write(const struct calibration *calibration, const char *path, GError **error);
struct calibration *calibration_read(const char *path, GError **error);

/* Whether it belongs to this rig: id, and names and sizes of cameras, lamps and lasers. */
gboolean calibration_check_rig(const struct calibration *calibration, const char *path,
                               const struct rig *nominal, GError **error);

/* Covariance of where a camera sees a point of the rig frame, in px², from the covariance of its
 * parameters. FALSE, and 0: it is not calibrated, or does not see the point. */
gboolean calibration_sight(const struct calibration *calibration, int camera, struct vec3 point_mm,
                           double ret_px2[2][2]);

/* Days since a part was calibrated; −1: it was not. */
double calibration_age_days(const struct calibration *calibration, enum calibration_kind kind);
