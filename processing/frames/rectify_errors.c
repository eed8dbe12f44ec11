#include <math.h>
#include <string.h>

#include "demosaic.h"
#include "rectify_private.h"

#define MAX_RATIO   100.0f
#define EDGE_DETAIL 0.05f /* κ² of rectify_structure(); measured: docs/lab/accuracy.md */

/* Copies a texel's area weights into the window of its smooth weights, and returns this window.
 * This window contains all area weights that are not 0. Without smooth weights (mono), the window
 * of the area weights is used and returned. */
static const struct window *widen(const Rectify *rectify, int texel, float *ret_area) {
    const struct window *area = &rectify->area.window[texel];
    const struct window *window = &rectify->around.window[texel];
    const float *weight = rectify_weights_of(&rectify->area, texel);
    window = window->n_rows > 0 ? window : area;
    const int columns = window->n_wide * LANES;
    memset(ret_area, 0, sizeof(float) * window->n_rows * (gsize)columns);
    /* The part of the area's window that lies outside of the other window contains only zeros. */
    const int left = MAX(area->x, window->x);
    const int right = MIN(area->x + area->n_wide * LANES, window->x + columns);
    for (int y = MAX(area->y, window->y);
         y < MIN(area->y + area->n_rows, window->y + window->n_rows) && left < right; y++)
        memcpy(ret_area + (y - window->y) * columns + left - window->x,
               weight + (y - area->y) * area->n_wide * LANES + left - area->x,
               sizeof(float) * (gsize)(right - left));
    return window;
}

/* For one texel and each colour: the derivatives of the texel's value (apply_all()) with respect to
 * the pixels m_p. w are the area weights, a the smooth weights, r the ratios. A clamped excess
 * counts as a constant.
 *   own colour:    ∂/∂m_p = w + own·a,   own = others_c · balance / others of the surround
 *   other colours: ∂/∂m_p = excess·r·(w − other·a),   other = others_c / others of the surround
 * chroma is the mean square of the difference of ln excess between adjacent texels. */
struct rectify_slopes {
    float own[3], excess[3], other[3], log_excess[3], chroma[3];
};

static inline __attribute__((always_inline)) struct rectify_slopes
rectify_slopes_of(const Rectify *rectify, int texel, const float *mosaic, const float *ratio) {
    struct rectify_slopes ret = {{0}, {1, 1, 1}, {0}, {0}, {0}};
    struct tally area, around;
    rectify_add_up(rectify, &rectify->area, texel, mosaic, ratio, &area);
    rectify_add_up(rectify, &rectify->around, texel, mosaic, ratio, &around);
    for (int c = 0; c < 3; c++) {
        const float others = around.others[c], balance = rectify->balance[texel][c];
        if (!(balance > 0 && others > 0))
            continue;
        const float excess = around.own[c] / others * balance;
        ret.excess[c] = CLAMP(excess, 1 / MAX_EXCESS, MAX_EXCESS);
        ret.log_excess[c] = logf(ret.excess[c]);
        if (excess != ret.excess[c])
            continue;
        ret.other[c] = area.others[c] / others;
        ret.own[c] = ret.other[c] * balance;
    }
    return ret;
}

/* Sets ret to the squared differences of ln excess between the texels with the indices texel and
 * texel + step. Returns FALSE and leaves ret unchanged if either texel lies outside of the
 * picture. */
static gboolean chroma_step(const Rectify *rectify, const struct rectify_slopes *slopes, int texel,
                            int step, float ret[3]) {
    if (rectify->area.window[texel].n_rows == 0 || rectify->area.window[texel + step].n_rows == 0)
        return FALSE;
    for (int c = 0; c < 3; c++) {
        const float d = slopes[texel + step].log_excess[c] - slopes[texel].log_excess[c];
        ret[c] = d * d;
    }
    return TRUE;
}

/* Sets chroma of each texel to the mean over the adjacent pairs among the 3 × 3 texels around
 * it. */
