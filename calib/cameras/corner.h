/*
 * Subpixel position of a board's corner: two crossing straight edges, blurred by lens and pixels,
 * are fitted to the grey values around it. Other print (markers, neighbouring corners) is
 * excluded by the board's geometry, so that boards may be seen at up to 75° from their normal,
 * where a square is a few pixels high. The model is point-symmetric about the corner: straight
 * edges and an even blur do not shift it, and it includes a gradient of light.
 *
 * For a marker that touches no black square, the corner is where two edges end (one of the four
 * quadrants is black). For a circle, an ellipse with a blurred edge is fitted (circle.c);
 * perspective shifts its centre from that of the circle.
 *
 * Pure functions; any thread.
 */
#pragma once

#include "board.h"
#include "pictures/picture.h"

struct corner_guess {
    double x_px, y_px;
    double px_a_mm[2]
                  [2]; /* derivative of the picture's x, y (rows) by the board's x, y (columns) */
    /* Circles only: centre of the seen ellipse minus the image of the circle's centre. */
    double off_centre_px[2];
    /* Straightens edges that lens distortion has bent: with x, y relative to the guess, x +=
     * straighten[0] · (x², xy, y²) and y += straighten[1] · (x², xy, y²). 0: edges are straight. */
    double straighten[2][3];
};

struct corner {
    int id; /* board.h */
    double x_px, y_px;
    double covariance_px2[2][2]; /* from the noise of the residuals */
    double blur_px;              /* standard deviation, including the pixel's own width */
    double contrast; /* half the step between black and white, in units of the picture */
};

#define CORNER_MAX_BLUR_PX  4
#define CORNER_MAX_ERROR_PX 0.35
#define CORNER_MIN_CONTRAST 3    /* in standard deviations of the residuals */
#define CORNER_MAX_MOVED    0.35 /* from the guess, in squares */

/* FALSE: there is no such corner near the guess, or too little of it is visible. */
gboolean corner_fit(const struct picture *picture, const struct board *board, int id,
                    const struct corner_guess *guess, struct corner *ret);

/* Fits all corners of a board. guesses: one per id; those with px_a_mm of zeroes are left out.
 * GArray of struct corner, by id. */
GArray *corner_fit_all(const struct picture *picture, const struct board *board,
                       const struct corner_guess *guesses);

/* By how much more a lens magnifies red [0] and blue [1] light than green, about a point of the
 * picture. */
struct corner_lateral {
    double centre_px[2];
    double larger[2];              /* the present estimate */
    double normal[2][2], right[2]; /* sums: normal · (change of the estimate) = right */
};

/* Adds the equations of one corner, weighed by the noise of its residuals, in a picture behind a
 * colour filter. The displacement of red and blue edges counts only: levels, contrasts and blurs of
 * the colours may differ. FALSE: the corner cannot be fitted, or has too few red or blue pixels, or
 * it is a circle. */
gboolean corner_lateral(const struct picture *picture, const struct board *board, int id,
                        const struct corner_guess *guess, struct corner_lateral *lateral);

/* corner_fit() of a circle's centre. */
gboolean circle_fit(const struct picture *picture, const struct board *board, int id,
                    const struct corner_guess *guess, struct corner *ret);
