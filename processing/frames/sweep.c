#include "sweep.h"

#include <stdlib.h>
#include <string.h>

#include "sweep_pulse.h"

#define MIN_MARGIN 4  /* DN: lower bound of the margin above the background */
#define MAX_MARGIN 64 /* the margin grows to at most saturation / MAX_MARGIN */
/* minimum number of pixels for measuring noise; in a smaller picture a line may light all of
 * them */
#define FEW_PIXELS   256
#define NOISE_PIXELS 1024 /* number of pixels from which the noise is measured */
#define NOISE_MARGIN 6 /* margin in σ; the minimum of many samples is 2 … 3 σ below the mean */
#define MEDIAN       0.954 /* median |a − b| of two normal deviates, in σ */
#define DARKEST      2.5   /* distance between the minimum of many samples and their mean, in σ */
/* number of frames at the start of a sweep whose successive pairs measure noise */
#define NOISE_FRAMES 5
/* a pair of frames is odd if its difference is larger than ODD_RATIO · (the difference of a later
 * pair) + ODD_DN */
#define ODD_RATIO 2
#define ODD_DN    2 /* DN, see ODD_RATIO */
/* the maximum number of records per vector is CROWDED + ¾ of the number of frames */
#define CROWDED 8

/* Number of pixels of a SIMD vector. If one pixel of a vector is lit, all pixels of the vector are
 * recorded. Comparisons of GCC vectors give −1 or 0. */
#define LANES   16
#define GROUP   4 /* number of vectors that are tested together */
#define NOTHING G_MAXUINT32

/* number of frames for which absorb_dark() updates the backgrounds together */
#define TOGETHER 4
/* pixels in a page of memory; hardware prefetching stops at the end of a page */
#define AHEAD 2048
typedef guint16 lanes __attribute__((vector_size(2 * LANES), aligned(2), may_alias));
typedef guint64 wide __attribute__((vector_size(2 * LANES)));

struct record {
    guint16 value[LANES];
    guint32 previous; /* previous record of the same vector, or NOTHING */
    guint32 frame;
};

struct Sweep {
    gsize n_pixels, n_vectors;
    /* n_frames: number of frames of the sweep
     * count: number of frames that were added so far */
    int n_frames, count;
    int first; /* first frame that is included in the backgrounds */
    guint16 saturation, margin;
    guint16 sample[NOISE_PIXELS]; /* sampled pixels of the previous frame */
    int difference;               /* median difference of the pair that set the margin */
    /* DN: expected difference between the mean and the minimum of a pixel's unlit samples */
    float pedestal;
    guint16 *darkest; /* minimum of each pixel; n_vectors × LANES */
    /* pixels of the frame `first`, n_vectors × LANES; compared with the background only when the
     * pulses are found */
    guint16 *opening;
    guint32 *last; /* newest record of each vector, or NOTHING */
    struct record *records;
    gsize n_records;
    gsize room;           /* number of records for which memory is allocated */
    gsize crowded;        /* number of records above which the margin grows */
    const Sweep *shorter; /* the sweep of sweep_set_shorter(); NULL if there is none */
    float ratio;          /* exposure of this sweep, divided by the exposure of `shorter` */
};

Sweep *sweep_new(int width, int height, int n_frames, int saturation) {
    g_return_val_if_fail(width > 0 && height > 0, NULL);
    g_return_val_if_fail(n_frames > 0 && n_frames <= G_MAXINT16, NULL);
    Sweep *sweep = g_new0(Sweep, 1);
    sweep->n_pixels = (gsize)width * (gsize)height;
    sweep->n_vectors = (sweep->n_pixels + LANES - 1) / LANES;
    sweep->n_frames = n_frames;
    sweep->saturation = (guint16)CLAMP(saturation, 1, G_MAXUINT16);
    sweep->margin = MIN_MARGIN;
    sweep->darkest = g_new(guint16, sweep->n_vectors * LANES);
    memset(sweep->darkest, 0xff, sizeof(guint16) * sweep->n_vectors * LANES);
    sweep->opening = g_new0(guint16, sweep->n_vectors * LANES);
    sweep->last = g_new(guint32, sweep->n_vectors);
    memset(sweep->last, 0xff, sizeof(guint32) * sweep->n_vectors);
    sweep->crowded = sweep->n_vectors * (CROWDED + (gsize)n_frames * 3 / 4);
    return sweep;
}

