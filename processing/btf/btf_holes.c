#include <math.h>

#include "btf_matrix.h"

/* Sets a pixel of all planes to the mean of the known pixels among its eight neighbours. Returns
 * FALSE if none of the neighbours is known. */
static gboolean fill(float *const *planes, int n, int width, int height, const gint8 *known,
                     int pixel) {
    const int x = pixel % width, y = pixel / width;
    double sums[8] = {0};
    int found = 0;
    for (int j = MAX(y - 1, 0); j <= MIN(y + 1, height - 1); j++)
        for (int i = MAX(x - 1, 0); i <= MIN(x + 1, width - 1); i++) {
            if (!known[j * width + i])
                continue;
            found++;
            for (int k = 0; k < n; k++)
                sums[k] += planes[k][j * width + i];
        }
    for (int k = 0; found > 0 && k < n; k++)
        planes[k][pixel] = (float)(sums[k] / found);
    return found > 0;
}

/* A pixel is a hole if any plane has NaN there. Each round fills the holes at the border of the
 * known area. */
int btf_fill_holes(float *const *planes, int n, int width, int height) {
    const int pixels = width * height;
    g_autofree int *holes = g_new(int, pixels);
    g_autofree gint8 *known = g_new0(gint8, pixels);
    int all = 0;
    g_return_val_if_fail(n <= 8, -1);
    for (int i = 0; i < pixels; i++) {
        known[i] = 1;
        for (int k = 0; k < n; k++)
            known[i] = known[i] && !isnan(planes[k][i]);
        if (!known[i])
            holes[all++] = i;
    }
    if (all == pixels)
        return -1;
    for (int left = all; left > 0;) {
        int kept = 0, filled = 0;
        g_autofree int *now = g_new(int, left);
        for (int i = 0; i < left; i++)
            if (fill(planes, n, width, height, known, holes[i]))
                now[filled++] = holes[i];
            else
                holes[kept++] = holes[i];
        /* Pixels filled in this round count as known from the next round on. */
        for (int i = 0; i < filled; i++)
            known[now[i]] = 1;
        left = kept;
    }
    return all;
}
