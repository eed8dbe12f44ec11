/*
 * A material whose reflectance is a formula, as measured by cameras and lamps about half a metre
 * away. Makes sessions with a BTF in which each texel has different directions, which are computed
 * independently here.
 */
#pragma once

#include "exr/exr.h"
#include "pipeline/near_field_correction.h"
#include "remove_tree.h"

#include <math.h>
#include <string.h>

#define DEGREE    (G_PI / 180)
#define SIDE      4
#define SIDE_MM   50.0
#define CAMERA_MM 650.0
#define LAMP_MM   500.0
#define LEVEL_MM  5.0
#define ALL       (SIDE * SIDE)

extern char *near_folder; /* the folder in which sessions are made */

struct rings {
    int n;
    float theta[128], phi[128];
};

void near_field_add_ring(struct rings *rings, double theta, int n, double offset);
struct rings near_field_twelve(double offset);
void near_field_direction(double theta_deg, double phi_deg, double ret[3]);
void near_field_texel_centre(int texel, double ret[3]);

/* Computes the unit vector from the point `from` towards the point `at`. */
void near_field_towards(const double at[3], const double from[3], double ret[3]);

/* Computes positions of cameras and lamps. The lamps have different distances, and slightly
 * different positions for each view, as on an arc whose axis is tilted. */
void near_field_camera_at(const struct rings *views, int view, double ret[3]);
void near_field_lamp_at(const struct rings *lights, int view, int light, double ret[3]);

/* Computes the reflectance times n·l of a diffuser with a broad gloss. The gloss is 0.8 exp(−(tan
 * θ_h / width)²), where θ_h is the angle from the normal to the half vector. If width is 0, there
 * is no gloss. */
double near_field_formula(const double view[3], const double light[3], double width, int colour);

struct wish { /* properties of a session */
    double width;
    gboolean nowhere; /* leave out the positions of cameras and lamps */
    gboolean (*spoil)(struct exr_part *part, int view, int light);
};

/* Makes a session with the products that processing would have written. */
char *near_field_make_session(const char *name, const struct rings *views,
                              const struct rings *lights, const struct wish *wish);

static const struct work quiet = {.n_threads = 2};

char *near_field_resample(const char *session, const char *name, const struct btf_directions *to,
                          struct near_field_correction_result *ret);
struct exr_file *near_field_read_view(const char *session, int view);
