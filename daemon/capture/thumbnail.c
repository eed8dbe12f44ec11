#include "thumbnail.h"

#include "base/srgb.h"

#include <math.h>

/* Computes the mean of each colour above black over the square of side × side pixels at (x0, y0). A
 * monochrome frame gives three equal values. */
static void merge_square(const Frame *frame, int x0, int y0, int side, float rgb[3]) {
    double sum[3] = {0};
    int n[3] = {0};
    for (int y = y0; y < MIN(y0 + side, frame->height); y++) {
        for (int x = x0; x < MIN(x0 + side, frame->width); x++) {
            enum cfa_colour colour = cfa_colour_at(frame->cfa, x, y);
            sum[colour] += frame->pixels[(gsize)y * frame->width + x] - frame->black_level;
            n[colour]++;
        }
    }
    for (int c = 0; c < 3; c++) {
        int from = frame->cfa == CFA_MONO ? CFA_GREEN : c;
        rgb[c] = n[from] > 0 ? (float)(sum[from] / n[from]) : 0;
    }
}

/* Returns the value that would have index k if the n values were sorted (quickselect). Changes the
 * order of the values. */
static float select_value(float *values, gsize n, gsize k) {
    gssize low = 0, high = (gssize)n - 1, at = (gssize)k;
    while (low < high) {
        float middle = values[low + (high - low) / 2];
        gssize i = low, j = high;
        while (i <= j) {
            while (values[i] < middle)
                i++;
            while (values[j] > middle)
                j--;
            if (i <= j) {
                float kept = values[i];
                values[i++] = values[j];
                values[j--] = kept;
            }
        }
        if (at <= j)
            high = j;
        else if (at >= i)
            low = i;
        else
            break;
    }
    return values[k];
}

void thumbnail_make(const Frame *frame, int *ret_width, int *ret_height, guint8 **ret_rgb) {
    thumbnail_make_sized(frame, THUMBNAIL_SIDE, ret_width, ret_height, ret_rgb);
}

void thumbnail_make_sized(const Frame *frame, int max_pixels, int *ret_width, int *ret_height,
                          guint8 **ret_rgb) {
    int longer = MAX(frame->width, frame->height);
    int side = (longer + max_pixels - 1) / max_pixels;
    if (frame->cfa != CFA_MONO)
        side = MAX(side + side % 2, 2); /* whole tiles of the filter */
    int width = MAX(frame->width / side, 1), height = MAX(frame->height / side, 1);
    gsize n = (gsize)width * height * 3;
    g_autofree float *values = g_new(float, n);
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++)
            merge_square(frame, x * side, y * side, side, &values[((gsize)y * width + x) * 3]);
    }
    g_autofree float *copy = g_memdup2(values, n * sizeof(float));
    float white = MAX(select_value(copy, n, (gsize)((n - 1) * 0.99)), 1.0f);
    *ret_rgb = g_new(guint8, n);
    for (gsize i = 0; i < n; i++) {
        const double linear = CLAMP((double)(values[i] / white), 0, 1);
        (*ret_rgb)[i] = (guint8)lround(255 * srgb_encode(linear));
    }
    *ret_width = width;
    *ret_height = height;
}
