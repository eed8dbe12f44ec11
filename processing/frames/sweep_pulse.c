#include "sweep_pulse.h"

#include <math.h>

/* a minimum below this share of the fainter of two peaks separates the peaks */
#define VALLEY 0.6f
/* samples below this share of the maximum are left out, because they may belong to another line */
#define WINGS 0.12f
/* assumed mean of the samples next to a pulse that are below the margin, relative to the margin */
#define FAINT   0.6f
#define READ_DN 5.0f /* value in DN at which shot noise equals read noise */
#define MAX_LOG 20   /* upper bound of ln(height in DN) */
/* the fit leaves out samples whose fitted value is below this multiple of the margin */
#define DOUBT 1.3
/* the multiple that replaces DOUBT if the samples at both ends are below the margin */
#define KNOWN 0.4

/* The samples of one pulse, first … last. top is the first one of the brightest samples. */
struct span {
    int first, last, top;
};

/* Returns the pulse that begins at sample `first`. The pulse ends where the frames are not
 * consecutive, or at a minimum after which the samples rise again. Such a minimum ends the pulse if
 * it is below VALLEY times the fainter of the peaks before and after it. */
static struct span span_from(const struct sweep_samples *s, int first) {
    struct span span = {first, first, first};
    int low = first;
    for (int k = first + 1; k < s->n && s->frame[k] == s->frame[k - 1] + 1; k++) {
        float peak = s->value[span.top];
        if (s->value[k] > peak && s->value[low] >= VALLEY * peak) {
            span.top = low = k;
        } else if (s->value[k] < s->value[low]) {
            low = k;
        } else if (s->value[low] < VALLEY * MIN(peak, s->value[k])) {
            span.last = low;
            return span;
        }
        span.last = k;
    }
    return span;
}

/* Normal equations of c0 + c1·t + c2·t² through logarithms y: m[i] = Σ w tⁱ, v[i] = Σ w tⁱ y. */
struct sums {
    double m[5], v[3];
};

static void add_sample(struct sums *sums, double t, double y, double weight) {
    double power = weight;
    for (int i = 0; i < 5; i++, power *= t) {
        sums->m[i] += power;
        if (i < 3)
            sums->v[i] += power * y;
    }
}

/* Solves M c = v, M_ij = m[i + j] (3 × 3), by Cramer's rule. Returns FALSE if M is singular. */
static gboolean solve(const struct sums *sums, double c[3]) {
    const double *m = sums->m, *v = sums->v;
    double a = m[2] * m[4] - m[3] * m[3], b = m[2] * m[3] - m[1] * m[4];
    double d = m[1] * m[3] - m[2] * m[2];
    double det = m[0] * a + m[1] * b + m[2] * d;
    if (!(fabs(det) > 1e-9 * m[0] * m[2] * m[4]))
        return FALSE;
    double e = m[0] * m[4] - m[2] * m[2], f = m[1] * m[2] - m[0] * m[3];
    double g = m[0] * m[2] - m[1] * m[1];
    c[0] = (a * v[0] + b * v[1] + d * v[2]) / det;
    c[1] = (b * v[0] + e * v[1] + f * v[2]) / det;
    c[2] = (d * v[0] + f * v[1] + g * v[2]) / det;
    return TRUE;
}

/* A fitted Gaussian f with ln f(t) = c0 + c1·t + c2·t². Its time is −c1 / 2c2, its width σ = √(−1 /
 * 2c2). */
struct gaussian {
    double time, width, c[3];
};

/* The logarithm of a Gaussian is a parabola (Guo 2011). The weight of a sample is the inverse
 * variance of its logarithm, y² / (g (y + g·READ_DN)) for a gain g, from shot noise and read
 * noise. */
static double weight_of(const struct sweep_samples *s, int k, double value) {
    const double gain = s->gain ? s->gain[k] : 1;
    return value * value / (gain * (value + gain * READ_DN));
}

/* Fits the unsaturated samples of a pulse. Times are relative to `middle`. Returns FALSE if there
 * is no fit, or if the time of the fit is more than a frame outside of `part`.
 *
 * If `old` is NULL, fits the parabola through the logarithms ln y of the samples y above the
 * margin. Otherwise makes one Gauss-Newton step from the fit `old`, f, with y' = ln f + (y − f) / f
 * instead of ln y. Noise biases ln y but not y'. Therefore this step uses dark samples as well. It
 * leaves out only samples that are so dark that noise decides whether they are recorded. */
static gboolean fit(const struct sweep_samples *s, const struct span *part, double middle,
                    const struct gaussian *old, struct gaussian *ret) {
    const double height =
        old ? exp(MIN(old->c[0] - 0.25 * old->c[1] * old->c[1] / old->c[2], MAX_LOG)) : 0;
    const gboolean known = s->value[part->first] <= s->margin && s->value[part->last] <= s->margin;
    const double faint = (known ? KNOWN : DOUBT) * (double)s->margin;
    const double least = MAX(WINGS * height, faint);
    struct sums sums = {0};
    int used = 0;
    for (int k = part->first; k <= part->last; k++) {
        const double t = s->frame[k] - middle;
        double y = s->value[k], model = y;
        if (y >= s->full || (!old && y <= s->margin))
            continue;
        if (old) {
            const double off = t - old->time;
            if (height * exp(-0.5 * off * off / (old->width * old->width)) < least)
                continue;
            const double level = MIN(old->c[0] + (old->c[1] + old->c[2] * t) * t, MAX_LOG);
            model = exp(level);
            y = level + ((double)(s->value[k] - s->pedestal) - model) / model;
        } else {
            y = log(y);
        }
        add_sample(&sums, t, y, weight_of(s, k, model));
        used++;
    }
    if (used < 3 || !solve(&sums, ret->c) || !(ret->c[2] < 0))
        return FALSE;
    ret->time = -ret->c[1] / (2 * ret->c[2]);
    ret->width = sqrt(-0.5 / ret->c[2]);
    return s->frame[part->first] - 1 <= middle + ret->time &&
           middle + ret->time <= s->frame[part->last] + 1;
}

