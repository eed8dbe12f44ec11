#include "warp.h"

#include <math.h>
#include <string.h>

struct warp {
    int width, height, n_slices;
    /* n_slices × height × width, densities per cell; the integral over each slice is 1 */
    float *values;
    float *conditional; /* same shape as values: sums from the left within each row */
    float *marginal;    /* n_slices × height: sums of rows from the first on */
};

void warp_interval(const float *nodes, int n, double value, int *ret_index, double *ret_weight) {
    int low = 0, high = n - 1;
    *ret_index = 0;
    *ret_weight = 0;
    if (n < 2)
        return;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if ((double)nodes[middle] <= value)
            low = middle;
        else
            high = middle;
    }
    const double from = (double)nodes[low], to = (double)nodes[high];
    *ret_index = low;
    *ret_weight = to > from ? CLAMP((value - from) / (to - from), 0, 1) : 0;
}

/* Returns the weighted sum over the slices of the value at position `at` in each slice. A slice has
 * stride values. */
static double mix(const float *values, gsize stride, gsize at, const struct warp_slices *slices) {
    double sum = 0;
    for (int k = 0; k < slices->n; k++)
        sum += slices->weight[k] * (double)values[(gsize)slices->index[k] * stride + at];
    return sum;
}

/* Returns the index of the cell, between two of n equally spaced nodes, that contains the
 * coordinate x of 0 … 1. *ret_within is the position in this cell, 0 … 1. */
static int warp_cell(double x, int n, double *ret_within) {
    const double scaled = CLAMP(x, 0, 1) * (n - 1);
    const int cell = CLAMP((int)scaled, 0, MAX(n - 2, 0));
    *ret_within = n > 1 ? scaled - cell : 0;
    return cell;
}

double warp_table_value(const struct warp_table *table, const struct warp_slices *slices, double x,
                        double y) {
    double fx, fy;
    const gsize width = (gsize)table->width, stride = width * (gsize)table->height;
    const gsize i = (gsize)warp_cell(x, table->width, &fx);
    const gsize j = (gsize)warp_cell(y, table->height, &fy);
    const gsize right = table->width > 1, up = table->height > 1 ? width : 0, at = j * width + i;
    const double low = (1 - fx) * mix(table->values, stride, at, slices) +
                       fx * mix(table->values, stride, at + right, slices);
    const double high = (1 - fx) * mix(table->values, stride, at + up, slices) +
                        fx * mix(table->values, stride, at + up + right, slices);
    return (1 - fy) * low + fy * high;
}

/* Computes the sums of one slice. Returns FALSE if its density is 0 everywhere. */
static gboolean add_up(struct warp *warp, gsize slice) {
    const gsize width = (gsize)warp->width, height = (gsize)warp->height, n = width * height;
    float *values = warp->values + slice * n, *conditional = warp->conditional + slice * n;
    float *marginal = warp->marginal + slice * height;
    g_autofree double *rows = g_new(double, height);
    double total = 0;
    for (gsize j = 0; j < height; j++) {
        double sum = 0;
        for (gsize i = 0; i + 1 < width; i++)
            sum += 0.5 * ((double)values[j * width + i] + (double)values[j * width + i + 1]);
        rows[j] = sum;
    }
    for (gsize j = 0; j + 1 < height; j++)
        total += 0.5 * (rows[j] + rows[j + 1]);
    if (!(total > 0) || !isfinite(total))
        return FALSE;
    double below = 0;
    for (gsize j = 0; j < height; j++) {
        double sum = 0;
        for (gsize i = 0; i < width; i++) {
            const gsize at = j * width + i;
            if (i > 0)
                sum += 0.5 * ((double)values[at - 1] + (double)values[at]);
            conditional[at] = (float)(sum / total);
        }
        marginal[j] = (float)(below / total);
        if (j + 1 < height)
            below += 0.5 * (rows[j] + rows[j + 1]);
    }
    for (gsize i = 0; i < n; i++)
        values[i] = (float)((double)values[i] / total);
    return TRUE;
}

Warp *warp_new(int width, int height, int n_slices, const float *values) {
    g_return_val_if_fail(width >= 2 && height >= 2 && n_slices >= 1, NULL);
    const gsize n = (gsize)width * (gsize)height * (gsize)n_slices;
    for (gsize i = 0; i < n; i++)
        if (!isfinite(values[i]) || values[i] < 0)
            return NULL;
    g_autoptr(Warp) warp = g_new0(struct warp, 1);
    warp->width = width;
    warp->height = height;
    warp->n_slices = n_slices;
    warp->values = g_memdup2(values, n * sizeof *values);
    warp->conditional = g_new(float, n);
    warp->marginal = g_new(float, (gsize)height *(gsize)n_slices);
    for (gsize slice = 0; slice < (gsize)n_slices; slice++)
        if (!add_up(warp, slice))
            return NULL;
    return g_steal_pointer(&warp);
}

