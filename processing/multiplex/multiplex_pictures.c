#include "multiplex_pictures.h"

#include <math.h>

/* Difference of the means that is no fault of a lamp: of all light, and of its standard error. */
#define DRIFT_PART  0.005
#define MOST_ERRORS 5
#define NEARLY      0.9 /* of saturation: brighter pixels are not compared */

void multiplex_pictures_clear(struct multiplex_pictures *pictures) {
    for (int k = 0; k < MULTIPLEX_MOST; k++)
        g_free(pictures->pictures[k]);
    g_free(pictures->bound);
    *pictures = (struct multiplex_pictures){0};
}

gboolean multiplex_pictures_add(struct multiplex_pictures *to, int group, int n, int k,
                                float *picture, gsize n_pixels) {
    if (k == 0) {
        multiplex_pictures_clear(to);
        to->group = group;
        to->n = n;
        to->n_pixels = n_pixels;
    }
    if (group != to->group || n != to->n || k != to->count || n_pixels != to->n_pixels) {
        multiplex_pictures_clear(to);
        g_free(picture);
        return FALSE;
    }
    to->pictures[to->count++] = picture;
    return TRUE;
}

void multiplex_pictures_mark(struct multiplex_pictures *to, const float *marked) {
    if (!to->bound)
        to->bound = g_new0(float, to->n_pixels);
    for (gsize p = 0; p < to->n_pixels; p++) {
        to->saturated += marked[p] > to->bound[p];
        to->bound[p] = MAX(to->bound[p], marked[p]);
    }
}

gboolean multiplex_pictures_complete(const struct multiplex_pictures *pictures) {
    return pictures->n > 0 && pictures->count == pictures->n;
}

double multiplex_pictures_mean(const struct multiplex_pictures *pictures, int k) {
    double sum = 0;
    for (gsize p = 0; p < pictures->n_pixels; p++)
        sum += (double)pictures->pictures[k][p];
    return pictures->n_pixels > 0 ? sum / (double)pictures->n_pixels : 0;
}

gboolean multiplex_pictures_changed(const struct multiplex_pictures *pictures, const float *seen,
                                    double most, double least) {
    const int n = pictures->n;
    double change = 0, square = 0, all = 0;
    gsize count = 0;
    for (gsize p = 0; p < pictures->n_pixels; p++) {
        double sum = 0;
        for (int k = 0; k < n; k++)
            sum += (double)pictures->pictures[k][p];
        sum *= 2.0 / (n + 1);
        /* By what is expected, not seen: else noise would choose. */
        if (sum - (double)pictures->pictures[n - 1][p] >= NEARLY * most ||
            (pictures->bound && pictures->bound[p] > 0))
            continue;
        all += sum;
        const double missing = sum - (double)pictures->pictures[n - 1][p] - (double)seen[p];
        change += missing;
        square += missing * missing;
        count++;
    }
    const double error = sqrt(square); /* of the sum, if it is noise alone */
    return fabs(change) > MAX(DRIFT_PART * all, least * (double)count) + MOST_ERRORS * error;
}
