/*
 * The radiometric calibration uses pictures of a white tile. It estimates the flat field, response
 * and colour of each camera together with the intensity, fall-off and colour of each lamp.
 *
 * A pixel at (x, y) with colour filter k that sees a matt surface of reflectance ρ_k has the signal
 *   response·camera.colour[k]·flat(x, y) · ρ_k/π · E·cos θ·lamp.colour[k]   DN per second,
 * where E is that of rig_lamp_irradiance() and θ is the angle of incidence.
 *
 * The tile determines only products of a factor of a camera and a factor of a lamp. The geometric
 * mean of the cameras' responses therefore keeps its nominal value in each colour. A lamp's
 * intensity is its mean over the tile's shots. The output of each shot is a separate unknown, so
 * that drift during the capture does no harm.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include "geometry/rig.h"

#define RADIOMETRY_SMOOTH 9 /* number of terms of a lens's flat field */
/* number of terms including the two steps between the halves of a sensor */
#define RADIOMETRY_FLAT 11

/* The radiometry of the camera in rig.cameras with the same index. */
struct radiometry_camera {
    gboolean known;
    double colour[3]; /* response behind R, G, B filters, relative to rig_camera.response */
    /* Coefficients of ln(flat) for r², r⁴, r⁶, x, y, xy, x²−y², xr² and yr². The origin of x and y
     * is the picture's middle, and their unit is half of the picture's diagonal; r² = x² + y². The
     * last two coefficients are the steps from the left to the right half and from the upper to the
     * lower half. There may be steps because the halves of a sensor may have separate
     * amplifiers. */
    double flat[RADIOMETRY_FLAT];
    double response_error;                               /* standard error of ln(response) */
    double colour_error[3], flat_error[RADIOMETRY_FLAT]; /* standard errors */
    /* Veiling glare is light that lens and sensor scatter over the whole picture. `glare` is the
     * veiling glare divided by the mean light behind the same filter, and glare_error is the
     * standard error of `glare`. If the glare is not known, `glare` is 0, and glare_error is 0 or
     * the *ret_error of glare_fit(). */
    double glare, glare_error;
    /* The tile has residuals that noise does not explain. This is their relative RMS. */
    double excess;
    /* number of cells of the tile that were used */
    int cells;
};

/* The radiometry of the lamp in rig.lamps with the same index. */
struct radiometry_lamp {
    gboolean known;
    double colour[3];       /* intensity behind R, G, B filters, relative to rig_lamp.intensity */
    double intensity_error; /* standard error of ln(intensity) */
    double exponent_error, aim_error_rad, colour_error[3];
    /* Relative standard deviations of the lamp's output, without measurement errors. `flicker` is
     * that from one shot to the next. frame_flicker is that between the pictures of different
     * cameras in one shot. */
    double flicker, frame_flicker;
    /* number of shots of the tile under this lamp */
    int shots;
};

/* Returns the response at a pixel relative to the picture's centre, including
 * rig_camera.vignetting. If radiometry is NULL or not known, only the vignetting counts. */
double radiometry_flat(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                       double x_px, double y_px);

/* Computes the veiling glare of a picture behind each filter: glare / (1 + glare) times the mean of
 * the finite pixels there. ret_mean gets the means of red, green and blue pixels, including the
 * glare. ret_mean and ret_glare are 0 for a colour without pixels.
 *
 * mosaic is as in frames/rectify.h, in any unit. For a picture with the cfa "rgb", call this
 * function once for each plane, with the cfa "mono". */
void radiometry_glare(const struct radiometry_camera *radiometry, const char *cfa, int width,
                      int height, const float *mosaic, double ret_mean[3], float ret_glare[3]);

/* Returns the colour of a pixel's filter: 0 for red, 1 for green and for all pixels of "mono", 2
 * for blue. cfa is as in frames/rectify.h. */
int radiometry_colour_at(const char *cfa, int x, int y);

/* A matt white tile that lies in the middle of the turntable. */
struct tile {
    double width_mm, height_mm; /* size along x and y of the sample frame */
    double top_mm;              /* height of the top above the turntable */
    double reflectance[3];      /* for the cameras' red, green and blue */
};

struct tile_shot {
    int lamp;
    double arc_rad, turntable_rad;
};

