/* The inside of cameras_*.c: what is known of pictures, corners and the geometry being found. */
#pragma once

#include "board_find.h"
#include "bundle.h"
#include "cameras.h"

#define CAMERAS_ROUNDS 4

struct seen { /* a picture */
    char *name, *checksum;
    int camera, lay, stop;
    GArray *corners;   /* struct corner; NULL: not found or set aside, and then */
    GArray *set_aside; /* the corners of a picture that contradicts the others */
    char *why;
};

struct cameras_work {
    struct calibration *calibration;
    const struct cameras_task *task;
    struct rig nominal;
    struct seen *seen;
    struct bundle bundle;
    GArray *observations; /* struct bundle_observation, of bundle */
    GArray *observed_in;  /* int: the picture of each */
    gboolean free_boards;
    int steps, step;
};

gboolean cameras_refuse(GError **error, enum cameras_error code, const char *format, ...)
    G_GNUC_PRINTF(3, 4);

/* One step more of those to be told. */
gboolean cameras_progress(struct cameras_work *work, GError **error);
void cameras_take_camera(struct rig_camera *to, const struct bundle_camera *from);

/* cameras_start.c: cameras from the rig file, lays from what is seen. */
void cameras_start(struct cameras_work *work);
gboolean cameras_start_lens(struct cameras_work *work, GError **error);
gboolean cameras_start_lays(struct cameras_work *work, GError **error);
gboolean cameras_start_lay(struct cameras_work *work, int lay);
void cameras_set_observations(struct cameras_work *work);
double cameras_median(GArray *values); /* double; sorts them */

/* cameras_refine.c: everything at once, and what agrees with it. */
gboolean cameras_refine(struct cameras_work *work, GError **error);
/* In units of the corner's deviation as it was measured; ret_d in pixels. */
double cameras_residual(const struct bundle *bundle, const struct bundle_observation *o,
                        double ret_d[2]);
int cameras_n_parameters(const struct cameras_work *work);

/* cameras_check.c: what makes a result worthless, told in words. */
gboolean cameras_check_pictures(const struct cameras_work *work, GError **error);
gboolean cameras_check_motion(const struct cameras_work *work, GError **error);
/* By the cameras that found the board by themselves. */
gboolean cameras_check_start(const struct cameras_work *work, GError **error);
/* Whether most pictures agree. */
gboolean cameras_check_majority(const struct cameras_work *work, GError **error);
gboolean cameras_check_result(const struct cameras_work *work, GError **error);
double cameras_tilt_rad(const struct bundle_lay *lay);
int cameras_pictures_of(const struct cameras_work *work, int camera);
