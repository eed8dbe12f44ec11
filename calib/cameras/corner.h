/*
 * Where exactly a board's corner lies in a picture: two straight edges that cross, blurred by lens
 * and pixels, are fitted to the pixels around it. What is printed elsewhere (markers, the next
 * corners) is left out by the board's own geometry, so that boards may be seen at 75° from their
 * normal, where a square is a few pixels high. The model is point-symmetric about the corner:
 * straight edges and an even blur do not shift it, and a gradient of light is part of it.
 *
 * Pure functions; any thread.
 */
#pragma once

#include "board.h"
#include "pictures/picture.h"

struct corner_guess {
    double x_px, y_px;
    double px_a_mm[2][2]; /* derivative of the picture's x, y by the board's x, y */
    /* What makes edges straight that a lens has bent: x² xy y² of the distance from here are to be
     * added to x and to y times these. 0: edges are straight. */
    double straighten[2][3];
};

struct corner {
    int id; /* board.h */
    double x_px, y_px;
    double covariance_px2[2][2]; /* from the noise that is seen */
    double blur_px;              /* standard deviation, the pixel's own width included */
    double contrast; /* half the step between black and white, in units of the picture */
};

/* FALSE: there is no such corner near the guess, or too little of it is to be seen. */
gboolean corner_fit(const struct picture *picture, const struct board *board, int id,
                    const struct corner_guess *guess, struct corner *ret);

/* All corners of a board that can be fitted: guesses[id]; those with px_a_mm of zeroes are left
 * out. GArray of struct corner, by id. */
GArray *corner_fit_all(const struct picture *picture, const struct board *board,
                       const struct corner_guess *guesses);