/* The mean over the pixels of one colour in a cell. A picture has about a hundred cells. */
struct tile_cell {
    int shot, camera, colour;
    double basis[RADIOMETRY_FLAT]; /* means of the flat field's basis functions over the pixels */
    struct vec3 point_mm;          /* mean point of the tile that the pixels see, rig frame */
    double signal;                 /* DN per second */
    double error;                  /* standard error of signal */
    double expected;               /* prediction of the nominal rig for the tile's reflectance */
    double mean; /* mean of all pixels of this colour in the picture, DN per second */
};

/* Appends a picture's cells and returns their number. mosaic is height × width, in DN per ms above
 * dark. cfa is as in frames/rectify.h. Cells with too few pixels, or with pixels that are not
 * finite, are left out. */
int tile_measure(const struct rig *rig, int camera, const char *cfa, const float *mosaic,
                 const struct tile *tile, const struct tile_shot *shots, int shot, GArray *cells);

/* The mean over the pixels of one colour in a cell of the surround of the tile. */
struct glare_cell {
    int shot, camera, colour, cell; /* cell is the index in the picture */
    double signal, error, mean;     /* as in struct tile_cell */
    double white;                   /* expected signal of a white surface at that place */
};

/* Appends a struct glare_cell for each cell and colour with enough pixels outside the tile and a
 * border around it. Returns the number of appended cells. rig and the radiometry of the camera and
 * of the lamps are the results of tile_fit(). output is the output of the shot's lamp. */
int glare_measure(const struct rig *rig, int camera, const struct radiometry_camera *radiometry,
                  const struct radiometry_lamp *lamps, const char *cfa, const float *mosaic,
                  const struct tile *tile, const struct tile_shot *shots, int shot, double output,
                  GArray *cells);

/* Finds the veiling glare of a camera from its cells among the n cells. The function sorts `cells`:
 * those of this camera come first. The dark surface in a cell has an unknown reflectance. The
 * signal of the surface depends on the distance of the lamp, while glare does not, so the two can
 * be separated.
 *
 * On success, *ret_error is the standard error of the glare. Returns FALSE, with *ret_glare 0, in
 * three cases:
 * - no cell is dark enough,
 * - the glare found is brighter than the darkest cells,
 * - the standard error of the glare is 0.2 % or more.
 *
 * After FALSE, *ret_error is 0, with one exception: in the third case, if the glare found is more
 * than three times its standard error, *ret_error is √(glare² + standard error²). */
gboolean glare_fit(struct glare_cell *cells, int n, int camera, const struct tile_shot *shots,
                   double *ret_glare, double *ret_error);

#define RADIOMETRY_ERROR radiometry_error_quark()
GQuark radiometry_error_quark(void);
enum radiometry_error {
    RADIOMETRY_ERROR_TOO_FEW,    /* there are too few pictures, arc angles, or pixels of the tile */
    RADIOMETRY_ERROR_DEGENERATE, /* the effects of cameras and lamps cannot be separated */
    RADIOMETRY_ERROR_MISFIT,     /* the pictures do not show a matt white tile at its place */
};

struct tile_fit {
    struct radiometry_camera cameras[RIG_MAX_CAMERAS];
    struct radiometry_lamp lamps[RIG_MAX_LAMPS];
    double residual; /* relative RMS of the residuals */
    double expected; /* relative RMS of the residuals that the noise of the cells explains */
    /* RMS over the lamps. exponent_off is that of the difference between the found and the nominal
     * exponent. aim_off_rad is that of the angle between the found and the nominal aim. */
    double exponent_off, aim_off_rad;
    double quality; /* χ² per degree of freedom; 1 if model and noise are right */
    int degrees;    /* degrees of freedom */
    int rejected;   /* number of rejected cells */
    /* Output of each shot's lamp relative to the mean output of that lamp, and the standard error
     * of the output. */
    double *output;
    double *output_error;
};
void tile_fit_clear(struct tile_fit *fit);

/* Fits all parameters. Sets the response of the rig's cameras, and the intensity, exponent and aim
 * of its lamps. The geometry is taken as correct. Call tile_fit_clear() after success. Returns
 * FALSE with an error if the result is refused; rig is then not changed.
 *
 * The error is RADIOMETRY_ERROR_TOO_FEW if the shots light the tile from one side only:
 * - If the arc turns between the shots, each lamp on the arc that has shots must have a shot whose
 *   arc angle differs by 30° or more from that of its first shot.
 * - If the arc does not turn, a shot must light the tile from an azimuth that differs by 30° or
 *   more from that of the first shot. */
gboolean tile_fit(struct rig *rig, const struct tile_shot *shots, int n_shots,
                  const struct tile_cell *cells, int n_cells, struct tile_fit *ret, GError **error);
