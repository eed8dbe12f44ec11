/* Where rays end on the height map, and what the map says of the light there: steps 1 to 3 of
 * neural.h. */
#include "neural_private.h"

#include <math.h>

#define SUBRAY    0.25F  /* of a texel, from the centre */
#define MIN_UP    0.05F  /* least v.z and least r of a reach */
#define MIN_FLAT  1e-4F  /* least |(l.x, l.y)| */
#define SLOPE_END 0.375F /* half the length over which a slope is taken, in texels */
#define FIRST     0.375F /* first distance of the scan of the horizon, in texels */
#define STEP      0.25F  /* half a cell */

void neural_taps(float u, float v, int columns, int rows, struct neural_taps *ret) {
    const float x = CLAMP(u * (float)columns - 0.5F, 0, (float)(columns - 1));
    const float y = CLAMP(v * (float)rows - 0.5F, 0, (float)(rows - 1));
    const int i = (int)x, j = (int)y;
    const int right = i + 1 < columns, down = j + 1 < rows ? columns : 0;
    const float a = x - (float)i, b = y - (float)j;
    ret->at[0] = j * columns + i;
    ret->at[1] = ret->at[0] + right;
    ret->at[2] = ret->at[0] + down;
    ret->at[3] = ret->at[2] + right;
    ret->weight[0] = (1 - a) * (1 - b);
    ret->weight[1] = a * (1 - b);
    ret->weight[2] = (1 - a) * b;
    ret->weight[3] = a * b;
}

/* H(x, y): the height at a place in texels. The map has at least 2 × 2 cells. */
static inline float height_at(const struct neural_numbers *numbers, float x, float y) {
    const int columns = 2 * numbers->width, rows = 2 * numbers->height;
    const float u = CLAMP(2 * x - 0.5F, 0, (float)(columns - 1));
    const float v = CLAMP(2 * y - 0.5F, 0, (float)(rows - 1));
    const int i = MIN((int)u, columns - 2), j = MIN((int)v, rows - 2);
    const float a = u - (float)i, b = v - (float)j;
    const float *z = numbers->heights + (gsize)j * (gsize)columns + (gsize)i;
    const float above = z[0] + a * (z[1] - z[0]);
    const float below = z[columns] + a * (z[columns + 1] - z[columns]);
    return above + b * (below - above);
}

/* The end of the ray that meets the reference plane at (x, y), in texels. wx and wy are w. */
static void find_end(const struct neural_numbers *numbers, float x, float y, float wx, float wy,
                     float *ret_x, float *ret_y) {
    const float top = numbers->top, range = top - numbers->bottom;
    const float slope = MAX(1, sqrtf(wx * wx + wy * wy));
    const int n = (int)CLAMP(ceilf(4 * range * slope), 1, NEURAL_MAX_STEPS);
    float above = top, below = top;
    for (int k = 0; k <= n; k++) {
        above = below;
        below = top - range * (float)k / (float)n;
        if (height_at(numbers, x + wx * below, y + wy * below) >= below)
            break;
    }
    for (int k = 0; k < NEURAL_HALVINGS; k++) {
        const float middle = 0.5F * (above + below);
        if (height_at(numbers, x + wx * middle, y + wy * middle) >= middle)
            below = middle;
        else
            above = middle;
    }
    *ret_x = x + wx * below;
    *ret_y = y + wy * below;
}

void neural_find_ends(const struct neural_numbers *numbers, float x, float y, const float view[3],
                      struct neural_ends *ret) {
    const float up = MAX(view[2], MIN_UP);
    for (int ray = 0; ray < NEURAL_RAYS; ray++)
        find_end(numbers, x + (ray & 1 ? SUBRAY : -SUBRAY), y + (ray & 2 ? SUBRAY : -SUBRAY),
                 view[0] / up, -view[1] / up, &ret->x[ray], &ret->y[ray]);
}

/* Returns h of step 2: the slope of the horizon at (x, y) towards (dx, dy), at least r − 1. */
static float find_horizon(const struct neural_numbers *numbers, float x, float y, float dx,
                          float dy, float r) {
    const float top = numbers->top, z = height_at(numbers, x, y);
    const float reach = (top - numbers->bottom) / MAX(r, MIN_UP) + 0.5F;
    float h = r - 1, t = FIRST;
    for (int k = 0; k < NEURAL_MAX_STEPS && t <= reach && top - z > h * t; k++) {
        h = MAX(h, (height_at(numbers, x + dx * t, y + dy * t) - z) / t);
        t += MAX(STEP, t / 16);
    }
    return h;
}

/* N · l, where N is the normal of the map at (x, y). */
static float find_cosine(const struct neural_numbers *numbers, float x, float y,
                         const float light[3]) {
    const float e = SLOPE_END;
    const float right_down = height_at(numbers, x + e, y + e);
    const float right_up = height_at(numbers, x + e, y - e);
    const float left_down = height_at(numbers, x - e, y + e);
    const float left_up = height_at(numbers, x - e, y - e);
    const float s = (right_down + right_up - left_down - left_up) / (4 * e);
    const float t = (right_down + left_down - right_up - left_up) / (4 * e);
    return (-s * light[0] + t * light[1] + light[2]) / sqrtf(s * s + t * t + 1);
}

void neural_find_light(const struct neural_numbers *numbers, const struct neural_ends *ends,
                       const float light[3], float ret[NEURAL_LIGHT_INPUTS]) {
    const float flat = MAX(sqrtf(light[0] * light[0] + light[1] * light[1]), MIN_FLAT);
    const float dx = light[0] / flat, dy = -light[1] / flat, r = light[2] / flat;
    float shades = 0, lits = 0, clears = 0;
    for (int ray = 0; ray < NEURAL_RAYS; ray++) {
        const float x = ends->x[ray], y = ends->y[ray];
        const float clear = CLAMP(r - find_horizon(numbers, x, y, dx, dy, r), -1, 1);
        const float lit = CLAMP(0.5F + 10 * clear, 0, 1);
        shades += MAX(find_cosine(numbers, x, y, light), 0) * lit;
        lits += lit;
        clears += clear;
    }
    ret[0] = shades / NEURAL_RAYS;
    ret[1] = lits / NEURAL_RAYS;
    ret[2] = clears / NEURAL_RAYS;
}

void neural_find_directions(const float view[3], const float light[3], float ret_half[2],
                            float ret_difference[2]) {
    float half[3] = {view[0] + light[0], view[1] + light[1], view[2] + light[2]};
    const float length = sqrtf(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]);
    for (int i = 0; i < 3; i++)
        half[i] /= MAX(length, 1e-6F);
    const float along = light[0] * half[0] + light[1] * half[1];
    const float scale = along / (1 + half[2]) + light[2];
    for (int i = 0; i < 2; i++) {
        ret_half[i] = half[i];
        ret_difference[i] = light[i] - half[i] * scale;
    }
}

void neural_make_query(const struct neural_numbers *numbers, const struct neural_sample *sample,
                       struct neural_query *ret) {
    neural_find_ends(numbers, sample->x, sample->y, sample->view, &ret->ends);
    neural_find_light(numbers, &ret->ends, sample->light, ret->light);
    neural_find_directions(sample->view, sample->light, ret->half, ret->difference);
}