static void find_chroma(const Rectify *rectify, struct rectify_slopes *slopes) {
    const int width = rectify->columns, height = rectify->n_texels / width;
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        const int x0 = MAX(texel % width - 1, 0), x1 = MIN(texel % width + 1, width - 1);
        const int y0 = MAX(texel / width - 1, 0), y1 = MIN(texel / width + 1, height - 1);
        float sum[3] = {0}, step[3];
        int pairs = 0;
        for (int y = y0; y <= y1; y++)
            for (int x = x0; x <= x1; x++)
                for (int down = 0; down < 2; down++) {
                    if ((down ? y == y1 : x == x1) ||
                        !chroma_step(rectify, slopes, y * width + x, down ? width : 1, step))
                        continue;
                    for (int c = 0; c < 3; c++)
                        sum[c] += step[c];
                    pairs++;
                }
        for (int c = 0; c < 3 && pairs > 0; c++)
            slopes[texel].chroma[c] = sum[c] / (float)pairs;
    }
}

/* Estimates the variance of l from pixel to pixel, where l is the logarithm of the ratio of green
 * to a pixel's own colour. Returns (l − m)² / 1.25, where m is the mean of l over the four nearest
 * pixels behind the same colour filter. If l varies at random, the expectation of this result is
 * the variance of l. */
static float vary_of(const Rectify *rectify, const float *green, int x, int y) {
    static const struct { int x, y; } next[] = {{-2, 0}, {2, 0}, {0, -2}, {0, 2}};
    const gsize at = (gsize)y * rectify->stride + (gsize)x;
    float off = logf(CLAMP(green[at], 1 / MAX_RATIO, MAX_RATIO));
    for (gsize k = 0; k < G_N_ELEMENTS(next); k++) {
        const int u = demosaic_mirror(x + next[k].x, rectify->width);
        const int v = demosaic_mirror(y + next[k].y, rectify->height);
        const float ratio = green[(gsize)v * rectify->stride + (gsize)u];
        off -= 0.25f * logf(CLAMP(ratio, 1 / MAX_RATIO, MAX_RATIO));
    }
    return off * off / 1.25f;
}

/* Only one pixel in four measures red, and one in four blue. If the ratio of such a colour to green
 * changes from one of its pixels to the next, the ratios of the pixels between them have errors of
 * about this size. The result for red or blue is the weighted mean of vary_of() over the texel's
 * pixels of that colour. The result for green is 0. */
float *rectify_find_vary(const Rectify *rectify, const float *ratio) {
    const float *green = ratio + DEMOSAIC_GREEN * rectify->stride * (gsize)rectify->height;
    float *ret = g_new0(float, 3 * (gsize)rectify->n_texels);
    for (int texel = 0; texel < rectify->n_texels && !rectify->mono; texel++) {
        const struct window *window = &rectify->area.window[texel];
        const float *weight = rectify_weights_of(&rectify->area, texel);
        const int columns = window->n_wide * LANES;
        float sum[3] = {0}, weights[3] = {0};
        for (int i = 0; i < window->n_rows * columns; i++) {
            const int x = window->x + i % columns, y = window->y + i / columns;
            const int c = rectify->phase[2 * (y & 1) + (x & 1)];
            if (weight[i] == 0 || c == DEMOSAIC_GREEN)
                continue;
            sum[c] += weight[i] * vary_of(rectify, green, x, y);
            weights[c] += weight[i];
        }
        for (int c = 0; c < 3; c++)
            ret[3 * texel + c] = weights[c] > 0 ? MAX(sum[c] / weights[c], 0) : 0;
    }
    return ret;
}

/* Masks of the colour filter, for even and odd rows and for each colour. own is 1 for pixels of the
 * colour and 0 for other pixels. others is the reverse. */
struct rectify_pattern {
    wide own[2][3], others[2][3];
};

static inline __attribute__((always_inline)) void find_pattern(const Rectify *rectify,
                                                               struct rectify_pattern *ret) {
    for (int row = 0; row < 2; row++)
        for (int c = 0; c < 3; c++)
            for (int lane = 0; lane < LANES; lane++) {
                const gboolean own = rectify->phase[2 * row + lane % 2] == c;
                ret->own[row][c][lane] = own;
                ret->others[row][c][lane] = !own;
            }
}

/* A frame in the form that the errors need. values and variances are padded planes. colours are
 * three padded planes: in the plane of its own colour a pixel has its value, in the other planes
 * its value times the ratio. vary is from rectify_find_vary(). */
struct rectify_frame {
    const float *values, *variances, *colours, *ratio, *vary;
    const struct rectify_slopes *slopes;
    const struct rectify_pattern *pattern;
};

/* Computes noise_c = gain_c² · Σ_p (∂/∂m_p)² · var_p. area has room for the weights of one texel.
 * none is an array of zeros of the same size. */