/* Returns the value of sample k if it is above the margin and in the pulse. Otherwise returns the
 * expected value of a sample below the margin, which is not 0. */
static double value_at(const struct sweep_samples *s, const struct span *span, int k) {
    return k >= span->first && k <= span->last && s->value[k] > s->margin ? (double)s->value[k]
                                                                          : FAINT * s->margin;
}

/* Fits a pulse of one or two samples by the Gaussian through three samples. Samples that the pulse
 * lacks have the value that value_at() gives. With the logarithms a, b, c of the samples at the
 * times −1, 0, 1: time = ½ (a − c) / (a − 2b + c), σ² = −1 / (a − 2b + c). */
static void between_few(const struct sweep_samples *s, const struct span *span, int length,
                        struct sweep_pulse *ret) {
    double a = log(value_at(s, span, span->top - 1)), b = log((double)s->value[span->top]);
    double c = length > 1 ? b : log(value_at(s, span, span->top + 1)), curvature = a - 2 * b + c;
    ret->time = s->frame[span->top];
    ret->width = 0.5;
    if (!(curvature < 0))
        return;
    ret->time += CLAMP(0.5 * (a - c) / curvature, -0.5, 0.5);
    ret->width = 1 / sqrt(-curvature);
}

/* Fits a pulse with a plateau: n frames with the maximum value `top`. On average, the pulse crosses
 * this value half a frame beyond the first and the last frame of the plateau, that is, n/2 from the
 * centre. With the geometric mean g of the neighbours, which are at h = (n + 1)/2 from the centre,
 * σ² = (h² − n²/4) / (2 ln(top / g)). The ratio of the neighbours gives the centre. */
static void across_plateau(const struct sweep_samples *s, const struct span *span, int length,
                           struct sweep_pulse *ret) {
    double top = s->value[span->top], half = 0.5 * (length + 1), low = 0.01 * top;
    double a = value_at(s, span, span->top - 1), c = value_at(s, span, span->top + length);
    double ratio = log(top / CLAMP(sqrt(MAX(a, low) * MAX(c, low)), low, 0.95 * top));
    double variance = (half * half - 0.25 * length * length) / (2 * ratio);
    ret->width = sqrt(variance);
    ret->time = s->frame[span->top] + 0.5 * (length - 1);
    if (a > 0 && c > 0)
        ret->time += CLAMP(0.5 * variance * log(c / a) / half, -0.5, 0.5);
}

/* Returns the plateau, the samples around it that are above WINGS times the maximum, and in any
 * case one sample on each side. */
static struct span bright_part(const struct sweep_samples *s, const struct span *span, int length) {
    struct span part = {span->top, span->top + length - 1, span->top};
    double least = WINGS * s->value[span->top];
    do
        part.first -= part.first > span->first;
    while (part.first > span->first && s->value[part.first - 1] >= least);
    do
        part.last += part.last < span->last;
    while (part.last < span->last && s->value[part.last + 1] >= least);
    return part;
}

static void measure(const struct sweep_samples *s, const struct span *span,
                    struct sweep_pulse *ret) {
    int length = 1; /* number of consecutive frames at the maximum */
    while (span->top + length <= span->last && s->value[span->top + length] >= s->value[span->top])
        length++;
    int begin = s->frame[span->top], end = begin + length - 1;
    *ret = (struct sweep_pulse){-1, 0, s->value[span->top]};
    if (begin == s->first || end + 1 >= s->count)
        return;
    struct span part = bright_part(s, span, length);
    struct gaussian first, better;
    const double middle = 0.5 * (begin + end);
    if (fit(s, &part, middle, NULL, &first)) {
        if (!fit(s, &part, middle, &first, &better))
            better = first;
        ret->time = middle + better.time;
        ret->width = better.width;
        return;
    }
    /* If the pulse begins in the first frame, a flank is missing, because the samples of this flank
     * were taken as background. */
    if (s->frame[span->first] == s->first)
        return;
    if (length > 2 || s->value[span->top] >= s->full)
        across_plateau(s, span, length, ret);
    else
        between_few(s, span, length, ret);
}

int sweep_pulse_find(const struct sweep_samples *samples, struct sweep_pulse *ret_first,
                     struct sweep_pulse *ret_second) {
    struct span best[2] = {{0, -1, 0}, {0, -1, 0}};
    int found = 0;
    for (int k = 0; k < samples->n;) {
        struct span span = span_from(samples, k);
        float height = samples->value[span.top];
        if (found == 0 || height > samples->value[best[0].top]) {
            best[1] = best[0];
            best[0] = span;
        } else if (found == 1 || height > samples->value[best[1].top]) {
            best[1] = span;
        }
        found = MIN(found + 1, 2);
        k = span.last + 1;
    }
    if (found > 0 && ret_first)
        measure(samples, &best[0], ret_first);
    if (found > 1 && ret_second)
        measure(samples, &best[1], ret_second);
    return found;
}
