/* Photon transfer (EMVA 1288). S is the signal above the black level in DN, including the dark
 * current. K is the gain in DN per electron. The temporal variance of a pixel is
 *   σ² = σ_read² + 1/12 + K·S.
 * Each tile of a pair of pictures gives a point (S, σ²), where S is the mean of both pictures and
 * σ² is half the variance of their difference. */
#include "photon_transfer.h"

#include <math.h>

/* Side of a tile in pixels. The tiles are smaller if the picture has fewer than 4 TILE pixels along
 * a side. */
#define TILE         16
#define SATURATED    0.98       /* share of full scale from which a tile counts as saturated */
#define TRANSFER_TOP 0.7        /* the slope is fitted up to 70 % of saturation (EMVA 1288 §6.6) */
#define MIN_RANGE    0.15       /* part of full scale that the brightest tile must reach */
#define ALIKE        0.05       /* largest relative difference of the means of a pair */
#define ROUNDING     (1.0 / 12) /* variance of quantisation, DN² */

G_DEFINE_QUARK(transfer_error, transfer_error)

struct tile {
    /* `mean` is that of both pictures, in DN. `variance` is the temporal variance of one pixel, in
     * DN². */
    double mean, variance;
    double n; /* number of pixels; 0 if any pixel is saturated */
};

/* All tiles of a pair. */
struct tiles {
    double exposure_s;
    double mean, variance, n;
    struct tile *tile;
};

struct fit {
    const struct transfer_sensor *sensor;
    int side, n_tiles;
    struct tiles *dark, *lit;
    int n_dark, n_lit;
    struct transfer *to;
};

static double full_scale(const struct fit *fit) {
    return (double)((1 << fit->sensor->bits) - 1);
}

/* Measures a tile of a pair. The temporal variance is half the variance of the difference of both
 * pictures about its mean (EMVA 1288 release 4.0, eq. 17). n is 0 if a pixel is saturated. */
static struct tile photon_transfer_measure_tile(const struct fit *fit,
                                                const struct transfer_pair *pair, int index) {
    int columns = fit->sensor->width / fit->side;
    int x0 = index % columns * fit->side, y0 = index / columns * fit->side;
    double sum = 0, difference = 0, squares = 0, top = 0;
    for (int y = y0; y < y0 + fit->side; y++)
        for (int x = x0; x < x0 + fit->side; x++) {
            gsize at = (gsize)y * (gsize)fit->sensor->width + (gsize)x;
            double a = pair->first[at], b = pair->second[at];
            sum += a + b;
            difference += a - b;
            squares += (a - b) * (a - b);
            top = MAX(top, MAX(a, b));
        }
    double n = (double)fit->side * fit->side;
    struct tile tile = {sum / (2 * n), (squares - difference * difference / n) / (2 * (n - 1)), n};
    if (top >= SATURATED * full_scale(fit))
        tile.n = 0;
    return tile;
}

/* Refuses a pair in three cases: a value is not finite, both pictures are identical and not black,
 * or their means differ by more than the fraction ALIKE. */
static gboolean check_pair(const struct fit *fit, const struct transfer_pair *pair,
                           const char *what, GError **error) {
    gsize n = (gsize)fit->sensor->width * (gsize)fit->sensor->height, same = 0;
    double first = 0, second = 0;
    gboolean finite = TRUE;
    for (gsize i = 0; i < n; i++) {
        finite &= isfinite(pair->first[i]) && isfinite(pair->second[i]);
        same += pair->first[i] == pair->second[i];
        first += pair->first[i];
        second += pair->second[i];
    }
    if (!finite)
        g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_DATA,
                    "the %s pair at %g µs has a pixel that is not a number; capture the pair again",
                    what, pair->exposure_us);
    else if (same == n && first > 0)
        g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_DATA,
                    "the %s pair at %g µs is the same picture twice, so its noise cannot be "
                    "measured; take two pictures",
                    what, pair->exposure_us);
    else if (fabs(first - second) > ALIKE * 0.5 * (first + second))
        g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_DATA,
                    "the mean brightnesses of the %s pair at %g µs differ by %.1f %%, and at most "
                    "%g %% is allowed; %s, and keep other light out",
                    what, pair->exposure_us, 100 * fabs(first - second) / (0.5 * (first + second)),
                    100 * ALIKE,
                    g_str_equal(what, "dark") ? "let the camera warm up" : "let the lamps warm up");
    else
        return TRUE;
    return FALSE;
}

