/* The files cameras_*.c share this state: pictures, corners, and the present geometry. */
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
    /* The corners that were found (struct corner). NULL if none were found, or if the picture was
     * rejected; `why` then has the reason. */
    GArray *corners;
    /* The corners of a picture that was rejected because it contradicts the others; otherwise
     * NULL. */
    GArray *set_aside;
    /* The text "picture: reason", which says why the picture is not used. It has no meaning while
     * `corners` is not NULL. */
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
    /* only a lens is calibrated, from photographs; each photograph is a lay */
    gboolean free_boards;
    double held_out_px[RIG_LENSES], inflation[RIG_MAX_CAMERAS]; /* cameras.h */
    /* as in rig.h and calibration.h */
    double lateral_colour[RIG_MAX_CAMERAS][3], lateral_error[RIG_MAX_CAMERAS][3];
    struct lateral *lateral; /* result of each picture; see cameras_lateral.c */
    int steps, step;         /* progress: number of all steps, and of those that are done */
    /* Typical residual of the first fit, if it is large and no known mistake explains it. Otherwise
     * 0. */
    double unexplained_px;
};

/* Advice of an error about two exchanged cameras; printf arguments: the names of both. */
#define CAMERAS_EXCHANGE_THEM                                                                      \
    "exchange the devices of [camera %s] and [camera %s] in the rig file, or for imported "        \
    "pictures their names in the table, and capture or import again"

gboolean cameras_refuse(GError **error, enum cameras_error code, const char *format, ...)
    G_GNUC_PRINTF(3, 4);

/* Sets the reason why a picture is not used. The name of the picture is put in front of it. */
void cameras_set_why(struct seen *seen, const char *why);
/* Reports one more step of progress. Returns FALSE with an error if the user cancels. */
gboolean cameras_progress(struct cameras_work *work, GError **error);
/* cameras_arm.c: fits the camera arm's axis to the stops with pictures. *ret_known says whether
 * enough stops have pictures. Returns FALSE if the stops do not turn about one axis, or if this
 * axis is not near the axis of the rig file. */
gboolean cameras_fit_arm(const struct cameras_work *work, gboolean *ret_known,
                         struct rig_swing_fit *ret, GError **error);
/* Copies the axis result->arm to the calibration, and places the stops without pictures according
 * to this axis. Sets result->predicted. */
void cameras_place_stops(const struct cameras_work *work, struct calibration *calibration,
                         struct cameras_result *result);
void cameras_take_camera(struct rig_camera *to, const struct bundle_camera *from);

/* cameras_start.c: initial values. cameras_start() takes those of the cameras from the rig file.
 * cameras_start_lens() estimates the focal length from photographs. cameras_start_lay() finds
 * the pose of one lay from the pictures, and cameras_start_lays() the poses of all lays. */
void cameras_start(struct cameras_work *work);
gboolean cameras_start_lens(struct cameras_work *work, GError **error);
gboolean cameras_start_lays(struct cameras_work *work, GError **error);
gboolean cameras_start_lay(struct cameras_work *work, int lay);
/* cameras_still.c, for a rig without a turntable: cameras_level() makes the flattest lay level, and
 * fixes it. cameras_align() turns and shifts the rig in the plane so that, on average, the cameras
 * see the plane where the nominal cameras see it. */
gboolean cameras_level(struct cameras_work *work, GError **error);
void cameras_align(struct cameras_work *work);
void cameras_set_observations(struct cameras_work *work);
double cameras_median(GArray *values); /* sorts the doubles; returns their median */

/* Does a step of the calibration for picture i. Returns FALSE with an error to end the pass over
 * all pictures. */
typedef gboolean (*CamerasPass)(struct cameras_work *work, int i, double reach_px, GError **error);
/* cameras.c: runs a pass over pictures in several threads, and returns the first error. reach_px
 * has the search radius of each picture; a negative value skips the picture. If reach_px is NULL,
 * the radius of every picture is 0. */
gboolean cameras_for_each(struct cameras_work *work, CamerasPass run, const double *reach_px,
                          GError **error);
/* The data of cameras_project(). */
struct cameras_look {
    const struct bundle *bundle;
    int camera, stop;
};
/* cameras.c: projects a point of the board into a camera at a stop. This is a BoardProject, whose
 * data is a struct cameras_look. */
gboolean cameras_project(const double xy_mm[2], gboolean straight, double ret_xy_px[2],
                         gconstpointer data);

/* cameras_lateral.c: finds the lateral colour of each lens. The geometry must be known. */
gboolean cameras_find_lateral(struct cameras_work *work, GError **error);

/* cameras_lens.c: chooses the lens model for photographs. */
gboolean cameras_choose_lens(struct cameras_work *work, GError **error);
void cameras_set_lens(struct bundle_camera *camera, enum rig_lens lens);

/* cameras_refine.c: makes the bundle adjustment in rounds with outlier rejection, and computes the
 * covariances. */
gboolean cameras_refine(struct cameras_work *work, GError **error);
/* Sets each camera's noise robustly, from all observations. */
void cameras_estimate_noise(struct bundle *bundle);
/* Returns the length of the whitened residual, in standard deviations of the corner. ret_d is the
 * residual in pixels. Returns G_MAXDOUBLE if bundle_project() refuses the point. */
double cameras_residual(const struct bundle *bundle, const struct bundle_observation *o,
                        double ret_d[2]);
int cameras_n_parameters(const struct cameras_work *work);
/* Returns the RMS residual in pixels that is expected after the fit from the noise of the corners
 * alone. If camera is −1, this is over all cameras. Returns 0 if no corners are used. Also returns
 * 0 for photographs, because compression and sharpening have changed their noise. */
double cameras_expected_px(const struct cameras_work *work, int camera);

/* cameras.c: makes one bundle adjustment with the corners found so far. */
gboolean cameras_solve(struct cameras_work *work, GError **error);

/* cameras_mistakes.c: looks for a mistake in the notes on the pictures. fitted says that the first
 * fit has succeeded. If the boards do not fit, but fit when one mistake is corrected, sets an error
 * that names the mistake and returns TRUE.
 *
 * If the residual is small, returns FALSE at once. If no mistake is found, repeats the fit without
 * a correction, sets unexplained_px (to 0 if fitted is FALSE), and returns FALSE. */
gboolean cameras_find_mistake(struct cameras_work *work, gboolean fitted, GError **error);
/* Returns FALSE with an error if a camera stands near the place that the rig file gives for another
 * camera. */
gboolean cameras_check_places(const struct cameras_work *work, GError **error);

/* cameras_check.c: returns FALSE with an error if a camera has too few pictures and is not
 * predicted (cameras_is_predicted()), if no board is tilted, or if no board lies flat. */
gboolean cameras_check_pictures(const struct cameras_work *work, GError **error);
/* Returns whether a stop of the camera arm has no pictures and gets its pose from the arm's axis,
 * which two other stops of the camera determine. */
gboolean cameras_is_predicted(const struct cameras_work *work, int camera);
gboolean cameras_check_motion(const struct cameras_work *work, GError **error);
/* Checks the first adjustment. Only cameras with enough pictures are checked. */
gboolean cameras_check_start(const struct cameras_work *work, GError **error);
/* Refuses a result that most pictures contradict. */
gboolean cameras_check_majority(const struct cameras_work *work, GError **error);
gboolean cameras_check_result(const struct cameras_work *work, GError **error);
double cameras_tilt_rad(const struct bundle_lay *lay);
int cameras_pictures_of(const struct cameras_work *work, int camera);
