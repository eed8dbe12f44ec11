/*
 * A small session whose frames are computed by formulas. Lamp frames show a nearly white diffuser
 * in the reference plane, and laser frames a plane below it. The functions also process the session
 * and check its products.
 */
#pragma once

#include "base/data_error.h"
#include "pipeline/pipeline.h"

#include "analytic.h"
#include "calibration/calibration.h"
#include "exr/exr.h"
#include "remove_tree.h"

#include <math.h>
#include <string.h>

#define DEGREE (G_PI / 180)

enum { N_CAMERAS = 2, N_TURNS = 2, N_LIGHTS = 3, N_LASERS = 5, N_VIEWS = N_CAMERAS * N_TURNS };
enum { SIDE = 96, TEXELS = 16, N_STEPS = 80 };

static const struct session_grid grid = {TEXELS, TEXELS, 24, 24, 5, 5};
static const struct pinhole pinholes[N_CAMERAS] = {{SIDE, SIDE, 20 * DEGREE, 650, 1400},
                                                   {SIDE, SIDE, 50 * DEGREE, 650, 1400}};
static const struct line_laser laser = {45 * DEGREE, 480};
static const struct arc_lamp lamp = {35 * DEGREE, 500, 40};
static const double albedo[3] = {0.7, 0.5, 0.2};
static const double from_deg = -4, to_deg = 4, level_mm = 2.2;

struct fixture {
    char *folder, *path;
    struct session_shot shots[N_TURNS * (N_LIGHTS + N_LASERS)];
    int n_shots;
};

struct rig fixture_make_rig(void);
double fixture_turn_deg(int turn);

/* Computes the point at which the ray of a pixel meets the plane of this height, in the rig
 * frame. */
void hit(const struct pinhole *pinhole, int pixel, double height, double *ret);
struct exr_part *lamp_frame(const struct session_shot *shot, int camera);
struct session_frame fixture_write_frame(const struct fixture *fixture, struct exr_part *part,
                                         const struct session_shot *shot, int camera);
typedef void (*Spoil)(struct exr_part *part, const struct session_shot *shot);

/* Captures the shots first … last − 1, in planned order. */
void fixture_capture(struct fixture *fixture, int first, int last, Spoil spoil);
void fixture_set_value(const struct fixture *fixture, const char *key, const char *value);
void fixture_set_state(const struct fixture *fixture, const char *state);
struct pipeline_result fixture_process(const struct fixture *fixture, int n_threads,
                                       gboolean follow);
void fixture_process_fails(const struct fixture *fixture, int code, const char *says);
char *fixture_product(const struct fixture *fixture, const char *name);
void fixture_check_mdf_where_known(const struct fixture *fixture, gboolean everywhere);
void fixture_check_mdf(const struct fixture *fixture);

/* A test with this path. func is called with a new session. */
struct pipeline_test {
    const char *path;
    void (*func)(struct fixture *, gconstpointer);
};

int fixture_run_tests(int argc, char **argv, const struct pipeline_test *tests, guint n);