static gboolean photon_transfer_measure(struct fit *fit, const struct transfer_pair *pairs, int n,
                                        const char *what, struct tiles *ret, GError **error) {
    for (int i = 0; i < n; i++) {
        if (!check_pair(fit, &pairs[i], what, error))
            return FALSE;
        ret[i].exposure_s = pairs[i].exposure_us * 1e-6;
        ret[i].tile = g_new(struct tile, fit->n_tiles);
        for (int k = 0; k < fit->n_tiles; k++) {
            struct tile tile = ret[i].tile[k] = photon_transfer_measure_tile(fit, &pairs[i], k);
            ret[i].mean += tile.mean * tile.n;
            ret[i].variance += tile.variance * tile.n;
            ret[i].n += tile.n;
        }
        if (ret[i].n > 0) {
            ret[i].mean /= ret[i].n;
            ret[i].variance /= ret[i].n;
        }
    }
    return TRUE;
}

/* Sums for the weighted least squares of a line y = a + b·x. */
struct line {
    double w, wx, wy, wxx, wxy;
};

static void line_add(struct line *line, double x, double y, double weight) {
    line->w += weight;
    line->wx += weight * x;
    line->wy += weight * y;
    line->wxx += weight * x * x;
    line->wxy += weight * x * y;
}

static gboolean line_fit(const struct line *line, double *ret_a, double *ret_b, double *ret_error_a,
                         double *ret_error_b) {
    double det = line->w * line->wxx - line->wx * line->wx; /* 0 if all x are equal */
    if (!(det > 1e-9 * line->w * line->wxx))
        return FALSE;
    *ret_a = (line->wxx * line->wy - line->wx * line->wxy) / det;
    *ret_b = (line->w * line->wxy - line->wx * line->wy) / det;
    *ret_error_a = sqrt(line->wxx / det);
    *ret_error_b = sqrt(line->w / det);
    return TRUE;
}

/* Fits black level and dark current: dark mean = black + dark current · exposure (EMVA 1288 §7.1).
 * Returns FALSE with an error if fewer than two exposures have a dark pair that is not saturated
 * everywhere. */
static gboolean fit_dark(struct fit *fit, GError **error) {
    struct line line = {0};
    for (int i = 0; i < fit->n_dark; i++) {
        const struct tiles *dark = &fit->dark[i];
        if (dark->n > 0)
            line_add(&line, dark->exposure_s, dark->mean,
                     2 * dark->n / MAX(dark->variance, ROUNDING));
    }
    struct transfer *to = fit->to;
    if (line_fit(&line, &to->black_dn, &to->dark_dn_s, &to->black_error_dn, &to->dark_error_dn_s))
        return TRUE;
    g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_TOO_FEW,
                "the dark pairs that are not saturated all have one exposure, or there are none; "
                "give exposures in [capture] exposures_us that are far apart, and capture again");
    return FALSE;
}

/* Returns the dark level of a tile. If there are dark pairs with this exposure, it is their mean,
 * otherwise the value of the fitted line. */
static double dark_level(const struct fit *fit, int tile, double exposure_s) {
    double sum = 0;
    int n = 0;
    for (int i = 0; i < fit->n_dark; i++)
        if (fit->dark[i].exposure_s == exposure_s) {
            sum += fit->dark[i].tile[tile].mean;
            n++;
        }
    return n > 0 ? sum / n : fit->to->black_dn + fit->to->dark_dn_s * exposure_s;
}

/* Returns the points of the transfer curve. A point has the signal above the black level, including
 * the dark current, the temporal variance, and the number of pixels. A dark pair gives one point. A
 * lit pair gives a point for each tile that is not saturated and is below TRANSFER_TOP. */