void sweep_free(Sweep *sweep) {
    if (!sweep)
        return;
    g_free(sweep->darkest);
    g_free(sweep->opening);
    g_free(sweep->last);
    g_free(sweep->records);
    g_free(sweep);
}

gsize sweep_bytes(const Sweep *sweep) {
    return sizeof *sweep + sweep->n_vectors * (2 * LANES * sizeof(guint16) + sizeof(guint32)) +
           sweep->n_records * sizeof(struct record);
}

/* Records a vector if any of its pixels exceeds its background by more than the margin. */
static inline __attribute__((always_inline)) void keep_if_lit(Sweep *sweep, gsize vector,
                                                              const guint16 *pixels, int frame) {
    struct record *record = &sweep->records[sweep->n_records];
    lanes value = *(const lanes *)pixels, most = (lanes){} + sweep->saturation;
    lanes clipped = (lanes)(value > most);
    value = (clipped & most) | (~clipped & value);
    lanes dark = *(const lanes *)(sweep->darkest + vector * LANES);
    wide lit = (wide)(value - dark > sweep->margin);
    if (!(lit[0] | lit[1] | lit[2] | lit[3]))
        return;
    memcpy(record->value, &value, sizeof value);
    record->previous = sweep->last[vector];
    record->frame = (guint32)frame;
    sweep->last[vector] = (guint32)sweep->n_records++;
}

/* Updates the backgrounds of n vectors (a compile-time constant) and records the lit ones. */
static inline __attribute__((always_inline)) void absorb_some(Sweep *sweep, const guint16 *pixels,
                                                              gsize vector, int n, int frame) {
    guint16 *restrict darkest = sweep->darkest + vector * LANES;
    guint16 saturation = sweep->saturation, brightest = 0;
    for (int i = 0; i < n * LANES; i++) {
        guint16 value = MIN(pixels[i], saturation), dark = MIN(value, darkest[i]);
        guint16 above = (guint16)(value - dark);
        darkest[i] = dark;
        brightest = MAX(brightest, above);
    }
    for (int k = 0; k < n && brightest > sweep->margin; k++)
        keep_if_lit(sweep, vector + (gsize)k, pixels + k * LANES, frame);
}

/* Takes a pixel's next sample. Limits the sample to saturation. *darkest is the minimum of the
 * pixel's samples, including this one. Returns the limited sample minus *darkest. */
static inline guint16 above_dark(guint16 sample, guint16 saturation, guint16 *darkest) {
    guint16 value = MIN(sample, saturation);
    *darkest = MIN(value, *darkest);
    return (guint16)(value - *darkest);
}

/* Updates the backgrounds like absorb_some(), for GROUP vectors and TOGETHER frames. Returns FALSE,
 * and changes nothing, if any vector may be lit. */
static inline __attribute__((always_inline)) gboolean
absorb_dark(Sweep *sweep, const guint16 *const *frames, gsize vector) {
    guint16 *restrict darkest = sweep->darkest + vector * LANES;
    const guint16 *restrict a = frames[0] + vector * LANES, *restrict b =
                                                                frames[1] + vector * LANES;
    const guint16 *restrict c = frames[2] + vector * LANES, *restrict d =
                                                                frames[3] + vector * LANES;
    guint16 saturation = sweep->saturation, brightest = 0, before[GROUP * LANES];
    for (int k = 0; k < TOGETHER; k++)
        for (gsize i = 0; i < GROUP * LANES; i += 32)
            __builtin_prefetch(frames[k] + vector * LANES + AHEAD + i);
    for (int i = 0; i < GROUP * LANES; i++) {
        guint16 dark = darkest[i];
        before[i] = dark;
        guint16 first = above_dark(a[i], saturation, &dark);
        guint16 second = above_dark(b[i], saturation, &dark);
        guint16 third = above_dark(c[i], saturation, &dark);
        guint16 fourth = above_dark(d[i], saturation, &dark);
        darkest[i] = dark;
        brightest = MAX(brightest, MAX(MAX(first, second), MAX(third, fourth)));
    }
    if (brightest > sweep->margin)
        memcpy(darkest, before, sizeof before);
    return brightest <= sweep->margin;
}

