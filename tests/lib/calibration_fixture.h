/*
 * A simulated rig with calibration boards, and the pictures that its cameras take of them, for
 * tests and measurements of calibration. The world has misalignments, which depend on its seed. The
 * rig with which calibration starts has none.
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
    double error_mm, error_deg; /* standard deviations of the cameras' poses */
    /* maximum position error of the turntable; the error is a fixed function of the angle */
    double turntable_error_deg;
    double blur_px;
    const char *board;
    double wobble_deg;     /* of the turntable's bearing */
    int wobble_turns;      /* number of periods per turn; 0 means 2 */
    double lateral_colour; /* of all lenses: red is magnified by 1 + this, blue by 1 − this */
};

/* One placement (“lay”) of the board on the turntable: its tilt and the azimuth towards which it is
 * tilted, its turn about its normal, and its shift. */
struct fixture_lay {
    double tilt_deg, towards_deg, turn_deg, x_mm, y_mm;
};

struct fixture {
    struct fixture_rig options;
    struct board board;
    struct rig nominal;
    World *worlds[16]; /* one for each lay */
    int n_lays, n_stops;
    struct cameras_picture *pictures;
    struct picture **taken;
    int n_pictures;
    char *folder;
};

/* Returns the true angle of the turntable, which has the errors of an eccentric bearing and of an
 * uneven scale, like a simulated axis. */
double boards_true_deg(const struct fixture *f, double deg);
void boards_open(struct fixture *f, const struct fixture_rig *options,
                 const struct fixture_lay *lays, int n_lays);

/* Takes pictures with all cameras at n_stops angles of the turntable for each lay. */
void boards_capture(struct fixture *f, int n_stops);
void boards_close(struct fixture *f);
struct picture *boards_copy(const struct picture *from);
/* Returns a copy of picture i. data is a struct fixture. The function has the type of the reader
 * that calibration calls for each picture. */
struct picture *boards_read(int i, gpointer data, GError **error);

/* Returns the RMS distance in pixels between the true and the calibrated projections of points of
 * the sample. The turntable is at angles at which no picture was taken. */
double boards_turned_px(const struct fixture *f, const struct calibration *calibration);

/* The errors of a calibration. */
struct fixture_errors {
    double point_px;      /* RMS over the sample's volume and all cameras */
    double direction_deg; /* worst camera, seen from the origin */
    double distance_pct;  /* worst camera */
    double axis_mm, axis_deg;
    /* squared Mahalanobis distance of the errors of focal length, principal point, rotation and
     * shift, per degree of freedom; mean of all cameras */
    double chi2;
};

/* Gives the true camera in the form of the calibration: rotation row by row, and shift. */
void boards_true_camera(const struct fixture *f, int camera, struct rig_camera *ret);

/* Returns the zero of the azimuth, which is a convention: the angle for which the calibrated
 * cameras fit their true positions best. */
double boards_azimuth_rad(const struct fixture *f, const struct rig *rig);
double boards_chi2(const struct fixture *f, const struct calibration *calibration, int camera,
                   double azimuth_rad);
struct fixture_errors boards_compare(const struct fixture *f,
                                     const struct calibration *calibration);