static GArray *transfer_points(const struct fit *fit) {
    GArray *points = g_array_new(FALSE, FALSE, sizeof(struct tile));
    double range = full_scale(fit) - fit->to->black_dn;
    for (int i = 0; i < fit->n_dark; i++) /* one point per dark pair */
        if (fit->dark[i].n > 0) {
            struct tile point = {fit->to->dark_dn_s * fit->dark[i].exposure_s,
                                 fit->dark[i].variance, fit->dark[i].n};
            g_array_append_val(points, point);
        }
    for (int i = 0; i < fit->n_lit; i++)
        for (int k = 0; k < fit->n_tiles; k++) {
            struct tile point = fit->lit[i].tile[k];
            point.mean -= dark_level(fit, k, fit->lit[i].exposure_s);
            /* dark current also causes shot noise */
            point.mean += fit->to->dark_dn_s * fit->lit[i].exposure_s;
            if (point.n > 0 && point.mean < TRANSFER_TOP * range)
                g_array_append_val(points, point);
        }
    return points;
}

/* Fits EMVA 1288 eq. 19, σ² = σ₀² + K · signal. The weights come from the fitted line, because
 * weights from the measured variances would favour points that are too low by chance. Returns FALSE
 * with an error if the pictures are too dark or all equally bright, or if the noise does not grow
 * with the signal. */
static gboolean fit_curve(struct fit *fit, GError **error) {
    g_autoptr(GArray) points = transfer_points(fit);
    double floor = 1, slope = 0.1, floor_error = 0, slope_error = 0, top = 0;
    for (guint i = 0; i < points->len; i++)
        top = MAX(top, g_array_index(points, struct tile, i).mean);
    if (top < MIN_RANGE * (full_scale(fit) - fit->to->black_dn)) {
        g_set_error(
            error, TRANSFER_ERROR, TRANSFER_ERROR_RANGE,
            "the brightest part of the pictures that is below %.0f %% of full scale is %.0f "
            "DN above dark, and at least %.0f DN is needed; expose so that some pictures "
            "are between a third and two thirds of full scale, %.0f DN",
            100 * TRANSFER_TOP, top, MIN_RANGE * (full_scale(fit) - fit->to->black_dn),
            full_scale(fit));
        return FALSE;
    }
    for (int pass = 0; pass < 8; pass++) {
        struct line line = {0};
        for (guint i = 0; i < points->len; i++) {
            const struct tile *p = &g_array_index(points, struct tile, i);
            double model = MAX(floor + slope * p->mean, ROUNDING);
            line_add(&line, p->mean, p->variance, (p->n - 1) / (2 * model * model));
        }
        if (!line_fit(&line, &floor, &slope, &floor_error, &slope_error)) {
            g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_RANGE,
                        "all parts of all pictures are equally bright; give different exposures in "
                        "[capture] exposures_us, each twice, and capture again");
            return FALSE;
        }
        if (!(slope > 0)) {
            g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_RANGE,
                        "the noise does not grow with the light, so the pictures were processed "
                        "(denoised or sharpened); use raw pictures");
            return FALSE;
        }
    }
    struct transfer *to = fit->to;
    double read = MAX(floor - ROUNDING, 0);
    /* quality is χ² per degree of freedom of the transfer curve. The variance of a sample variance
     * is 2σ⁴ / (n − 1). */
    double sum = 0;
    for (guint i = 0; i < points->len; i++) {
        const struct tile *p = &g_array_index(points, struct tile, i);
        double model = MAX(floor + slope * p->mean, ROUNDING), off = p->variance - model;
        sum += off * off * (p->n - 1) / (2 * model * model);
    }
    to->quality = points->len > 2 ? sum / (points->len - 2) : 0;
    double worse = sqrt(MAX(to->quality, 1));
    to->gain_dn_e = slope;
    to->gain_error_dn_e = slope_error * worse;
    to->read_noise_e = sqrt(read) / slope;
    to->read_noise_error_e = hypot(floor_error / (2 * sqrt(MAX(read, floor_error)) * slope),
                                   to->read_noise_e * slope_error / slope) *
                             worse;
    to->n_points = (int)points->len;
    return TRUE;
}

/* The signals y of one tile at all exposures t, for the fit of y = a·t·(1 − c·a·t / range). Each
 * tile has its own a; all tiles share c. */
