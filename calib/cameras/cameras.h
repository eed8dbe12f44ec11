/*
 * Calibration of all cameras and the turntable's axis from pictures of a board that rotates with
 * the turntable, flat and tilted; of the cameras of a rig without a turntable from pictures of a
 * board that is laid down flat and held at several tilts; or of one camera from photographs of a
 * hand-held board.
 *
 * Frame: z is the turntable's axis, z = 0 its top: the print of a board that lies flat is at the
 * height of its thickness. The zero of the azimuth is such that the cameras' azimuths agree with
 * the rig file's, and the turntable's angles with the commanded ones, in the mean. The scale
 * comes from the board's squares only.
 *
 * Without a turntable the print of the flattest board, which must be within 5° of level by the rig
 * file, is level at the height of its thickness. Azimuth 0 and the origin in the plane are such
 * that the cameras see them where the rig file's do, in the mean. Errors are those relative to the
 * flattest board.
 *
 * Lens parameters that the pictures do not determine (such as distortion in a narrow field of
 * view) stay near the rig file's. Standard deviations of this prior: principal point 2 % of the
 * width, k1 and k2 0.3, k3 0.1, p1 and p2 0.003, fx / fy 0.002; of a rational lens k1 … k6 1 and of
 * a fisheye k1 … k4 1 instead.
 *
 * The lens model is the rig file's, or the polynomial for photographs, unless the task says
 * another. For photographs it can be chosen by evidence: each model is fitted to four fifths of
 * the pictures and predicts the corners in the others, whose boards alone are fitted, five times
 * (cross-validation by picture). The fisheye takes the polynomial's place, and then the rational
 * lens theirs, if the loss over the pictures falls by more than twice the standard error of its
 * differences.
 *
 * For photographs the board may be bent, in the same way in all of them: z = b₀ x² + b₁ x y + b₂
 * y², if that predicts left-out corners better by more than one standard error. A bend that is not
 * there costs no more than its variance. Prior: 0 ± 2 % of half the longer side, there.
 *
 * A camera on the camera arm has a pose for each of its stops and one lens for all of them. The
 * arm's axis is fitted to the poses (swing.h). A stop at which no picture was taken, of a camera
 * that was calibrated at two others, gets its pose from the axis; its errors are those of the
 * nearest stop, increased by how far the calibrated stops are from the axis.
 *
 * The wobble of the turntable (struct rig_wobble) is fitted with as many harmonics as the number of
 * angles determines, at most RIG_WOBBLE_HARMONICS. χ² is divided by the inflation of the variances.
 * The same number of meaningless parameters also lowers χ². The wobble is kept if χ² falls by more
 * than four standard deviations of that chance decrease.
 *
 * Errors include the scatter between pictures (bundle.h).
 *
 * Any thread, one calibration at a time.
 */
#pragma once

#include "board.h"
#include "calibration/calibration.h"
#include "geometry/swing.h"
#include "pictures/picture.h"

#define CAMERAS_ERROR cameras_error_quark()
GQuark cameras_error_quark(void);
enum cameras_error {
    CAMERAS_ERROR_PICTURES, /* too few, degenerate, or of something else */
    CAMERAS_ERROR_FIT,      /* the pictures contradict each other or the rig file */
};

struct cameras_picture {
    int camera;
    int lay; /* 0, 1, …: number of the board's position on the turntable */
    double turntable_deg;
};

/* Reads picture i, on every call again; NULL: error. Called from several threads at the same time.
 */
typedef struct picture *(*CamerasRead)(int i, gpointer data, GError **error);
/* Progress: step of n. FALSE cancels (G_IO_ERROR_CANCELLED). Called from the calling thread. */
typedef gboolean (*CamerasProgress)(int step, int n, gpointer data);

struct cameras_task {
    struct board board;
    const struct cameras_picture *pictures;
    int n_pictures;
    CamerasRead read;
    CamerasProgress progress; /* may be NULL */
    gpointer data;
    gboolean no_turntable; /* the rig has none: every lay is one position of the board */
    gboolean lens_given;   /* FALSE: by evidence for photographs, the rig file's for a rig */
    enum rig_lens lens;
};

struct cameras_residual {
    int camera, picture, corner; /* corner: board.h */
    float x_px, y_px;            /* position of a corner in the picture, */
    float dx_px, dy_px;          /* and predicted minus seen position */
};

struct cameras_stop {
    int lay;
    double commanded_deg, error_deg; /* true minus commanded angle */
};

struct cameras_lay {
    double tilt_deg;    /* angle between the board's normal and the axis */
    double azimuth_deg; /* of the board's x axis with the turntable at 0, seen from above */
    int pictures;
};

struct cameras_result {
    GArray *residuals; /* struct cameras_residual */
    GArray *stops;     /* struct cameras_stop */
    GArray *lays;      /* struct cameras_lay */
    double rms_px;
    /* Cross-validation of the lens models, with photographs only: the robust RMS error with which
     * each predicts corners that it was not fitted to; 0: not tried, or not fitted. */
    double held_out_px[RIG_LENSES];
    double bend_mm[2];                 /* lowest and highest corner of the bent board; 0, 0: flat */
    gboolean arm_known;                /* the axis of the arm was fitted; */
    struct rig_swing_fit arm;          /* its fit; valid if arm_known */
    guint32 predicted;                 /* cameras (bits) whose poses the axis gave */
    double inflation[RIG_MAX_CAMERAS]; /* of variances, by the scatter of pictures; ≥ 1 */
    double expected_px;      /* the RMS that the noise of the pictures explains; 0: not known */
    double wobble_rad;       /* largest tilt of the turntable's axis, 0: no wobble is significant */
    double wobble_error_rad; /* its standard deviation, mean over a turn */
};
void cameras_result_free(struct cameras_result *result); /* NULL is ignored */

/* Azimuth of the x axis of the board that lies flattest, with the turntable at 0, by the azimuths
 * of the nominal cameras. FALSE: only the colour of the board's first square tells its x axis from
 * its opposite, and that axis is half a turn from 0: the colour, or the nominal azimuths, are
 * wrong. */
gboolean cameras_board_azimuth(const struct cameras_result *result, const struct board *board,
                               double *ret_deg, GError **error);
typedef struct cameras_result CamerasResult;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(CamerasResult, cameras_result_free)

/* Replaces rig.cameras of the calibration, their covariances, and the description of that part;
 * its present values are the nominal ones to start from. NULL: refused; nothing is changed. */
struct cameras_result *cameras_calibrate(struct calibration *calibration,
                                         const struct cameras_task *task, GError **error);

/* Calibrates the lens of one camera from photographs; the camera is at the origin and looks along
 * z. The calibration has one camera, of which only the name need be set: its width and height
 * become those of most photographs, and those of another size are rejected. */
struct cameras_result *cameras_calibrate_lens(struct calibration *calibration,
                                              const struct cameras_task *task, GError **error);
