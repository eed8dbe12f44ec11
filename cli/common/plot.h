/* Plots for the command line: PNG, or SVG if the name of the file ends in .svg. */
#pragma once

#include "codecs/codec/compare.h"

#include <cairo.h>

#define PLOT_WIDTH  1280
#define PLOT_HEIGHT 800

#define PLOT_TEXT 17.0 /* size of text, in the unit of PLOT_WIDTH */

/* Begins a picture with a white background, dark ink and text of size PLOT_TEXT. path must end in
 * .png or .svg; otherwise returns NULL with an error. */
cairo_t *plot_new(const char *path, GError **error);
/* Draws a title that begins at (x, y), and below it a text of size PLOT_TEXT. text may be NULL. */
void plot_title(cairo_t *cr, double x, double y, const char *title, const char *text);
/* Writes the file and frees cr. Returns FALSE with an error if the file cannot be written. */
gboolean plot_finish(cairo_t *cr, const char *path, GError **error);

void plot_ink(cairo_t *cr);
void plot_colour(cairo_t *cr,
                 /* Sets the colour of series i, counted from 0. The colour-blind can distinguish
                  * the colours. They repeat after the last one. */
                 int i);
/* Draws a text that begins at x (align 0), is centred at x (0.5), or ends at x (1). y is the
 * position of its base line, downwards from the top. */
void plot_text(cairo_t *cr, double x, double y, double align, const char *text);

/* Draws the errors of views and of lights on two hemispheres seen from above. */
gboolean plot_comparison(const char *path, const struct material_info *a,
                         const struct material_info *b, const struct comparison *comparison,
                         GError **error);

struct plot_point {
    char *series, *label; /* owned by the caller */
    double bytes, error;
};

/* Draws the error against the size in bytes, both on logarithmic axes (rate and distortion). points
 * must be sorted by series and then by size. Sizes are also shown as ratios to raw_bytes. `text`
 * says what the error is. */
gboolean plot_curve(const char *path, const char *name, const char *text, double raw_bytes,
                    const struct plot_point *points, int n, GError **error);

struct plot_time {
    int shots;
    double minutes, error_pct;
};

/* Draws the expected error, on a logarithmic axis, against time. Each point shows its number of
 * shots. A line shows all_min, the time at which all shots are taken. points must be sorted by
 * time. */
gboolean plot_times(const char *path, const char *title, const char *text, double all_min,
                    const struct plot_time *points, int n, GError **error);
