/*
 * How bright a camera sees what a lamp lights: flat field, response and colour of each camera,
 * intensity, fall-off and colour of each lamp, found together from pictures of a white tile.
 *
 * A pixel at (x, y) of colour k behind which a matt surface of reflectance ρ_k lies shows
 *   response·camera.colour[k]·flat(x, y) · ρ_k/π · E·cos θ·lamp.colour[k]   DN a second
 * with E of rig_lamp_irradiance(). The tile tells products of a camera's and a lamp's factors only:
 * the cameras' responses keep their nominal geometric mean, in each colour, and the lamps have the
 * rest. A lamp's intensity is its mean over the tile's shots: each has an output of its own, so
 * that drift while the tile was taken spoils nothing.
 *
 * Pure functions over plain data: any thread.
 */
#pragma once

#include "geometry/rig.h"

#define RADIOMETRY_FLAT 9

struct radiometry_camera { /* with rig.cameras */
    gboolean known;
    double colour[3];             /* response behind R, G, B filters, of rig_camera.response */
    double flat[RADIOMETRY_FLAT]; /* of ln(flat): r², r⁴, r⁶, x, y, xy, x²−y², xr², yr²; x, y from
                                     the picture's middle, in half its diagonal */
    double response_error; /* standard errors: of ln(response), and of those above */
    double colour_error[3], flat_error[RADIOMETRY_FLAT];
    int cells;
};

struct radiometry_lamp { /* with rig.lamps */
    gboolean known;
    double colour[3];       /* intensity as R, G, B filters see it, of rig_lamp.intensity */
    double intensity_error; /* of ln(intensity) */
    double exponent_error, aim_error_rad, colour_error[3];
    int shots;
};

/* Of the response in the picture's middle, rig_camera.vignetting counted. NULL: that alone. */
double radiometry_flat(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                       double x_px, double y_px);

/* A matt white tile that lies in the middle of the turntable. */
struct tile {
    double width_mm, height_mm; /* along x and y of the sample frame */
    double top_mm;              /* above the turntable */
    double reflectance[3];      /* at the cameras' red, green, blue */
};

struct tile_shot {
    int lamp;
    double arc_rad, turntable_rad;
};

/* What the pixels of one colour show in one of some hundred cells of a picture. */
struct tile_cell {
    int shot, camera, colour;
    double basis[RADIOMETRY_FLAT]; /* of the flat field, mean of the pixels; as the next */
    struct vec3 point_mm;
    double signal;   /* DN a second */
    double error;    /* its standard error */
    double expected; /* by rig, with the tile's reflectance, nominal flat field and no colours */
};

/* Appends a picture's cells. mosaic: DN a millisecond above dark, height rows of width; cfa as in
 * frames/rectify.h. Returns how many; cells with pixels that are not finite are left out. */
int tile_measure(const struct rig *rig, int camera, const char *cfa, const float *mosaic,
                 const struct tile *tile, const struct tile_shot *shots, int shot, GArray *cells);

#define RADIOMETRY_ERROR radiometry_error_quark()
GQuark radiometry_error_quark(void);
enum radiometry_error {
    RADIOMETRY_ERROR_TOO_FEW,    /* pictures, arc angles, or white in them */
    RADIOMETRY_ERROR_DEGENERATE, /* cameras and lamps cannot be told apart */
    RADIOMETRY_ERROR_MISFIT,     /* the pictures are not of a matt white tile there */
};

struct tile_fit {
    struct radiometry_camera cameras[RIG_MAX_CAMERAS];
    struct radiometry_lamp lamps[RIG_MAX_LAMPS];
    double residual; /* RMS, relative */
    double quality;  /* chi-square a degree of freedom; 1 if the model and the noise are right */
    int degrees;     /* of freedom */
    int rejected;    /* cells */
    double *output;  /* of each shot's lamp, of its mean; g_free() */
    double *output_error;
};
void tile_fit_clear(struct tile_fit *fit);

/* Fits all, and sets response in rig's cameras, intensity, exponent and aim in its lamps. Geometry
 * is taken to be right. Every lamp must be seen at two arc angles or more that are 30° apart. */
gboolean tile_fit(struct rig *rig, const struct tile_shot *shots, int n_shots,
                  const struct tile_cell *cells, int n_cells, struct tile_fit *ret, GError **error);