struct ramp {
    double *t, *y, *weight; /* Three arrays in one block of memory, which is freed by freeing t. */
    int n;
    /* signal per second at small signals */
    double a;
    /* sum_y / sum_t is the slope with weights 1/t. Such weights are right because the variance
     * grows with the signal. */
    double sum_t, sum_y;
};

struct ramps {
    struct ramp *ramp;
    int n;
    double range, curvature, error;
};

/* Makes one Gauss-Newton step for the slopes a of all tiles and the common curvature c. g is the
 * gradient, and A the matrix, of the normal equations. The slopes are eliminated (Schur
 * complement): dc = (g_c − Σ A_ac g_a / A_aa) / (A_cc − Σ A_ac² / A_aa). Returns χ² before the
 * step. */
static double photon_transfer_step(struct ramps *ramps) {
    double schur = 0, right = 0, chi2 = 0, k = 1 / ramps->range;
    g_autofree double *ga = g_new0(double, ramps->n), *aa = g_new0(double, ramps->n);
    g_autofree double *ac = g_new0(double, ramps->n);
    for (int r = 0; r < ramps->n; r++) {
        const struct ramp *ramp = &ramps->ramp[r];
        double cc = 0, gc = 0;
        for (int i = 0; ramp->n >= 3 && i < ramp->n; i++) {
            double at = ramp->a * ramp->t[i], w = ramp->weight[i];
            double off = ramp->y[i] - at * (1 - ramps->curvature * at * k);
            double da = ramp->t[i] * (1 - 2 * ramps->curvature * at * k), dc = -at * at * k;
            aa[r] += w * da * da;
            ac[r] += w * da * dc;
            cc += w * dc * dc;
            ga[r] += w * da * off;
            gc += w * dc * off;
            chi2 += w * off * off;
        }
        if (ramp->n < 3)
            continue;
        schur += cc - ac[r] * ac[r] / aa[r];
        right += gc - ac[r] * ga[r] / aa[r];
    }
    double dc = schur > 0 ? right / schur : 0;
    for (int r = 0; r < ramps->n; r++)
        if (aa[r] > 0)
            ramps->ramp[r].a += (ga[r] - ac[r] * dc) / aa[r];
    ramps->curvature += dc;
    ramps->error = schur > 0 ? 1 / sqrt(schur) : 0;
    return chi2;
}

/* Returns the largest relative deviation of the mean signal at an exposure from the best line
 * through zero. */
static double largest_deviation(const struct fit *fit, const struct ramps *ramps) {
    double worst = 0;
    for (int i = 0; i < fit->n_lit; i++) {
        double off = 0, level = 0, t = fit->lit[i].exposure_s;
        for (int r = 0; r < ramps->n; r++) {
            const struct ramp *ramp = &ramps->ramp[r];
            for (int k = 0; ramp->n >= 3 && k < ramp->n; k++)
                if (ramp->t[k] == t) {
                    off += ramp->y[k] - ramp->sum_y / ramp->sum_t * t;
                    level += ramp->sum_y / ramp->sum_t * t;
                }
        }
        if (level > 0)
            worst = MAX(worst, fabs(off / level));
    }
    return worst;
}

/* Fits the curvature c, which all tiles with three or more exposures share. Also finds the
 * linearity. Returns FALSE with an error if there is no such tile. */
