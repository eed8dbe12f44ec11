/* Pictures of numbers for the command line: PNG, or SVG if the file's name says so. */
#pragma once

#include "codec/compare.h"

#include <cairo.h>

#define PLOT_WIDTH  1280
#define PLOT_HEIGHT 800

#define PLOT_TEXT 17.0 /* points */

/* Begins a picture: white ground, dark ink, text of size PLOT_TEXT. NULL with an error unless path
 * ends in .png or .svg. */
cairo_t *plot_new(const char *path, GError **error);
/* A larger line, from (x, y) on, and one below it (may be NULL). */
void plot_title(cairo_t *cr, double x, double y, const char *title, const char *text);
/* Writes the file and frees cr. */
gboolean plot_finish(cairo_t *cr, const char *path, GError **error);

void plot_ink(cairo_t *cr);
void plot_colour(cairo_t *cr,
                 int i); /* colours that the colour-blind can distinguish; i from 0, cyclic */
/* align: 0 left, 0.5 centred, 1 right of (x, y). */
void plot_text(cairo_t *cr, double x, double y, double align, const char *text);

/* Draws the errors of views and of lights on two hemispheres seen from above. */
gboolean plot_comparison(const char *path, const struct material_info *a,
                         const struct material_info *b, const struct comparison *comparison,
                         GError **error);

struct plot_point {
    char *series, *label; /* owned by whoever made it */
    double bytes, error;
};

/* Draws rate and distortion: error against size, both logarithmic. points: series by series, in
 * order of size; sizes are shown as ratios to raw_bytes, too. */
gboolean plot_curve(const char *path, const char *name, double raw_bytes,
                    const struct plot_point *points, int n, GError **error);

struct plot_time {
    int shots;
    double minutes, error_pct;
};

/* Draws the expected error against time, with the number of shots at each point, and a line at
 * the time at which all shots are taken (all_min). The error is logarithmic. points: in order of
 * time. */
gboolean plot_times(const char *path, const char *title, const char *text, double all_min,
                    const struct plot_time *points, int n, GError **error);
