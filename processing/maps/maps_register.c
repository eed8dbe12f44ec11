/* Makes a picture of each view by averaging over lights. Shifts these pictures against each other
 * by the displacements that belong to a depth, and compares them. */
#include "maps_register.h"

#include <math.h>
#include <string.h>

#include "base/direction.h"

/* number of texels in each dimension, in the middle of the BTF, that are compared */
#define WINDOW 96
/* number of texels at each side of the window that are not compared, because shifted pictures may
 * not have these texels */
#define MARGIN   4
#define STEEPEST 0.45F  /* minimum z of a view that is compared */
#define LEAST    (-1.0) /* depths from LEAST to MOST, in texels, are tried */
#define MOST     4.0
#define STEP     0.125 /* step between the depths that are tried, in texels */
/* a depth must reduce the difference of the views to less than this share of the difference without
 * a depth */
#define BETTER 0.9
/* minimum standard deviation of a pattern that gives a depth, relative to the mean */
#define FAINT   0.005
#define NOTHING 0.06 /* depths up to this number of texels count as 0 */

struct maps_register_search {
    int width, height, n; /* of the window; n is the number of views */
    float *pictures;      /* n × height × width × 3: R, G, B of the window in each view */
    float *tangents;      /* n × 2: v_x / v_z, −v_y / v_z */
};

void maps_register_free(struct maps_register *registered) {
    if (!registered)
        return;
    g_free(registered->shifts);
    g_free(registered);
}

/* Gives the four texels around a position and their bilinear weights. Returns FALSE if the position
 * is outside of the picture. */
static gboolean corners(double x, double y, int width, int height, gsize ret_at[4],
                        float ret_share[4]) {
    const int x0 = CLAMP((int)floor(x), 0, MAX(width - 2, 0));
    const int y0 = CLAMP((int)floor(y), 0, MAX(height - 2, 0));
    const int x1 = MIN(x0 + 1, width - 1), y1 = MIN(y0 + 1, height - 1);
    const float fx = (float)(x - x0), fy = (float)(y - y0);
    if (x < -1e-4 || y < -1e-4 || x > width - 1 + 1e-4 || y > height - 1 + 1e-4)
        return FALSE;
    for (int k = 0; k < 4; k++) {
        ret_at[k] = (gsize)(k < 2 ? y0 : y1) * (gsize)width + (gsize)(k % 2 ? x1 : x0);
        ret_share[k] = (k % 2 ? fx : 1 - fx) * (k < 2 ? 1 - fy : fy);
    }
    return TRUE;
}

/* Makes the picture of the window in a view: sums over all lights, scaled to a mean of 1. */
static gboolean maps_register_picture(const struct btf_matrix *btf, int view, int x0, int y0,
                                      const struct maps_register_search *search, float *ret,
                                      GError **error) {
    const gsize n_lights = btf->layout.lights.n, row = n_lights * 3;
    const gsize n = (gsize)search->width * (gsize)search->height;
    g_autofree float *buffer = g_new(float, row *(gsize)search->width);
    double sum = 0;
    for (int y = 0; y < search->height; y++) {
        gsize stride = 0;
        const float *from = btf_matrix_rows(btf, view, (y0 + y) * (int)btf->layout.width + x0,
                                            search->width, buffer, &stride, error);
        if (!from)
            return FALSE;
        for (int x = 0; x < search->width; x++) {
            float *to = ret + ((gsize)y * (gsize)search->width + (gsize)x) * 3;
            for (gsize i = 0; i < row; i++) {
                const float value = from[(gsize)x * stride + i];
                to[i % 3] += isfinite(value) ? value : 0;
            }
            sum += (double)to[0] + (double)to[1] + (double)to[2];
        }
    }
    for (gsize i = 0; i < 3 * n; i++)
        ret[i] = sum > 0 ? (float)((double)ret[i] * 3 * (double)n / sum) : 0;
    return TRUE;
}

/* Returns the quotient of maps_register.h for a depth in texels: the variance between the views,
 * divided by the variance of their mean picture. Returns INFINITY if there is no pattern. */
static double maps_register_differ(const struct maps_register_search *s, double depth) {
    double within = 0, contrast = 0, mean[3] = {0};
    gint64 n = 0;
    for (int y = MARGIN; y < s->height - MARGIN; y++)
        for (int x = MARGIN; x < s->width - MARGIN; x++) {
            double sum[3] = {0}, squares = 0;
            int views = 0;
            for (int v = 0; v < s->n; v++) {
                const float *picture =
                    s->pictures + (gsize)v * (gsize)s->width * (gsize)s->height * 3;
                gsize at[4];
                float share[4];
                const gsize k = 2 * (gsize)v;
                if (!corners(x + depth * (double)s->tangents[k],
                             y + depth * (double)s->tangents[k + 1], s->width, s->height, at,
                             share))
                    continue;
                for (int c = 0; c < 3; c++) {
                    double value = 0;
                    for (int i = 0; i < 4; i++)
                        value += (double)share[i] * (double)picture[3 * at[i] + (gsize)c];
                    sum[c] += value;
                    squares += value * value;
                }
                views++;
            }
            for (int c = 0; views > 0 && c < 3; c++) {
                squares -= sum[c] * sum[c] / views;
                mean[c] += sum[c] / views;
                contrast += sum[c] * sum[c] / views / views;
            }
            within += views > 0 ? squares / views : 0;
            n += views > 0;
        }
    for (int c = 0; c < 3 && n > 0; c++)
        contrast -= mean[c] * mean[c] / (double)n;
    return contrast > FAINT * FAINT * 3 * (double)n ? within / contrast : INFINITY;
}