static inline void reserve(Sweep *sweep, gsize n_records) {
    if (G_LIKELY(sweep->n_records + n_records <= sweep->room))
        return;
    sweep->room = MAX(2 * sweep->room, sweep->n_records + sweep->n_vectors + n_records);
    sweep->records = g_renew(struct record, sweep->records, sweep->room);
}

/* Updates backgrounds and records of all whole vectors from n frames. n is TOGETHER or 1, a
 * compile-time constant. */
static inline __attribute__((always_inline)) void
sweep_absorb(Sweep *sweep, const guint16 *const *frames, int n) {
    const gsize n_vectors = sweep->n_pixels / LANES;
    gsize v = 0;
    for (; v + GROUP <= n_vectors; v += GROUP) {
        if (n == TOGETHER && absorb_dark(sweep, frames, v))
            continue;
        reserve(sweep, (gsize)n * GROUP);
        for (int k = 0; k < n; k++)
            absorb_some(sweep, frames[k] + v * LANES, v, GROUP, sweep->count + k);
    }
    reserve(sweep, (gsize)n * GROUP);
    for (; v < n_vectors; v++)
        for (int k = 0; k < n; k++)
            absorb_some(sweep, frames[k] + v * LANES, v, 1, sweep->count + k);
}

/* The version for AVX2 is chosen by hand, because the resolvers of target_clones run before the
 * sanitizers have started. */
#if defined(__x86_64__)
__attribute__((target("avx2"))) static void absorb_avx2(Sweep *sweep, const guint16 *const *frames,
                                                        int n) {
    sweep_absorb(sweep, frames, n);
}
#endif

static void absorb_whole(Sweep *sweep, const guint16 *const *frames, int n) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2")) {
        absorb_avx2(sweep, frames, n);
        return;
    }
#endif
    sweep_absorb(sweep, frames, n);
}

static int by_size(const void *a, const void *b) {
    return *(const int *)a - *(const int *)b;
}

/* Measures the noise in the first pair of frames: the median of |a − b| over n sampled pixels,
 * where a and b are the values of a pixel in the two frames.
 *
 * If a later pair differs much less, the whole picture of an earlier frame was lit differently. The
 * sweep then starts again, and the current frame becomes the first frame of the backgrounds. */
static void measure_noise(Sweep *sweep, const guint16 *pixels) {
    const gsize n = MIN(sweep->n_pixels, NOISE_PIXELS);
    int size[NOISE_PIXELS];
    if (n < FEW_PIXELS || sweep->count >= NOISE_FRAMES)
        return;
    for (gsize i = 0; i < n; i++) {
        const guint16 value = MIN(pixels[i * (sweep->n_pixels / n)], sweep->saturation);
        size[i] = abs((int)value - (int)sweep->sample[i]);
        sweep->sample[i] = value;
    }
    qsort(size, n, sizeof *size, by_size);
    const int difference = size[n / 2];
    const gboolean odd = sweep->count > 1 && sweep->difference > ODD_RATIO * difference + ODD_DN;
    if (odd) {
        sweep->first = sweep->count;
        sweep->n_records = 0;
        memset(sweep->darkest, 0xff, sizeof(guint16) * sweep->n_vectors * LANES);
        memset(sweep->last, 0xff, sizeof(guint32) * sweep->n_vectors);
    }
    if (odd || sweep->count == 1) { /* σ = median |a − b| / MEDIAN */
        const double noise = difference / MEDIAN;
        sweep->difference = difference;
        sweep->margin = (guint16)CLAMP(NOISE_MARGIN * noise, MIN_MARGIN, G_MAXUINT16 / 4);
        sweep->pedestal = (float)(DARKEST * noise);
    }
}

/* Drops records when there are more of them than lines can explain, because of noise or flickering
 * light. Raises the margin by half and drops the records below the margin. Repeats this until at
 * most crowded / 2 records are left, or the margin has reached saturation / MAX_MARGIN. */
