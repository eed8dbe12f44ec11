/* State shared by cameras_*.c: pictures, corners, and the present geometry. */
#pragma once

#include "board_find.h"
#include "board_size.h"
#include "bundle.h"
#include "cameras.h"

#define CAMERAS_ROUNDS 4

struct seen { /* a picture */
    char *name, *checksum;
    int camera, lay, stop;
    int width, height; /* px */
    GArray *corners;   /* struct corner; NULL: not found or set aside, see why */
    GArray *set_aside; /* corners of a picture that contradicts the others */
    char *why;
    gboolean coloured; /* the camera has a colour filter */
};

struct cameras_work {
    struct calibration *calibration;
    const struct cameras_task *task;
    struct rig nominal;
    struct seen *seen;
    struct bundle bundle;
    GArray *observations; /* struct bundle_observation, of bundle */
    BoardCensus *census;  /* notices a wrong size of the board */
    gboolean free_boards;
    double held_out_px[RIG_LENSES], inflation[RIG_MAX_CAMERAS]; /* cameras.h */
    /* rig.h and calibration.h */
    double lateral_colour[RIG_MAX_CAMERAS][3], lateral_error[RIG_MAX_CAMERAS][3];
    struct lateral *lateral; /* of each picture, in cameras_lateral.c */
    int steps, step;
    double unexplained_px; /* typical residual of the first fit, if it is large, and no mistake that
                              is known explains it; else 0 */
};

/* Advice of an error about two exchanged cameras; printf arguments: the names of both. */
#define CAMERAS_EXCHANGE_THEM                                                                      \
    "exchange the devices of [camera %s] and [camera %s] in the rig file, or for imported "        \
    "pictures their names in the table, and capture or import again"

gboolean cameras_refuse(GError **error, enum cameras_error code, const char *format, ...)
    G_GNUC_PRINTF(3, 4);

/* Sets the reason why a picture is not used, after its name. */
void cameras_set_why(struct seen *seen, const char *why);
/* Reports one more step of progress. */
gboolean cameras_progress(struct cameras_work *work, GError **error);
/* cameras_arm.c: the camera arm's axis from the stops with pictures; known: there are enough.
 * FALSE: they do not turn about one axis, or not about the rig file's. */
gboolean cameras_fit_arm(const struct cameras_work *work, gboolean *ret_known,
                         struct rig_swing_fit *ret, GError **error);
/* Copies the axis to the result, and places stops without pictures by it. */
void cameras_place_stops(const struct cameras_work *work, struct calibration *calibration,
                         struct cameras_result *result);
void cameras_take_camera(struct rig_camera *to, const struct bundle_camera *from);

/* cameras_start.c: initial values of cameras from the rig file, of lays from the pictures. */
void cameras_start(struct cameras_work *work);
gboolean cameras_start_lens(struct cameras_work *work, GError **error);
gboolean cameras_start_lays(struct cameras_work *work, GError **error);
gboolean cameras_start_lay(struct cameras_work *work, int lay);
/* cameras_still.c, without a turntable: makes the flattest lay level, and fixes it; and turns and
 * shifts the rig in the plane so that the cameras see it where the nominal ones do, in the mean. */
gboolean cameras_level(struct cameras_work *work, GError **error);
void cameras_align(struct cameras_work *work);
void cameras_set_observations(struct cameras_work *work);
double cameras_median(GArray *values); /* of double; sorts the array */

/* cameras.c: runs a pass over pictures, in several threads; returns the first error. reach_px: of
 * each picture, negative: skip it; NULL: all, with 0. */
typedef gboolean (*CamerasPass)(struct cameras_work *work, int i, double reach_px, GError **error);
gboolean cameras_for_each(struct cameras_work *work, CamerasPass run, const double *reach_px,
                          GError **error);
/* cameras.c: where a camera sees a point of the board at a stop, a BoardProject. */
struct cameras_look {
    const struct bundle *bundle;
    int camera, stop;
};
gboolean cameras_project(const double xy_mm[2], gboolean straight, double ret_xy_px[2],
                         gconstpointer data);

/* cameras_lateral.c: finds the lateral colour of each lens, with the geometry known. */
gboolean cameras_find_lateral(struct cameras_work *work, GError **error);

/* cameras_lens.c: chooses the lens model for photographs. */
gboolean cameras_choose_lens(struct cameras_work *work, GError **error);
void cameras_set_lens(struct bundle_camera *camera, enum rig_lens lens);

/* cameras_refine.c: bundle adjustment in rounds with outlier rejection. */
gboolean cameras_refine(struct cameras_work *work, GError **error);
/* Sets each camera's noise robustly, from all observations. */
void cameras_estimate_noise(struct bundle *bundle);
/* Length of the whitened residual, in standard deviations of the corner; ret_d: in pixels. */
double cameras_residual(const struct bundle *bundle, const struct bundle_observation *o,
                        double ret_d[2]);
int cameras_n_parameters(const struct cameras_work *work);
/* The RMS in pixels that the noise of the corners leaves after the fit. camera −1: of all. 0: not
 * known, for photographs, whose noise compression and sharpening have changed. */
double cameras_expected_px(const struct cameras_work *work, int camera);

/* cameras.c: one bundle adjustment with the corners found so far. */
gboolean cameras_solve(struct cameras_work *work, GError **error);

/* cameras_mistakes.c: if the boards do not fit as noted, but do with one mistake, sets the error to
 * that mistake. fitted: the first fit has not failed. FALSE: the work is as it was. */
gboolean cameras_find_mistake(struct cameras_work *work, gboolean started, GError **error);
/* Refuses cameras that stand at each other's places. */
gboolean cameras_check_places(const struct cameras_work *work, GError **error);

/* cameras_check.c: refuses results that cannot be right. */
gboolean cameras_check_pictures(const struct cameras_work *work, GError **error);
/* Whether a stop of the camera arm has no pictures and gets its pose from the arm's axis, which two
 * other stops of the camera determine. */
gboolean cameras_is_predicted(const struct cameras_work *work, int camera);
gboolean cameras_check_motion(const struct cameras_work *work, GError **error);
/* Uses only cameras in whose pictures the detector found the board. */
gboolean cameras_check_start(const struct cameras_work *work, GError **error);
/* Refuses a result that most pictures contradict. */
gboolean cameras_check_majority(const struct cameras_work *work, GError **error);
gboolean cameras_check_result(const struct cameras_work *work, GError **error);
double cameras_tilt_rad(const struct bundle_lay *lay);
int cameras_pictures_of(const struct cameras_work *work, int camera);
