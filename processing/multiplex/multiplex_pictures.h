/* Pictures of a group of lamps, as patterns of them are taken, until the group is complete. One
 * thread at a time. */
#pragma once

#include "multiplex.h"

struct multiplex_pictures { /* all 0: empty */
    int group, n, count;    /* whose, of how many patterns, and how many are here */
    gsize n_pixels;
    float *pictures[MULTIPLEX_MOST]; /* linear values above dark, by pattern */
    float *bound;     /* 1 for pixels that are saturated in any pattern, else 0; NULL: none is */
    gint64 saturated; /* how many */
};

/* Takes the picture of pattern k of a group; k = 0 begins another group. FALSE: it does not follow
 * what is here, and all is forgotten. */
gboolean multiplex_pictures_add(struct multiplex_pictures *to, int group, int n, int k,
                                float *picture, gsize n_pixels);

/* Marks pixels (1; others 0) that are saturated in the last pattern. */
void multiplex_pictures_mark(struct multiplex_pictures *to, const float *marked);

gboolean multiplex_pictures_complete(const struct multiplex_pictures *pictures);

/* Whether a lamp has changed while the patterns of a complete group were taken, before they are
 * solved. seen: a picture, taken after them, of the lamps that pattern n − 1 leaves out; in which
 * values from most on are saturated. With that pattern it shows all lamps, which is
 * 2/(n + 1) of the sum of all patterns; a lamp that went out after its first pattern is missing in
 * more of one than of the other. TRUE if the means differ by more than their noise and 0.5 % of all
 * light, and by least. */
gboolean multiplex_pictures_changed(const struct multiplex_pictures *pictures, const float *seen,
                                    double most, double least);

/* Mean of a picture's values. */
double multiplex_pictures_mean(const struct multiplex_pictures *pictures, int k);

void multiplex_pictures_clear(struct multiplex_pictures *pictures);