static gboolean fit_linearity(struct fit *fit, GError **error) {
    struct ramps ramps = {.range = full_scale(fit) - fit->to->black_dn};
    ramps.ramp = g_new(struct ramp, fit->n_tiles);
    for (int k = 0; k < fit->n_tiles; k++) {
        /* The signal of a tile over the exposures, weighted by its inverse variance. The slope a
         * starts at the value of the longest exposure. */
        double *block = g_new(double, 3 * fit->n_lit);
        struct ramp ramp = {.t = block, .y = block + fit->n_lit, .weight = block + 2 * fit->n_lit};
        double top = 0;
        for (int i = 0; i < fit->n_lit; i++) {
            const struct tile *lit = &fit->lit[i].tile[k];
            double t = fit->lit[i].exposure_s, y = lit->mean - dark_level(fit, k, t);
            if (lit->n == 0 || !(y > 0))
                continue;
            double variance = lit->variance / (2 * lit->n);
            ramp.sum_t += t;
            ramp.sum_y += y;
            ramp.t[ramp.n] = t;
            ramp.y[ramp.n] = y;
            ramp.weight[ramp.n++] = 1 / MAX(variance, 1e-9);
            if (t > top)
                ramp.a = y / (top = t);
        }
        ramps.ramp[ramps.n++] = ramp;
    }
    double chi2 = 0, n = 0;
    for (int r = 0; r < ramps.n; r++)
        n += ramps.ramp[r].n >= 3 ? ramps.ramp[r].n - 1 : 0;
    for (int i = 0; i < 10; i++)
        chi2 = photon_transfer_step(&ramps);
    fit->to->curvature = ramps.curvature;
    fit->to->curvature_error = n > 1 ? ramps.error * sqrt(MAX(chi2 / (n - 1), 1)) : 0;
    fit->to->linearity = largest_deviation(fit, &ramps);
    for (int r = 0; r < ramps.n; r++)
        g_free(ramps.ramp[r].t);
    g_free(ramps.ramp);
    if (n > 1 && ramps.error > 0 && isfinite(ramps.curvature))
        return TRUE;
    g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_RANGE,
                "every part of the picture is dark or saturated at all exposures but two at most; "
                "give more and shorter exposures in [capture] exposures_us, so that some part is "
                "lit and unsaturated at three or more");
    return FALSE;
}

static void free_tiles(struct tiles *tiles, int n) {
    for (int i = 0; i < n; i++)
        g_free(tiles[i].tile);
    g_free(tiles);
}

gboolean transfer_fit(const struct transfer_sensor *sensor, const struct transfer_pair *dark,
                      int n_dark, const struct transfer_pair *lit, int n_lit, struct transfer *ret,
                      GError **error) {
    if (n_dark < 2 || n_lit < 3) {
        g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_TOO_FEW,
                    "%d dark and %d lit pairs of pictures with equal exposures are too few, and "
                    "two dark and three lit pairs are needed; give at least three different "
                    "exposures in [capture] exposures_us, each twice, and capture again",
                    n_dark, n_lit);
        return FALSE;
    }
    struct transfer found = {0};
    int side = MIN(TILE, MIN(sensor->width, sensor->height) / 4 & ~1);
    struct fit fit = {.sensor = sensor, .side = MAX(side, 2), .n_dark = n_dark, .n_lit = n_lit};
    fit.n_tiles = (sensor->width / fit.side) * (sensor->height / fit.side);
    fit.dark = g_new0(struct tiles, n_dark);
    fit.lit = g_new0(struct tiles, n_lit);
    fit.to = &found;
    gboolean ok = photon_transfer_measure(&fit, dark, n_dark, "dark", fit.dark, error) &&
                  photon_transfer_measure(&fit, lit, n_lit, "lit", fit.lit, error) &&
                  fit_dark(&fit, error) && fit_curve(&fit, error) && fit_linearity(&fit, error);
    free_tiles(fit.dark, n_dark);
    free_tiles(fit.lit, n_lit);
    if (ok)
        *ret = found;
    return ok;
}

/* The merged value is m = Σ DN / T, where T is the sum of the exposures. Let K be the gain, σ_r the
 * read noise and d the dark current in DN/ms. Photons and dark electrons contribute the variance
 * K·(m + d)·T, each readout K²σ_r², and each rounding to whole DN 1/12:
 *   var(m) = K·(m + d)/T + n·(K²σ_r² + 1/12)/T². */
void transfer_noise(const struct transfer *transfer, double sum_ms, int n, double *ret_floor,
                    double *ret_slope) {
    const double gain = transfer->gain_dn_e, read = gain * transfer->read_noise_e;
    *ret_slope = gain / sum_ms;
    *ret_floor = *ret_slope * fmax(transfer->dark_dn_s, 0) * 1e-3 +
                 n * (read * read + 1.0 / 12) / (sum_ms * sum_ms);
}
