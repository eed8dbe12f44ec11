#include "laser_frames.h"

#include <glib.h>
#include <math.h>

#include "base/robust.h"

/* Number of frames of the running median. If the sheet slips for more than half this number of
 * frames, the median follows. */
#define AROUND 21
/* a difference is significant if it is larger than this number of standard errors */
#define MANY   4.0
#define ROUNDS 6
/* Standard errors of median and median absolute deviation of n normal deviates, in σ / √n. */
#define MEDIAN_ERROR 1.2533
#define SPREAD_ERROR 1.17

/* Sets the level of each frame with a line to the median of all such frames. If the median of the
 * AROUND nearest such frames differs significantly, that median is the level. */
static void find_levels(struct laser_frames *frames, const int *lines) {
    g_autofree double *all = g_new(double, frames->lines);
    for (int i = 0; i < frames->lines; i++)
        all[i] = frames->middle[lines[i]];
    const double whole = robust_median(all, frames->lines);
    for (int i = 0; i < frames->lines; i++) {
        frames->level[lines[i]] = whole;
        if (frames->lines < AROUND)
            continue;
        double near[AROUND];
        const int first = CLAMP(i - AROUND / 2, 0, frames->lines - AROUND);
        for (int k = 0; k < AROUND; k++)
            near[k] = frames->middle[lines[first + k]];
        const double level = robust_median(near, AROUND);
        const double error = MEDIAN_ERROR * robust_spread(near, AROUND, level) / sqrt(AROUND);
        if (fabs(level - whole) > MANY * hypot(error, frames->error[lines[i]]))
            frames->level[lines[i]] = level;
    }
}

/* Returns the standard deviation u of the frames from their levels that the standard errors do not
 * explain: u = √(s² − e²), where s is the robust spread of middle − level and e is the median
 * standard error. Returns 0 if s is not significantly larger than e. */
static double find_uneven(const struct laser_frames *frames, const int *lines) {
    const int n = frames->lines;
    g_autofree double *off = g_new(double, n), *errors = g_new(double, n);
    for (int i = 0; i < n; i++) {
        off[i] = frames->middle[lines[i]] - frames->level[lines[i]];
        errors[i] = frames->error[lines[i]];
    }
    const double spread = robust_spread(off, n, 0), error = robust_median(errors, n);
    const double chance = 1 + MANY * SPREAD_ERROR / sqrt(n);
    return spread > chance * error ? sqrt(spread * spread - error * error) : 0;
}

/* Adds to all levels the mean of r = middle − level, with weights w = biweight(r − mean, e) / e²
 * (Tukey), e² = error² + uneven². Sets offset to the mean level, and offset_error to 1 / √Σw. */
static void find_offset(struct laser_frames *frames, const int *lines, double uneven) {
    double shift = 0, weights = 0, levels = 0;
    for (int round = 0; round < ROUNDS; round++) {
        double sum = 0;
        weights = 0;
        for (int i = 0; i < frames->lines; i++) {
            const int k = lines[i];
            const double error = hypot(frames->error[k], uneven);
            const double off = frames->middle[k] - frames->level[k];
            const double weight = robust_biweight(off - shift, error) / (error * error);
            weights += weight;
            sum += weight * off;
        }
        if (!(weights > 0))
            break;
        shift = sum / weights;
    }
    for (int i = 0; i < frames->lines; i++) {
        frames->level[lines[i]] += shift;
        levels += frames->level[lines[i]] / frames->lines;
    }
    frames->offset = levels;
    frames->offset_error = weights > 0 ? 1 / sqrt(weights) : INFINITY;
}

/* Sets own to the deviation of a frame from its level times u² / (u² + error²), with u from
 * find_uneven(). own is 0 for outliers and for frames without a line. */
void laser_frames_settle(struct laser_frames *frames) {
    g_autofree int *lines = g_new0(int, frames->n);
    frames->lines = 0;
    for (int k = 0; k < frames->n; k++) {
        frames->own[k] = 0;
        if (isfinite(frames->middle[k]))
            lines[frames->lines++] = k;
    }
    g_return_if_fail(frames->lines > 0);
    find_levels(frames, lines);
    const double uneven = find_uneven(frames, lines);
    find_offset(frames, lines, uneven);
    for (int i = 0; i < frames->lines; i++) {
        const int k = lines[i];
        const double off = frames->middle[k] - frames->level[k];
        if (fabs(off) <= MANY * hypot(frames->error[k], uneven))
            frames->own[k] = robust_shrink(off, frames->error[k], uneven);
    }
    /* Frames without a line get the level of the nearest frame with one. */
    for (int k = 0, i = 0; k < frames->n; k++) {
        while (i + 1 < frames->lines && abs(lines[i + 1] - k) < abs(lines[i] - k))
            i++;
        frames->level[k] = frames->level[lines[i]];
    }
}
