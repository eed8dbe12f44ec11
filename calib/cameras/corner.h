/*
 * This module finds the subpixel position of a board's corner. Two crossing straight edges, blurred
 * by lens and pixels, are fitted to the grey values around the corner. Other print (markers,
 * neighbouring corners) is excluded with the known geometry of the board. Boards may therefore be
 * seen at up to 75° from their normal, where a square is a few pixels high.
 *
 * The model includes a gradient of light. The model looks the same after half a turn about the
 * corner, and so do straight edges with a symmetric blur. A symmetric blur therefore does not shift
 * the corner that is found.
 *
 * For a marker that touches no black square, the corner is the end of two edges (one of the four
 * quadrants is black). For a circle, an ellipse with a blurred edge is fitted (circle.c).
 * Perspective shifts the centre of the ellipse away from the image of the circle's centre; struct
 * corner_guess predicts this shift.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include "board.h"
#include "pictures/picture.h"

struct corner_guess {
    double x_px, y_px;
    /* derivative of the picture's x, y (rows) with respect to the board's x, y (columns) */
    double px_a_mm[2][2];
    /* Only for circles: centre of the seen ellipse minus the image of the circle's centre. */
    double off_centre_px[2];
    /* Straightens edges that lens distortion has bent. With x, y of a pixel relative to the guess,
     * straighten[0] · (x², xy, y²) is added to x and straighten[1] · (x², xy, y²) to y. If all
     * values are 0, the edges are straight already. */
    double straighten[2][3];
};

struct corner {
    int id; /* as in board.h */
    double x_px, y_px;
    double covariance_px2[2][2]; /* covariance of x_px and y_px, from the noise of the residuals */
    /* standard deviation of the blur, including the pixel's own width */
    double blur_px;
    /* half the difference between white and black, in units of the picture */
    double contrast;
};

#define CORNER_MAX_BLUR_PX  4
#define CORNER_MAX_ERROR_PX 0.35
#define CORNER_MIN_CONTRAST 3    /* smallest contrast, in standard deviations of the residuals */
#define CORNER_MAX_MOVED    0.35 /* largest distance from the guess, in squares */

/* Fits one corner. Returns FALSE if there is no such corner near the guess, or if too little of it
 * is visible. */
gboolean corner_fit(const struct picture *picture, const struct board *board, int id,
                    const struct corner_guess *guess, struct corner *ret);

/* Fits all corners of a board. guesses has one entry per id; entries whose px_a_mm is 0 are left
 * out. Returns a GArray of struct corner, ordered by id. */
GArray *corner_fit_all(const struct picture *picture, const struct board *board,
                       const struct corner_guess *guesses);

/* Describes how much more a lens magnifies red [0] and blue [1] light than green, about a point of
 * the picture. */
struct corner_lateral {
    double centre_px[2];
    /* the present estimate, for red and blue: magnification divided by that of green, minus 1 */
    double larger[2];
    /* sums of the normal equations: normal · (change of the estimate) = right */
    double normal[2][2], right[2];
};

/* Adds the equations of one corner of a picture from a sensor with a colour filter. They are
 * weighted by the noise of the corner's residuals. Only the displacement of red and blue edges is
 * used; levels, contrasts and blurs of the colours may differ. Returns FALSE if the corner cannot
 * be fitted, if it has too few red or blue pixels, or if it is a circle. */
gboolean corner_lateral(const struct picture *picture, const struct board *board, int id,
                        const struct corner_guess *guess, struct corner_lateral *lateral);

/* Finds the centre of a circle in the same way as corner_fit() finds a corner. */
gboolean circle_fit(const struct picture *picture, const struct board *board, int id,
                    const struct corner_guess *guess, struct corner *ret);