static void make_room(Sweep *sweep) {
    int most = MAX(MIN_MARGIN, sweep->saturation / MAX_MARGIN);
    while (sweep->n_records > sweep->crowded / 2 && sweep->margin < most) {
        sweep->margin += sweep->margin / 2;
        struct record *kept = g_new(struct record, sweep->n_records);
        gsize n = 0;
        for (gsize vector = 0; vector < sweep->n_vectors; vector++) {
            guint32 from = sweep->last[vector], *to = &sweep->last[vector];
            for (; from != NOTHING; from = sweep->records[from].previous) {
                const struct record *record = &sweep->records[from];
                /* whether the record still exceeds the margin over the present background */
                gboolean lit = FALSE;
                for (gsize i = 0; i < LANES; i++)
                    lit |= record->value[i] - (int)sweep->darkest[vector * LANES + i] >
                           (int)sweep->margin;
                if (!lit)
                    continue;
                kept[n] = *record;
                *to = (guint32)n;
                to = &kept[n++].previous;
            }
            *to = NOTHING;
        }
        g_free(sweep->records);
        sweep->records = kept;
        sweep->room = sweep->n_records;
        sweep->n_records = n;
    }
}

void sweep_add_some(Sweep *sweep, const guint16 *const *frames, int n) {
    const gsize whole = sweep->n_pixels / LANES, rest = sweep->n_pixels % LANES;
    g_return_if_fail(n >= 0 && n <= sweep->n_frames - sweep->count);
    for (int k = 0, some = 0; k < n; k += some) {
        /* Several frames are added together only if the margin cannot grow within them, so that the
         * result does not depend on how the caller splits the frames. */
        const gsize most = sweep->n_records + TOGETHER * sweep->n_vectors;
        const gboolean many = n - k >= TOGETHER && sweep->count >= NOISE_FRAMES;
        some = many && most <= sweep->crowded ? TOGETHER : 1;
        measure_noise(sweep, frames[k]);
        absorb_whole(sweep, frames + k, some);
        reserve(sweep, (gsize)some);
        for (int i = 0; i < some && rest > 0; i++) { /* the last pixels, fewer than a vector */
            guint16 padded[LANES] = {0};
            memcpy(padded, frames[k + i] + whole * LANES, rest * sizeof *padded);
            absorb_some(sweep, padded, whole, 1, sweep->count + i);
        }
        if (sweep->count == sweep->first)
            memcpy(sweep->opening, sweep->darkest, sizeof(guint16) * sweep->n_vectors * LANES);
        sweep->count += some;
        if (sweep->n_records > sweep->crowded)
            make_room(sweep);
    }
}

void sweep_add(Sweep *sweep, const guint16 *pixels) {
    sweep_add_some(sweep, &pixels, 1);
}

void sweep_set_shorter(Sweep *sweep, const Sweep *shorter, double ratio) {
    g_return_if_fail(sweep->n_pixels == shorter->n_pixels && ratio >= 1);
    sweep->shorter = shorter;
    sweep->ratio = (float)ratio;
}

/* A vector's records in order of time. */
struct history {
    const struct record **record;
    int n;
};

static void gather(const Sweep *sweep, gsize vector, struct history *history) {
    int n = 0;
    for (guint32 i = sweep->last[vector]; i != NOTHING; i = sweep->records[i].previous)
        history->record[n++] = &sweep->records[i];
    history->n = n;
    for (int k = 0; k < n / 2; k++) {
        const struct record *other = history->record[k];
        history->record[k] = history->record[n - 1 - k];
        history->record[n - 1 - k] = other;
    }
}

/* One pixel's samples, and the records that contain these samples. */
struct pixel {
    struct history longer, shorter;
    int *frame;
    float *value, *gain;
    struct sweep_samples samples;
};

static float above(const Sweep *sweep, const struct record *record, gsize i) {
    return (float)(record->value[i % LANES] - (int)sweep->darkest[i]);
}

static float full_of(const Sweep *sweep, gsize i) {
    return (float)(sweep->saturation - sweep->darkest[i]);
}

