/* Makes the height map from the points that the lasers measured. */
#include "neural_private.h"

#include "codecs/codec/codec_geometry.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static int by_height(gconstpointer a, gconstpointer b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Returns the cell of a point, or −1 if the point is outside of the sample. */
static int find_cell(const struct btf_layout *layout, const struct codec_surface_point *point) {
    const int columns = 2 * (int)layout->width, rows = 2 * (int)layout->height;
    const double x = 2 * (double)point->x / layout->texel_mm + (double)layout->width;
    const double y = (double)layout->height - 2 * (double)point->y / layout->texel_mm;
    const gboolean inside = x >= 0 && x < columns && y >= 0 && y < rows && isfinite(point->z);
    return inside ? (int)y * columns + (int)x : -1;
}

/* Gives the median of the points in each cell, NaN in cells without points. */
static void find_medians(const struct btf_layout *layout, const struct codec_geometry *geometry,
                         float *ret, gsize n_cells) {
    /* positions in `sorted` at which the points of each cell end */
    g_autofree gsize *ends = g_new0(gsize, n_cells + 1);
    g_autofree float *sorted = g_new(float, geometry->n_points + 1);
    for (gsize i = 0; i < geometry->n_points; i++) {
        const int cell = find_cell(layout, &geometry->points[i]);
        if (cell >= 0)
            ends[cell + 1]++;
    }
    for (gsize cell = 0; cell < n_cells; cell++)
        ends[cell + 1] += ends[cell];
    /* ends[cell] is now the position at which the cell begins. Filling in the points moves it to
     * the position at which the cell ends. */
    for (gsize i = 0; i < geometry->n_points; i++) {
        const int cell = find_cell(layout, &geometry->points[i]);
        if (cell >= 0)
            sorted[ends[cell]++] = geometry->points[i].z;
    }
    for (gsize cell = 0, first = 0; cell < n_cells; first = ends[cell++]) {
        const gsize count = ends[cell] - first;
        qsort(sorted + first, count, sizeof *sorted, by_height);
        ret[cell] = count > 0 ? sorted[first + count / 2] : NAN;
    }
}

void neural_set_heights(struct neural *neural, const struct codec_geometry *geometry) {
    const struct btf_layout *layout = &neural->layout;
    const gsize n = 4 * btf_layout_texels(layout);
    g_autofree float *z = g_new(float, n);
    float lowest = INFINITY, highest = -INFINITY;
    memset(neural->heights, 0, n);
    neural->height_scale = (struct neural_scale){0, 0};
    if (!geometry || geometry->n_points == 0)
        return;
    find_medians(layout, geometry, z, n);
    if (btf_fill_holes(&z, 1, 2 * (int)layout->width, 2 * (int)layout->height) < 0)
        return;
    for (gsize i = 0; i < n; i++) {
        lowest = MIN(lowest, z[i]);
        highest = MAX(highest, z[i]);
    }
    neural->height_scale = (struct neural_scale){lowest, (highest - lowest) / 255};
    for (gsize i = 0; highest > lowest && i < n; i++)
        neural->heights[i] = (guint8)lrintf(255 * (z[i] - lowest) / (highest - lowest));
}