void warp_free(Warp *warp) {
    if (!warp)
        return;
    g_free(warp->values);
    g_free(warp->conditional);
    g_free(warp->marginal);
    g_free(warp);
}

double warp_invert(const Warp *warp, const struct warp_slices *slices, double x, double y,
                   double ret[2]) {
    const gsize width = (gsize)warp->width, height = (gsize)warp->height, stride = width * height;
    double fx, fy;
    const gsize i = (gsize)warp_cell(x, warp->width, &fx);
    const gsize j = (gsize)warp_cell(y, warp->height, &fy);
    const gsize at = j * width + i, end = j * width + width - 1;
    const double v00 = mix(warp->values, stride, at, slices);
    const double v10 = mix(warp->values, stride, at + 1, slices);
    const double v01 = mix(warp->values, stride, at + width, slices);
    const double v11 = mix(warp->values, stride, at + width + 1, slices);
    const double left = (1 - fy) * v00 + fy * v01, right = (1 - fy) * v10 + fy * v11;
    const double r0 = mix(warp->conditional, stride, end, slices);
    const double r1 = mix(warp->conditional, stride, end + width, slices);
    const double row = (1 - fy) * r0 + fy * r1;
    const double before = (1 - fy) * mix(warp->conditional, stride, at, slices) +
                          fy * mix(warp->conditional, stride, at + width, slices);
    const double along = before + fx * (left + 0.5 * fx * (right - left));
    ret[0] = row > 0 ? CLAMP(along / row, 0, 1) : x;
    ret[1] = CLAMP(mix(warp->marginal, height, j, slices) + fy * (r0 + 0.5 * fy * (r1 - r0)), 0, 1);
    return ((1 - fx) * left + fx * right) * (double)((width - 1) * (height - 1));
}

/* Solves f (a + ½ f (b − a)) = area for f, where a, b ≥ 0. Returns f, clamped to 0 … 1, or 0.5 if a
 * and b are 0. */
static double solve(double a, double b, double area) {
    if (!(a + b > 0))
        return 0.5;
    /* This form of the root does not lose digits if a is close to b. */
    const double root = sqrt(MAX(a * a + 2 * area * (b - a), 0));
    return a + root > 0 ? CLAMP(2 * area / (a + root), 0, 1) : 0;
}

/* Returns the largest i for which sum i is below area, clamped to 0 … n − 2. The n sums ascend.
 *
 * If next is 0, sum i is the entry first + i of the slices, mixed by their weights. If next > 0,
 * sum i is interpolated between two rows: (1 − part) times the entry first + i, plus part times the
 * entry first + next + i. */
static gsize find(const float *sums, gsize stride, gsize first, gsize n, gsize next, double part,
                  const struct warp_slices *slices, double area) {
    gsize low = 0, high = n - 1;
    while (high - low > 1) {
        const gsize middle = (low + high) / 2;
        double sum = mix(sums, stride, first + middle, slices);
        if (next > 0)
            sum = (1 - part) * sum + part * mix(sums, stride, first + next + middle, slices);
        if (sum < area)
            low = middle;
        else
            high = middle;
    }
    return low;
}

void warp_sample(const Warp *warp, const struct warp_slices *slices, double x, double y,
                 double ret[2]) {
    const gsize width = (gsize)warp->width, height = (gsize)warp->height, stride = width * height;
    const double total = mix(warp->marginal, height, height - 1, slices);
    double area = CLAMP(y, 0, 1) * total;
    const gsize j = find(warp->marginal, height, 0, height, 0, 0, slices, area);
    const gsize end = j * width + width - 1;
    const double r0 = mix(warp->conditional, stride, end, slices);
    const double r1 = mix(warp->conditional, stride, end + width, slices);
    area = MAX(area - mix(warp->marginal, height, j, slices), 0);
    const double fy = solve(r0, r1, area);

    area = CLAMP(x, 0, 1) * ((1 - fy) * r0 + fy * r1);
    const gsize i = find(warp->conditional, stride, j * width, width, width, fy, slices, area);
    const gsize at = j * width + i;
    area -= (1 - fy) * mix(warp->conditional, stride, at, slices) +
            fy * mix(warp->conditional, stride, at + width, slices);
    const double left = (1 - fy) * mix(warp->values, stride, at, slices) +
                        fy * mix(warp->values, stride, at + width, slices);
    const double right = (1 - fy) * mix(warp->values, stride, at + 1, slices) +
                         fy * mix(warp->values, stride, at + width + 1, slices);
    ret[0] = ((double)i + solve(left, right, MAX(area, 0))) / (double)(width - 1);
    ret[1] = ((double)j + fy) / (double)(height - 1);
}
