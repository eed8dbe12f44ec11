/*
 * Calibrates cameras from pictures of a board. There are three cases:
 *
 * - all cameras and the turntable's axis, from pictures of a board that rotates with the turntable,
 *   flat and tilted;
 * - the cameras of a rig without a turntable, from pictures of a board that is laid down flat and
 *   held at several tilts;
 * - one camera, from photographs of a hand-held board.
 *
 * Frame: z is the turntable's axis, and z = 0 is the turntable's top. The print of a board that
 * lies flat is at the height of its thickness. The zero of the azimuth is chosen so that, on
 * average, the cameras' azimuths agree with the rig file and the turntable's angles agree with the
 * commanded angles. The scale comes only from the board's squares.
 *
 * Without a turntable, the print of the flattest board is taken as level, at the height of its
 * thickness. According to the rig file it must be within 5° of level. Azimuth 0 and the origin in
 * the plane are chosen so that, on average, the cameras see points around the origin in the same
 * pixels as the cameras of the rig file. Errors are relative to the flattest board.
 *
 * Lens parameters that the pictures do not determine (such as distortion in a narrow field of view)
 * stay near those of the rig file. For photographs they stay near a lens without distortion whose
 * principal point is the middle of the picture. The standard deviations of the prior are:
 *
 *   principal point     2 % of the width, for photographs 10 %
 *   k1, k2              0.3
 *   k3                  0.1
 *   p1, p2              0.003
 *   fx / fy             0.002
 *   rational k1 … k6    1
 *   fisheye k1 … k4     1
 *
 * The task may give the lens model. Otherwise the cameras of a rig have the lens models of the rig
 * file, and for photographs the model is chosen by cross-validation over pictures. Five times, each
 * model is fitted to four fifths of the pictures and predicts the corners in the last fifth. In the
 * last fifth, only the poses of the boards are fitted. The fisheye is compared with the polynomial,
 * and then the rational lens with the better of these two. A model replaces another one if it
 * lowers the loss, summed over the pictures, by more than twice the standard error of the
 * differences.
 *
 * For photographs the board may be bent, in the same way in all of them: z = b₀ x² + b₁ x y + b₂
 * y². The bend is used if it predicts left-out corners better by more than one standard error. The
 * prior of z, at a distance of half the longer side of the board from its centre, is 0 ± 2 % of
 * this distance.
 *
 * A camera on the camera arm has a pose for each of its stops and one lens for all of them. The
 * arm's axis is fitted to the poses (swing.h). A stop without pictures gets its pose from the axis
 * if the camera was calibrated at two other stops. The errors of this stop are those of the nearest
 * calibrated stop, increased by the deviation of the calibrated stops from the axis.
 *
 * The wobble of the turntable (struct rig_wobble) is fitted with as many harmonics as the number of
 * angles determines, at most RIG_WOBBLE_HARMONICS. By chance alone, p parameters lower χ² by p ±
 * √(2 p). The p parameters of the wobble are therefore kept only if they lower χ², divided by the
 * inflation of the variances, by more than p + 4 √(2 p).
 *
 * Errors include the scatter between pictures (bundle.h).
 *
 * Any thread may calibrate, but only one calibration may run at a time.
 */
#pragma once

#include "board.h"
#include "calibration/calibration.h"
#include "geometry/swing.h"
#include "pictures/picture.h"

#define CAMERAS_ERROR cameras_error_quark()
GQuark cameras_error_quark(void);
enum cameras_error {
    /* the pictures are too few, or do not determine the cameras, or do not show this board */
    CAMERAS_ERROR_PICTURES,
    CAMERAS_ERROR_FIT, /* the pictures contradict each other or the rig file */
};

struct cameras_picture {
    int camera;
    int lay; /* 0, 1, …: number of the board's position on the turntable */
    double turntable_deg;
};

/* Reads picture i of cameras_task.pictures. Returns a picture, which the calibration frees, or NULL
 * with an error. The calibration may ask for the same picture several times, and several threads
 * may call the function at the same time. */
typedef struct picture *(*CamerasRead)(int i, gpointer data, GError **error);
/* Reports that `step` of `n` steps are done. If the function returns FALSE, the calibration ends
 * with G_IO_ERROR_CANCELLED. The function is called from the thread that called
 * cameras_calibrate() or cameras_calibrate_lens(). */