struct maps_register_run {
    const struct maps_register_search *search;
    double *differ;
};

static void maps_register_try(int i, gpointer data) {
    const struct maps_register_run *run = data;
    run->differ[i] = maps_register_differ(run->search, LEAST + i * STEP);
}

/* Finds the depth *ret, in texels, at which the views agree best. *ret is 0 if no depth is clearly
 * better than the reference plane. Returns FALSE with an error when cancelled. */
static gboolean maps_register_search(const struct maps_register_search *search,
                                     const struct work *work, double *ret, GError **error) {
    enum { TRIES = (int)((MOST - LEAST) / STEP) + 1 };
    double differ[TRIES];
    struct maps_register_run run = {search, differ};
    int best = 0;
    *ret = 0;
    if (search->width <= 2 * MARGIN || search->height <= 2 * MARGIN || search->n < 2)
        return TRUE;
    if (!work_parallel(work, "depth", TRIES, maps_register_try, &run, error))
        return FALSE;
    for (int i = 1; i < TRIES; i++)
        if (differ[i] < differ[best])
            best = i;
    const double none = differ[(int)(-LEAST / STEP)];
    if (!isfinite(none) || !(differ[best] < BETTER * none) || best == 0 || best == TRIES - 1 ||
        !isfinite(differ[best - 1] + differ[best + 1]))
        return TRUE;
    /* The depth is the vertex of the parabola through the minimum and its two neighbours. */
    const double before = differ[best - 1], after = differ[best + 1];
    const double bend = before - 2 * differ[best] + after;
    const double off = bend > 0 ? 0.5 * (before - after) / bend : 0;
    *ret = LEAST + (best + off) * STEP;
    if (fabs(*ret) < NOTHING)
        *ret = 0;
    return TRUE;
}

struct maps_register *maps_register_new(const struct btf_matrix *btf, const struct work *work,
                                        GError **error) {
    const int width = (int)btf->layout.width, height = (int)btf->layout.height;
    const int n_views = (int)btf->layout.views.n;
    struct maps_register_search search = {MIN(width, WINDOW), MIN(height, WINDOW), 0, NULL, NULL};
    const gsize size = (gsize)search.width * (gsize)search.height * 3;
    g_autofree float *views = direction_list_vectors(&btf->layout.views);
    g_autofree float *pictures = g_new0(float, size *(gsize)n_views);
    g_autofree float *tangents = g_new0(float, 2 * (gsize)n_views);
    const double texel_mm = btf->layout.texel_mm > 0 ? btf->layout.texel_mm : 1;
    double depth = 0;
    gboolean ok = TRUE;
    search.pictures = pictures;
    search.tangents = tangents;
    for (int v = 0; ok && v < n_views; v++) {
        const float *d = views + 3 * (gsize)v;
        if (d[2] < STEEPEST)
            continue;
        tangents[2 * (gsize)search.n] = d[0] / d[2];
        tangents[2 * (gsize)search.n + 1] = -d[1] / d[2];
        ok = maps_register_picture(btf, v, (width - search.width) / 2, (height - search.height) / 2,
                                   &search, pictures + size * (gsize)search.n++, error);
    }
    if (!ok || !maps_register_search(&search, work, &depth, error))
        return NULL;
    struct maps_register *ret = g_new0(struct maps_register, 1);
    ret->btf = btf;
    ret->depth_mm = depth * texel_mm;
    ret->shifts = g_new0(float, 2 * (gsize)n_views);
    for (int v = 0; v < n_views; v++) {
        const float *d = views + 3 * (gsize)v;
        for (int k = 0; k < 2; k++)
            ret->shifts[2 * v + k] = (float)depth * (k ? -d[1] : d[0]) / MAX(d[2], 0.1F);
    }
    return ret;
}

const float *maps_register_rows(const struct maps_register *registered, int view, int first, int n,
                                float *buffer, gsize *ret_stride, GError **error) {
    const struct btf_matrix *btf = registered->btf;
    const gsize row = btf->layout.lights.n * 3;
    const int width = (int)btf->layout.width, height = (int)btf->layout.height;
    const double sx = (double)registered->shifts[2 * view];
    const double sy = (double)registered->shifts[2 * view + 1];
    if (fabs(sx) + fabs(sy) < 1e-6)
        return btf_matrix_rows(btf, view, first, n, buffer, ret_stride, error);
    g_autofree float *one = btf->values ? NULL : g_new(float, row);
    *ret_stride = row;
    for (int t = 0; t < n; t++) {
        float *to = buffer + (gsize)t * row;
        gsize at[4], stride;
        float share[4];
        const int i0 = (first + t) % width, j0 = (first + t) / width;
        const gboolean inside = corners(i0 + sx, j0 + sy, width, height, at, share);
        for (gsize i = 0; i < row; i++)
            to[i] = inside ? 0 : NAN;
        for (int k = 0; inside && k < 4; k++) {
            const float *from = btf_matrix_rows(btf, view, (int)at[k], 1, one, &stride, error);
            if (!from)
                return NULL;
            for (gsize i = 0; i < row; i++)
                to[i] += share[k] > 0 ? share[k] * from[i] : 0;
        }
    }
    return buffer;
}
