#include "radiance.h"

#include <math.h>

/* Minimum mean difference, as a part of full scale, from which two exposures may count as
 * contradicting each other. */
#define UNEVEN_PART 0.0025

int radiance_saturation(int bits) {
    return (int)ceil(0.98 * ((1 << bits) - 1));
}

gint64 radiance_saturated(const Frame *frame) {
    gsize n = (gsize)frame->width * frame->height;
    int limit = radiance_saturation(frame->bits);
    gint64 saturated = 0;
    for (gsize i = 0; i < n; i++)
        saturated += frame->pixels[i] >= limit;
    return saturated;
}

static double mean_above(const Frame *frame, const float *dark) {
    gsize n = (gsize)frame->width * frame->height;
    double sum = 0;
    for (gsize i = 0; i < n; i++)
        sum += frame->pixels[i] - (double)dark[i];
    return n > 0 ? sum / n : 0;
}

/* Returns the signal x of a pixel from its value y = x·(1 − bend·x) DN above dark. Beyond the
 * vertex of the parabola there is no solution. The result is then proportional to y, with the
 * factor at the vertex. */
static inline float straight(float above_dark, float bend) {
    if (bend == 0)
        return above_dark;
    const float root = 1 - 4 * bend * above_dark;
    return 2 * above_dark / (1 + sqrtf(MAX(root, 0)));
}

/* The value of a pixel is Σ x_i / Σ t_i, where x_i is the value in DN above dark at the exposure
 * t_i. The sums go over the first k exposures, the shortest first. Exposure k is the longest one at
 * which a pixel of this mean value is not saturated.
 *
 * It would be wrong to leave out each exposure that is saturated itself. Exposures that are
 * brighter because of noise would then be missing, and the mean would be too dark.
 *
 * The choice of k causes no bias. The reason is that weights by exposure are optimal for photon
 * noise: the error of the mean over all exposures is then uncorrelated with the additional error of
 * a mean over fewer exposures. */
void radiance_merge(const Frame *const *frames, const float *const *dark, int n, double gain_db,
                    double bend_per_dn, float *ret, struct radiance_stats *ret_stats) {
    gsize n_pixels = (gsize)frames[0]->width * frames[0]->height;
    const int limit = radiance_saturation(frames[0]->bits), full = (1 << frames[0]->bits) - 1;
    float scale = (float)pow(10, -gain_db / 20), bend = (float)bend_per_dn;
    g_autofree float *ms = g_new0(float, n);
    for (int i = 0; i < n; i++)
        ms[i] = frames[i]->exposure_us * 1e-3f;
    gint64 saturated = 0;
    for (gsize p = 0; p < n_pixels; p++) {
        float sum = 0, time = 0, all = 0, all_ms = 0;
        for (int i = 0; i < n; i++) {
            all += straight(frames[i]->pixels[p] - dark[i][p], bend);
            all_ms += ms[i];
            if (frames[i]->pixels[p] < full &&
                all * ms[i] < straight((float)limit - dark[i][p], bend) * all_ms) {
                sum = all;
                time = all_ms;
            }
        }
        if (time <= 0) {
            saturated++;
            sum = straight(frames[0]->pixels[p] - dark[0][p], bend);
            time = ms[0];
        }
        ret[p] = sum / time * scale;
    }
    ret_stats->saturated = saturated;
    ret_stats->signal_dn = mean_above(frames[n - 1], dark[n - 1]);
}

gboolean radiance_disagrees(const Frame *const *frames, const float *const *dark, int n) {
    const gsize n_pixels = (gsize)frames[0]->width * frames[0]->height;
    const int limit = radiance_saturation(frames[0]->bits), full = (1 << frames[0]->bits) - 1;
    for (int i = 1; i < n; i++) {
        const Frame *shorter = frames[i - 1], *longer = frames[i];
        const double part = (double)shorter->exposure_us / (double)longer->exposure_us;
        double sums[2] = {0};
        gsize count = 0;
        for (gsize p = 0; p < n_pixels; p++) {
            if (shorter->pixels[p] >= limit || longer->pixels[p] >= limit)
                continue;
            sums[0] += shorter->pixels[p] - (double)dark[i - 1][p];
            sums[1] += longer->pixels[p] - (double)dark[i][p];
            count++;
        }
        const double least = UNEVEN_PART * full * (double)count, expected = sums[1] * part;
        if (count > 0 &&
            (sums[0] - sums[1] > least || (expected > 2 * sums[0] && expected - sums[0] > least)))
            return TRUE;
    }
    return FALSE;
}

double radiance_ceiling(int bits, gint64 exposure_us, double dark_dn, double gain_db,
                        double bend_per_dn) {
    float above_dark = (float)(radiance_saturation(bits) - dark_dn);
    return (double)straight(above_dark, (float)bend_per_dn) * 1e3 / (double)exposure_us *
           pow(10, -gain_db / 20);
}

void radiance_mark(const Frame *const *frames, int n, float *ret) {
    const gsize n_pixels = (gsize)frames[0]->width * frames[0]->height;
    const int limit = radiance_saturation(frames[0]->bits);
    for (gsize p = 0; p < n_pixels; p++) {
        gboolean all = TRUE;
        for (int i = 0; i < n && all; i++)
            all = frames[i]->pixels[p] >= limit;
        ret[p] = all ? 1 : 0;
    }
}

void radiance_add(const Frame *frame, guint32 *sums) {
    gsize n = (gsize)frame->width * frame->height;
    for (gsize i = 0; i < n; i++)
        sums[i] += frame->pixels[i];
}

double radiance_mean(const guint32 *sums, int n, gsize n_pixels, float *ret) {
    double total = 0;
    for (gsize i = 0; i < n_pixels; i++) {
        ret[i] = (float)((double)sums[i] / n);
        total += ret[i];
    }
    return n_pixels > 0 ? total / n_pixels : 0;
}

gint64 radiance_lit(const Frame *frame, const float *dark, double margin_dn) {
    gsize n = (gsize)frame->width * frame->height;
    gint64 lit = 0;
    for (gsize i = 0; i < n; i++)
        lit += frame->pixels[i] - dark[i] > margin_dn;
    return lit;
}
