/*
 * Radiometric calibration: flat field, response and colour of each camera, and intensity,
 * fall-off and colour of each lamp, estimated together from pictures of a white tile.
 *
 * A pixel at (x, y) with colour filter k that sees a matt surface of reflectance ρ_k has the
 * signal
 *   response·camera.colour[k]·flat(x, y) · ρ_k/π · E·cos θ·lamp.colour[k]   DN per second
 * with E of rig_lamp_irradiance(). The tile determines only products of factors of a camera and a
 * lamp: the geometric mean of the cameras' responses stays nominal in each colour. A lamp's
 * intensity is its mean over the tile's shots: each shot has an output of its own, so that drift
 * during the capture does no harm.
 *
 * Pure functions over plain data: any thread.
 */
#pragma once

#include "geometry/rig.h"

#define RADIOMETRY_SMOOTH 9  /* terms of the flat field that a lens has */
#define RADIOMETRY_FLAT   11 /* with the steps between the halves of a sensor */

struct radiometry_camera { /* with rig.cameras */
    gboolean known;
    double colour[3]; /* response behind R, G, B filters, relative to rig_camera.response */
    double flat[RADIOMETRY_FLAT]; /* of ln(flat): r², r⁴, r⁶, x, y, xy, x²−y², xr², yr²; x, y from
                                     the picture's middle, in half its diagonal; and how much
                                     brighter the right half reads than the left, and the lower
                                     one than the upper: they may have amplifiers of their own */
    double response_error; /* standard errors: of ln(response), and of the factors above */
    double colour_error[3], flat_error[RADIOMETRY_FLAT];
    double glare, glare_error; /* veiling glare: light that is added everywhere, as a share of the
                                  mean light behind the same filter; error 0: not known */
    double excess; /* RMS of the tile's residuals that noise does not explain, relative */
    int cells;
};

struct radiometry_lamp { /* with rig.lamps */
    gboolean known;
    double colour[3];       /* intensity behind R, G, B filters, relative to rig_lamp.intensity */
    double intensity_error; /* of ln(intensity) */
    double exponent_error, aim_error_rad, colour_error[3];
    /* Standard deviations, relative, without the errors of their measurement: of the output from
     * one shot to the next, and among the pictures of different cameras in a shot. */
    double flicker, frame_flicker;
    int shots;
};

/* Response at a pixel relative to the picture's centre, including rig_camera.vignetting.
 * radiometry NULL: vignetting only. */
double radiometry_flat(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                       double x_px, double y_px);

/* Computes the veiling glare of a picture behind each filter: glare / (1 + glare) times the mean of
 * the finite pixels there. mosaic is as in frames/rectify.h, in any unit. A picture with the cfa
 * "rgb" is given one plane at a time, with "mono". ret_mean has the means of red, green and blue
 * pixels with the glare; both are 0 for a colour without pixels. */
void radiometry_glare(const struct radiometry_camera *radiometry, const char *cfa, int width,
                      int height, const float *mosaic, double ret_mean[3], float ret_glare[3]);

/* Colour behind the filter of a pixel: 0 red, 1 green (all of "mono"), 2 blue; cfa as in
 * frames/rectify.h. */
int radiometry_colour_at(const char *cfa, int x, int y);

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

/* Mean over the pixels of one colour in one of about a hundred cells of a picture. */
struct tile_cell {
    int shot, camera, colour;
    double basis[RADIOMETRY_FLAT]; /* basis functions of the flat field, mean over the pixels */
    struct vec3 point_mm;
    double signal;   /* DN per second */
    double error;    /* its standard error */
    double expected; /* prediction of the nominal rig, with the tile's reflectance */
    double mean;     /* of all pixels of this colour in the picture, DN per second */
};

/* Appends a picture's cells. mosaic: height × width, DN per ms above dark; cfa as in
 * frames/rectify.h. Returns their number; cells with pixels that are not finite are left out. */
int tile_measure(const struct rig *rig, int camera, const char *cfa, const float *mosaic,
                 const struct tile *tile, const struct tile_shot *shots, int shot, GArray *cells);

/* Mean over the pixels of one colour in a cell of a picture that shows what is dark around the
 * tile. */
struct glare_cell {
    int shot, camera, colour, cell; /* cell: index in the picture */
    double signal, error, mean;     /* as of struct tile_cell */
    double white;                   /* what a white surface there would show */
};

/* Appends (struct glare_cell) the cells that see no tile. rig and radiometry (of the camera and the
 * lamps) are those that were found from the tile; output: of the shot's lamp. */
int glare_measure(const struct rig *rig, int camera, const struct radiometry_camera *radiometry,
                  const struct radiometry_lamp *lamps, const char *cfa, const float *mosaic,
                  const struct tile *tile, const struct tile_shot *shots, int shot, double output,
                  GArray *cells);

/* The veiling glare of a camera from the n cells, of which it sorts those of this camera to the
 * front. A cell's dark surface of unknown reflectance shows more where a lamp is nearer to it, and
 * glare does not; so both are known. FALSE: nothing is dark enough, or the glare is not known to
 * 0.2 %. ret_glare is then 0. If there is plainly some glare, ret_error is its size and its error
 * together, otherwise 0. */
gboolean glare_fit(struct glare_cell *cells, int n, int camera, const struct tile_shot *shots,
                   double *ret_glare, double *ret_error);

#define RADIOMETRY_ERROR radiometry_error_quark()
GQuark radiometry_error_quark(void);
enum radiometry_error {
    RADIOMETRY_ERROR_TOO_FEW,    /* too few pictures, arc angles, or pixels of the tile */
    RADIOMETRY_ERROR_DEGENERATE, /* cameras and lamps cannot be separated */
    RADIOMETRY_ERROR_MISFIT,     /* the pictures do not show a matt white tile there */
};

struct tile_fit {
    struct radiometry_camera cameras[RIG_MAX_CAMERAS];
    struct radiometry_lamp lamps[RIG_MAX_LAMPS];
    double residual; /* RMS, relative */
    double expected; /* what the noise of the cells explains of it */
    /* RMS over the lamps of what was found minus what is nominal: the exponent, and the aim. */
    double exponent_off, aim_off_rad;
    double quality; /* χ² per degree of freedom; 1 if model and noise are right */
    int degrees;    /* degrees of freedom */
    int rejected;   /* number of rejected cells */
    double *output; /* of each shot's lamp, relative to that lamp's mean; g_free() */
    double *output_error;
};
void tile_fit_clear(struct tile_fit *fit);

/* Fits all parameters and sets response in rig's cameras, and intensity, exponent and aim in its
 * lamps. The geometry is taken as correct. Every lamp must be used at two arc angles or more that
 * are 30° apart; or the arc never turns, and there are lamps on sides that are 30° apart. */
gboolean tile_fit(struct rig *rig, const struct tile_shot *shots, int n_shots,
                  const struct tile_cell *cells, int n_cells, struct tile_fit *ret, GError **error);