/* Collects a pixel's samples above the margin, and the samples just before and after them. */
static void take_samples(const Sweep *sweep, gsize i, struct pixel *pixel) {
    int n = 0;
    const float opening = (float)(sweep->opening[i] - (int)sweep->darkest[i]);
    if (opening > (float)sweep->margin) {
        pixel->frame[n] = sweep->first;
        pixel->value[n++] = opening;
    }
    const struct history *history = &pixel->longer;
    float before = 0, next = history->n > 0 ? above(sweep, history->record[0], i) : 0;
    for (int k = 0; k < history->n; k++) {
        const struct record *record = history->record[k];
        const float value = next;
        next = k + 1 < history->n ? above(sweep, history->record[k + 1], i) : 0;
        const gboolean follows = k > 0 && history->record[k - 1]->frame + 1 == record->frame;
        const gboolean leads =
            k + 1 < history->n && record->frame + 1 == history->record[k + 1]->frame;
        const float margin = (float)sweep->margin;
        if (value > margin || (follows && before > margin) || (leads && next > margin)) {
            pixel->frame[n] = (int)record->frame;
            pixel->value[n++] = value;
        }
        before = value;
    }
    pixel->samples = (struct sweep_samples){.frame = pixel->frame,
                                            .value = pixel->value,
                                            .n = n,
                                            .first = sweep->first,
                                            .count = sweep->count,
                                            .full = full_of(sweep, i),
                                            .margin = (float)sweep->margin,
                                            .pedestal = sweep->pedestal};
}

/* Replaces saturated samples by ratio × the samples of the shorter exposure, if the shorter
 * exposure recorded a sample for each of them. */
static void replace_saturated(const Sweep *sweep, gsize i, struct pixel *pixel) {
    const Sweep *shorter = sweep->shorter;
    struct sweep_samples *samples = &pixel->samples;
    const struct history *history = &pixel->shorter;
    int saturated = 0, found = 0;
    for (int k = 0, next = 0; k < samples->n; k++) {
        pixel->gain[k] = 1;
        if (samples->value[k] < samples->full)
            continue;
        saturated++;
        while (next < history->n && (int)history->record[next]->frame < samples->frame[k])
            next++;
        if (next == history->n || (int)history->record[next]->frame != samples->frame[k])
            continue;
        pixel->gain[k] = sweep->ratio * above(shorter, history->record[next], i);
        found++;
    }
    if (found < saturated || saturated == 0)
        return;
    for (int k = 0; k < samples->n; k++) {
        if (samples->value[k] < samples->full)
            continue;
        pixel->value[k] = pixel->gain[k];
        pixel->gain[k] = sweep->ratio;
    }
    samples->gain = pixel->gain;
    samples->full = sweep->ratio * full_of(shorter, i);
}

/* Writes pixel i of the results. pulse is NULL if the pixel has no pulse. */
static void write_pulse(const Sweep *sweep, gsize i, const struct sweep_pulse *pulse,
                        double threshold, const struct sweep_pulses *ret) {
    const gboolean is_line = pulse && pulse->height >= threshold && pulse->time >= 0;
    ret->peak[i] = is_line ? (float)pulse->time : -1;
    ret->intensity[i] = pulse ? MIN((float)pulse->height, full_of(sweep, i)) : 0;
    if (ret->width)
        ret->width[i] = is_line ? (float)pulse->width : 0;
}

void sweep_finish(const Sweep *sweep, double threshold, const struct sweep_pulses *ret_first,
                  const struct sweep_pulses *ret_second) {
    const Sweep *shorter = sweep->shorter;
    gsize n = (gsize)sweep->count + 1, n_shorter = shorter ? (gsize)MAX(shorter->count, 1) : 1;
    g_autofree const struct record **longer_records = g_new(const struct record *, n);
    g_autofree const struct record **shorter_records = g_new(const struct record *, n_shorter);
    g_autofree int *frame = g_new(int, n);
    g_autofree float *value = g_new(float, n), *gain = g_new(float, n);
    struct pixel pixel = {{longer_records, 0}, {shorter_records, 0}, frame, value, gain, {0}};
    for (gsize i = 0; i < sweep->n_pixels; i++) {
        struct sweep_pulse pulse[2];
        if (i % LANES == 0) {
            gather(sweep, i / LANES, &pixel.longer);
            if (shorter)
                gather(shorter, i / LANES, &pixel.shorter);
        }
        take_samples(sweep, i, &pixel);
        if (shorter)
            replace_saturated(sweep, i, &pixel);
        const int found = sweep_pulse_find(&pixel.samples, ret_first ? &pulse[0] : NULL,
                                           ret_second ? &pulse[1] : NULL);
        if (ret_first)
            write_pulse(sweep, i, found > 0 ? &pulse[0] : NULL, threshold, ret_first);
        if (ret_second)
            write_pulse(sweep, i, found > 1 ? &pulse[1] : NULL, threshold, ret_second);
    }
}