static inline __attribute__((always_inline)) void rectify_noise(const Rectify *rectify, int texel,
                                                                const struct rectify_frame *frame,
                                                                float *area, const float *none,
                                                                float ret[3]) {
    const gsize plane = rectify->stride * (gsize)rectify->height;
    const struct rectify_slopes *slopes = &frame->slopes[texel];
    const struct window *window = widen(rectify, texel, area);
    const gboolean smooth = window != &rectify->area.window[texel];
    const float *around = smooth ? rectify_weights_of(&rectify->around, texel) : none,
                *weight = area;
    wide sum[3] = {{0}};
    for (int y = window->y; y < window->y + window->n_rows; y++) {
        const gsize at = (gsize)y * rectify->stride + window->x;
        for (gsize x = at; x < at + window->n_wide * LANES; x += LANES) {
            const wide w = *(const wide *)weight, a = *(const wide *)around;
            const wide variance = *(const wide *)(frame->variances + x);
            for (int c = 0; c < 3; c++) {
                const wide own = frame->pattern->own[y & 1][c];
                const wide r = *(const wide *)(frame->ratio + (gsize)c * plane + x);
                const wide slope = own * (w + slopes->own[c] * a) +
                                   slopes->excess[c] * r * (w - slopes->other[c] * a);
                sum[c] += slope * slope * variance;
            }
            weight += LANES;
            around += LANES;
        }
    }
    for (int c = 0; c < 3; c++)
        ret[c] = rectify->colour_gain[c] * rectify->colour_gain[c] * rectify_sum_of(&sum[c]);
}

/* Returns a texel's area weights with 0 in the picture's first and last column. copy has room for
 * the weights, and is used only if the window may touch these columns. */
static const float *inner_weights(const Rectify *rectify, int texel, float *copy) {
    const struct window *window = &rectify->area.window[texel];
    const float *weight = rectify_weights_of(&rectify->area, texel);
    const int columns = window->n_wide * LANES, n = window->n_rows * columns;
    if (window->x > 0 && window->x + columns < rectify->width)
        return weight;
    for (int i = 0; i < n; i++) {
        const int x = window->x + i % columns;
        copy[i] = x == 0 || x >= rectify->width - 1 ? 0 : weight[i];
    }
    return copy;
}

/* Sums of one colour over a texel, with the symbols of rectify_add_structure():
 * squares: sum of u²
 * others: sum of (w m)² over the pixels of other colours
 * dx, dy: sums of the slopes, times w */
struct rectify_sums {
    wide squares, others, dx, dy;
};

/* Adds LANES pixels p of one row to the sums of one colour. w_p is the weight of a pixel, and m_p
 * is the plane times a factor. The factor is 1 for pixels of the colour itself, and the texel's
 * excess for other pixels. `here` is the factor at the pixels, `aside` at their left and right
 * neighbours, and `below` at their neighbours above and below. `other` is 0 for pixels of the
 * colour itself, and 1 for other pixels.
 *
 * Λ_p = m_p − (mean of the four neighbours) is the part of m_p that the neighbours do not predict.
 * The slopes are the differences between opposite neighbours. *ret is u_p = w_p Λ_p. */
static inline __attribute__((always_inline)) void
rectify_add_structure(const float *plane, gsize stride, wide here, wide aside, wide below,
                      wide other, wide weight, struct rectify_sums *sums, wide *ret) {
    const float *const next = plane + stride, *const last = plane - stride;
    const wide left = *(const wide *)(plane - 1), right = *(const wide *)(plane + 1);
    const wide up = *(const wide *)last, down = *(const wide *)next;
    const wide m = weight * here * *(const wide *)plane, x = weight * aside, y = weight * below;
    const wide u = m - 0.25f * (x * (left + right) + y * (up + down));
    sums->squares += u * u;
    sums->others += other * m * m;
    sums->dx += x * (right - left);
    sums->dy += y * (down - up);
    *ret = u;
}

