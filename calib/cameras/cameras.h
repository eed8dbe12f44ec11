/*
 * Calibration of all cameras and the turntable's axis from pictures of a board that was turned with
 * the turntable, flat and at a tilt; or of one camera from photographs of a board held anyhow.
 *
 * Frame: z is the turntable's axis. z = 0 is its top: the print of a board that lies flat is its
 * thickness above. The azimuth's zero is such that the cameras' azimuths differ from the rig file's
 * by 0 in the mean, and the turntable's angles by 0 in the mean from those commanded.
 * Length comes from the board's squares alone.
 *
 * Lens parameters that the pictures do not determine (distortion in a narrow field of view) stay
 * near the rig file's: principal point within 2 % of the width, k1 and k2 0.3, k3 0.1, p1 and p2
 * 0.003, fx / fy 0.002, as standard deviations.
 *
 * Any thread, one calibration at a time.
 */
#pragma once

#include "board.h"
#include "calibration/calibration.h"
#include "pictures/picture.h"

#define CAMERAS_ERROR cameras_error_quark()
GQuark cameras_error_quark(void);
enum cameras_error {
    CAMERAS_ERROR_PICTURES, /* too few, degenerate, or of something else */
    CAMERAS_ERROR_FIT,      /* they contradict each other or the rig file */
};

struct cameras_picture {
    int camera;
    int lay; /* 0, 1, …: each way the board was put down */
    double turntable_deg;
};

/* Picture i, anew each time; NULL: error. Called from several threads at once. */
typedef struct picture *(*CamerasRead)(int i, gpointer data, GError **error);
/* step of n steps; FALSE cancels (G_IO_ERROR_CANCELLED). From the calling thread. */
typedef gboolean (*CamerasProgress)(int step, int n, gpointer data);

struct cameras_task {
    struct board board;
    const struct cameras_picture *pictures;
    int n_pictures;
    CamerasRead read;
    CamerasProgress progress; /* may be NULL */
    gpointer data;
};

struct cameras_residual {
    int camera, picture;
    float x_px, y_px;   /* where a corner was seen */
    float dx_px, dy_px; /* and how far from there it should have been */
};

struct cameras_stop {
    int lay;
    double commanded_deg, error_deg; /* how much further the turntable truly was */
};

struct cameras_lay {
    double tilt_deg; /* of the board's normal from the axis */
    int pictures;
};

struct cameras_result {
    GArray *residuals; /* struct cameras_residual */
    GArray *stops;     /* struct cameras_stop */
    GArray *lays;      /* struct cameras_lay */
    double rms_px;
};
void cameras_result_free(struct cameras_result *result); /* NULL is ignored */
typedef struct cameras_result CamerasResult;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(CamerasResult, cameras_result_free)

/* Replaces rig.cameras of the calibration, their covariances and what is said of that part; what it
 * holds before are the nominal values to start from. NULL: refused, and nothing is changed. */
struct cameras_result *cameras_calibrate(struct calibration *calibration,
                                         const struct cameras_task *task, GError **error);

/* The lens of one camera, from photographs: the camera stands at the origin and looks along z. The
 * calibration has one camera, of which only name, width and height need be set. */
struct cameras_result *cameras_calibrate_lens(struct calibration *calibration,
                                              const struct cameras_task *task, GError **error);
