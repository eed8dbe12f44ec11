/*
 * A simulated rig before calibration boards, and the pictures its cameras take of them: for tests
 * and measurements of calibration. The world's misalignments come from its seed; the rig that
 * calibration starts from has none.
 */
#pragma once

#include "cameras/board.h"
#include "cameras/cameras.h"
#include "world/truth.h"
#include "world/world.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define FIXTURE_DEG(rad) ((rad) * (180 / G_PI))
#define FIXTURE_RAD(deg) ((deg) * (G_PI / 180))

struct fixture_rig {
    int n_cameras, width, height;
    double focal_px, distance_mm, first_theta_deg, last_theta_deg;
    int seed, supersample;
    double error_mm, error_deg; /* standard deviations of where cameras stand */
    double turntable_error_deg; /* repeatable, a function of the angle */
    double blur_px;
    const char *board;
    double wobble_deg;     /* of the turntable's bearing; */
    int wobble_turns;      /* so many times a turn; 0: twice */
    double lateral_colour; /* of all lenses: red is magnified by 1 + this, blue by 1 − this */
};

struct fixture_lay {
    double tilt_deg, towards_deg, turn_deg, x_mm, y_mm;
};

struct fixture {
    struct fixture_rig options;
    struct board board;
    struct rig nominal;
    World *worlds[16]; /* one a lay */
    int n_lays, n_stops;
    struct cameras_picture *pictures;
    struct picture **taken;
    int n_pictures;
    char *folder;
};

/* An eccentric bearing and an uneven scale, as simulated axes have. */
double boards_true_deg(const struct fixture *f, double deg);
void boards_open(struct fixture *f, const struct fixture_rig *options,
                 const struct fixture_lay *lays, int n_lays);

/* All cameras at n_stops angles of each lay. */
void boards_capture(struct fixture *f, int n_stops);
void boards_close(struct fixture *f);
struct picture *boards_copy(const struct picture *from);
struct picture *boards_read(int i, gpointer data, GError **error);

/* RMS distance in pixels between where cameras truly see points of the sample at angles of the
 * turntable that no picture was taken at, and where the calibration says. */
double boards_turned_px(const struct fixture *f, const struct calibration *calibration);

/* How far a calibration is from the truth. */
struct fixture_errors {
    double point_px;      /* RMS over the sample's volume and all cameras */
    double direction_deg; /* worst camera, seen from the origin */
    double distance_pct;  /* worst camera */
    double axis_mm, axis_deg;
    double chi2; /* of focal length, middle, turn and shift, a degree of freedom; all cameras */
};

/* The true camera in calibration's own terms: rotation row by row and shift. */
void boards_true_camera(const struct fixture *f, int camera, struct rig_camera *ret);

/* The azimuth's zero is a matter of agreement: the one that fits the cameras' true places best. */
double boards_azimuth_rad(const struct fixture *f, const struct rig *rig);
double boards_chi2(const struct fixture *f, const struct calibration *calibration, int camera,
                   double azimuth_rad);
struct fixture_errors boards_compare(const struct fixture *f,
                                     const struct calibration *calibration);