/* Estimates detail and shift of rectify_errors() for each colour c. Errors are similar along an
 * edge, but the direction of an edge is not known. Therefore the largest of four sums is used, with
 * u_p = w_p Λ_p of rectify_add_structure():
 *   max_c = max(Σ_p u_p², Σ_rows (Σ u_p)², Σ_columns (Σ u_p)², (Σ_p u_p)²),
 *   coherence_c = max_c / Σ_p u_p².
 * The unknown position of an edge within a pixel gives a variance of κ² max_c. The colours of the
 * pixels in a texel differ from the texel's colour. If a side of the texel is CHROMA_PX pixels,
 * they differ as much as the colours of adjacent texels do. In a smaller texel they differ more.
 * `pixels` is the shortest side of a texel in pixels.
 *   off_c = chroma_c · CHROMA_PX / pixels · Σ_(p of other colours) w_p² m_p²,
 *   fine_c = vary_c · Σ_(p of other colours) w_p² m_p²,   vary_c: rectify_find_vary(),
 *   detail_c = max(0, κ² (gain_c² max_c − 1.25 noise_c)) + gain_c² (coherence_c off_c + fine_c),
 *   shift_c = gain_c² · ((Σ w ∂m/∂x)² + (Σ w ∂m/∂y)²).
 * down has room for 3 × columns of the window. */
static inline __attribute__((always_inline)) void
rectify_structure(const Rectify *rectify, int texel, const struct rectify_frame *frame,
                  const float *weight, float *down, const float noise[3], float ret_detail[3],
                  float ret_shift[3]) {
    const gsize stride = rectify->stride, plane = stride * (gsize)rectify->height;
    const struct rectify_slopes *slopes = &frame->slopes[texel];
    const struct window *window = &rectify->area.window[texel];
    const int columns = window->n_wide * LANES;
    struct rectify_sums sums[3] = {{{0}}};
    float rows[3] = {0}, total[3] = {0};
    /* factors of rectify_add_structure(), for even and odd rows and for each colour */
    wide here[2][3], aside[2][3];
    for (int row = 0; row < 2; row++)
        for (int c = 0; c < 3; c++) {
            const float k = slopes->excess[c];
            const float e = rectify->phase[2 * row] == c ? 1 : k;
            const float o = rectify->phase[2 * row + 1] == c ? 1 : k;
            here[row][c] = (wide){e, o, e, o, e, o, e, o};
            aside[row][c] = (wide){o, e, o, e, o, e, o, e};
        }
    memset(down, 0, sizeof(float) * 3 * (gsize)columns);
    for (int y = window->y; y < window->y + window->n_rows; y++, weight += columns) {
        const int odd = y & 1;
        wide row[3] = {{0}};
        if (y == 0 || y == rectify->height - 1)
            continue;
        for (int x = 0; x < columns; x += LANES) {
            const float *p = frame->colours + (gsize)y * stride + window->x + (gsize)x;
            for (int c = 0; c < 3; c++) {
                wide u;
                rectify_add_structure(p + (gsize)c * plane, stride, here[odd][c], aside[odd][c],
                                      here[!odd][c], frame->pattern->others[odd][c],
                                      *(const wide *)(weight + x), &sums[c], &u);
                *(wide *)(down + c * columns + x) += u;
                row[c] += u;
            }
        }
        for (int c = 0; c < 3; c++) {
            const float sum = rectify_sum_of(&row[c]);
            rows[c] += sum * sum;
            total[c] += sum;
        }
    }
    for (int c = 0; c < 3; c++) {
        const float gain = rectify->colour_gain[c] * rectify->colour_gain[c];
        const float squares = rectify_sum_of(&sums[c].squares),
                    others = rectify_sum_of(&sums[c].others);
        const float dx = 0.5f * rectify_sum_of(&sums[c].dx),
                    dy = 0.5f * rectify_sum_of(&sums[c].dy);
        float most = MAX(MAX(squares, rows[c]), total[c] * total[c]), over_columns = 0;
        for (int x = 0; x < columns; x++)
            over_columns += down[c * columns + x] * down[c * columns + x];
        most = MAX(most, over_columns);
        const float coherence = squares > 0 ? most / squares : 1;
        const float edges = EDGE_DETAIL * (gain * most - 1.25f * noise[c]);
        const float off = slopes->chroma[c] * rectify->chroma * others;
        const float fine = frame->vary[3 * (gsize)texel + (gsize)c] * others;
        ret_detail[c] = MAX(edges, 0) + gain * (coherence * off + fine);
        ret_shift[c] = gain * (dx * dx + dy * dy);
    }
}

/* Sets ret to values · ratio, or to the values where the ratio is 0. */
static inline __attribute__((always_inline)) void
multiply(const float *restrict values, const float *restrict ratio, gsize n, float *restrict ret) {
    for (gsize i = 0; i < n; i++) {
        const float factor = ratio[i];
        ret[i] = values[i] * (factor > 0 ? factor : 1);
    }
}