typedef gboolean (*CamerasProgress)(int step, int n, gpointer data);

/* Returns a first guess of the focal length in pixels of photographs of this size, or 0 if nothing
 * is known. It is called from the thread that called cameras_calibrate_lens(). */
typedef double (*CamerasGuess)(int width, int height, gpointer data);

struct cameras_task {
    struct board board;
    const struct cameras_picture *pictures;
    int n_pictures;
    CamerasRead read;
    CamerasProgress progress; /* may be NULL */
    gpointer data;
    gboolean no_turntable; /* the rig has no turntable; cameras_picture.lay counts the positions */
    /* If TRUE, the lens model is that of the member `lens`. If FALSE, the model is chosen by
     * cross-validation for photographs, and is that of the rig file for a rig. */
    gboolean lens_given;
    enum rig_lens lens;
    CamerasGuess guess; /* only for photographs; may be NULL */
};

struct cameras_residual {
    /* corner is the id of the corner (board.h) */
    int camera, picture, corner;
    float x_px, y_px;   /* seen position of the corner */
    float dx_px, dy_px; /* predicted minus seen position */
};

struct cameras_stop {
    int lay;
    /* error_deg is the estimated minus the commanded angle */
    double commanded_deg, error_deg;
};

struct cameras_lay {
    double tilt_deg;    /* angle between the board's normal and the turntable's axis */
    double azimuth_deg; /* azimuth of the board's x axis with the turntable at 0 */
    /* number of pictures that show the board */
    int pictures;
};

struct cameras_result {
    GArray *residuals; /* struct cameras_residual */
    GArray *stops;     /* struct cameras_stop */
    GArray *lays;      /* struct cameras_lay */
    double rms_px;     /* RMS length of the residuals */
    /* Only with photographs: the robust RMS error with which each lens model predicts corners that
     * it was not fitted to (cross-validation). 0 if the model was not tried or could not be
     * fitted. */
    double held_out_px[RIG_LENSES];
    double bend_mm[2];           /* lowest and highest corner of the bent board; 0, 0: flat */
    gboolean arm_known;          /* the axis of the arm was fitted */
    struct rig_swing_fit arm;    /* the fitted axis of the arm; valid if arm_known */
    struct camera_set predicted; /* cameras whose pose was predicted from the axis of the arm */
    /* Factor of each camera's variances that accounts for the scatter between pictures; at least
     * 1. */
    double inflation[RIG_MAX_CAMERAS];
    double expected_px;      /* RMS expected from the noise of the pictures alone; 0: unknown */
    double wobble_rad;       /* largest tilt of the turntable's axis; 0: no significant wobble */
    double wobble_error_rad; /* RMS error of the tilt over a turn */
};
void cameras_result_free(struct cameras_result *result); /* NULL is ignored */

/* Computes the azimuth of the x axis of the flattest board, with the turntable at 0 and according
 * to the azimuths of the nominal cameras. Returns FALSE with CAMERAS_ERROR_FIT if this axis is
 * about half a turn from 0 and only the colour of the board's first square distinguishes the x axis
 * from its opposite. The given colour or the nominal azimuths are then wrong. */
gboolean cameras_board_azimuth(const struct cameras_result *result, const struct board *board,
                               double *ret_deg, GError **error);
typedef struct cameras_result CamerasResult;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(CamerasResult, cameras_result_free)

/* Replaces rig.cameras and rig.wobble of the calibration, rig.arm if its axis was fitted, their
 * errors, and the description of the part CALIBRATION_CAMERAS. The present values of rig.cameras
 * are the nominal ones, from which the calibration starts. Returns NULL with an error if the
 * calibration is refused; nothing is changed then. */
struct cameras_result *cameras_calibrate(struct calibration *calibration,
                                         const struct cameras_task *task, GError **error);

/* Calibrates the lens of one camera from photographs. The camera is at the origin and looks along
 * z. The calibration has one camera, of which only the name need be set. The width and height of
 * this camera become those of most photographs. Photographs of another size are rejected. Returns
 * NULL with an error as cameras_calibrate() does. */
struct cameras_result *cameras_calibrate_lens(struct calibration *calibration,
                                              const struct cameras_task *task, GError **error);