static inline __attribute__((always_inline)) void
rectify_do_errors(const Rectify *rectify, const float *mosaic, const float *pixels,
                  float *ret_noise, float *ret_detail, float *ret_shift) {
    const gsize plane = rectify->stride * (gsize)rectify->height;
    g_autofree float *found = rectify->ratio ? NULL : rectify_find_ratios(rectify, mosaic);
    const float *ratio = rectify->ratio ? rectify->ratio : found;
    g_autofree float *values = g_new0(float, plane), *variances = g_new(float, plane);
    g_autofree float *colours = g_new(float, 3 * plane);
    g_autofree struct rectify_slopes *slopes = g_new(struct rectify_slopes, rectify->n_texels);
    g_autofree float *found_vary = rectify->ratio ? NULL : rectify_find_vary(rectify, ratio);
    const float *vary = rectify->ratio ? rectify->vary : found_vary;
    struct rectify_pattern pattern;
    const struct rectify_frame frame = {values, variances, colours, ratio, vary, slopes, &pattern};
    find_pattern(rectify, &pattern);
    rectify_pad(rectify, mosaic, values);
    rectify_pad(rectify, pixels, variances);
    for (gsize c = 0; c < 3; c++)
        multiply(values, ratio + c * plane, plane, colours + c * plane);
    guint most = 0;
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        const struct window *a = &rectify->area.window[texel], *b = &rectify->around.window[texel];
        most = MAX(most, (guint)MAX(a->n_rows * a->n_wide, b->n_rows * b->n_wide) * LANES);
        slopes[texel] = rectify_slopes_of(rectify, texel, values, ratio);
    }
    find_chroma(rectify, slopes);
    g_autofree float *area = g_new(float, most), *none = g_new0(float, most);
    g_autofree float *down = g_new(float, 3 * (gsize)most);
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        const gsize i = 3 * (gsize)texel;
        rectify_noise(rectify, texel, &frame, area, none, ret_noise + i);
        rectify_structure(rectify, texel, &frame, inner_weights(rectify, texel, area), down,
                          ret_noise + i, ret_detail + i, ret_shift + i);
    }
}

#if defined(__x86_64__)
__attribute__((target("avx2"))) static void
rectify_errors_avx2(const Rectify *rectify, const float *mosaic, const float *pixels,
                    float *ret_noise, float *ret_detail, float *ret_shift) {
    rectify_do_errors(rectify, mosaic, pixels, ret_noise, ret_detail, ret_shift);
}
#endif

/* Computes the errors of a mosaic, or of one plane of "rgb". All pixels of a plane count as
 * grey. */
static void plane_errors(const Rectify *rectify, const float *mosaic, const float *pixels,
                         float *ret_noise, float *ret_detail, float *ret_shift) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2")) {
        rectify_errors_avx2(rectify, mosaic, pixels, ret_noise, ret_detail, ret_shift);
        return;
    }
#endif
    rectify_do_errors(rectify, mosaic, pixels, ret_noise, ret_detail, ret_shift);
}

/* Copies one colour. For "rgb", the values of each colour come from its own plane. */
static void take_colour(const Rectify *rectify, const float *found, gsize c, float *ret) {
    for (gsize i = c; i < 3 * (gsize)rectify->n_texels; i += 3)
        ret[i] = found[i];
}

void rectify_errors(const Rectify *rectify, const float *mosaic, const float *pixels,
                    float *ret_noise, float *ret_detail, float *ret_shift) {
    if (rectify->planes == 1) {
        plane_errors(rectify, mosaic, pixels, ret_noise, ret_detail, ret_shift);
        return;
    }
    const gsize n = 3 * (gsize)rectify->n_texels;
    g_autofree float *noise = g_new0(float, n), *detail = g_new0(float, n);
    g_autofree float *shift = g_new0(float, n);
    for (gsize c = 0, at = 0; c < rectify->planes; c++, at += rectify->n_pixels) {
        plane_errors(rectify_of_plane(rectify, c), mosaic + at, pixels + at, noise, detail, shift);
        take_colour(rectify, noise, c, ret_noise);
        take_colour(rectify, detail, c, ret_detail);
        take_colour(rectify, shift, c, ret_shift);
    }
}
