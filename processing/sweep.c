#include "sweep.h"

#include <math.h>
#include <string.h>

/* Frames are copied into a short queue and absorbed BATCH at a time: the state is then read and
 * written once a batch, stays in registers meanwhile, and where nothing in the batch was as bright
 * as the peak only the darkest value is touched. */
#define BATCH 4
#define TILE  1024 /* pixels whose state sweep_finish() has on its stack */

/* Pixels side by side. Signed, since there is no unsigned comparison of vectors on x86; values are
 * moved down by BIAS. Comparisons give −1 or 0. */
#define LANES 16
#define BIAS  0x8000
typedef gint16 lanes __attribute__((vector_size(2 * LANES), aligned(2), may_alias));
typedef gint64 wide __attribute__((vector_size(2 * LANES)));

/* The compiler makes one blend of it. */
#define CHOOSE(condition, yes, no) (((condition) & (yes)) | (~(condition) & (no)))

struct state {      /* a plane each */
    gint16 *peak;   /* brightest so far */
    gint16 *first;  /* the first frame that was as bright */
    gint16 *length; /* frames as bright, without a gap */
    gint16 *before; /* the value before first */
    gint16 *after;  /* the value after the last of them */
    gint16 *open;   /* −1 while after is still to come */
    gint16 *darkest;
};
#define STATE_PLANES 7

struct Sweep {
    gsize n_pixels, stride; /* of the planes: whole vectors */
    int n_frames, count;
    int saturation;
    gint16 *memory;
    struct state state;
    gint16 *queue[BATCH + 1]; /* [0] is the frame before the first one queued */
    int queued;
};

static struct state state_at(gint16 *memory, gsize stride) {
    return (struct state){memory,
                          memory + stride,
                          memory + 2 * stride,
                          memory + 3 * stride,
                          memory + 4 * stride,
                          memory + 5 * stride,
                          memory + 6 * stride};
}

Sweep *sweep_new(int width, int height, int n_frames, int saturation) {
    g_return_val_if_fail(width > 0 && height > 0, NULL);
    g_return_val_if_fail(n_frames > 0 && n_frames <= G_MAXINT16, NULL);
    Sweep *sweep = g_new0(Sweep, 1);
    sweep->n_pixels = (gsize)width * (gsize)height;
    sweep->stride = (sweep->n_pixels + LANES - 1) / LANES * LANES;
    sweep->n_frames = n_frames;
    sweep->saturation = CLAMP(saturation, 1, G_MAXUINT16);
    sweep->memory = g_new0(gint16, sweep->stride * (STATE_PLANES + BATCH + 1));
    sweep->state = state_at(sweep->memory, sweep->stride);
    for (int i = 0; i <= BATCH; i++)
        sweep->queue[i] = sweep->memory + sweep->stride * (gsize)(STATE_PLANES + i);
    for (gsize i = 0; i < sweep->n_pixels; i++) {
        sweep->state.peak[i] = G_MININT16;
        sweep->state.darkest[i] = G_MAXINT16;
    }
    return sweep;
}

void sweep_free(Sweep *sweep) {
    if (!sweep)
        return;
    g_free(sweep->memory);
    g_free(sweep);
}

int sweep_count(const Sweep *sweep) {
    return sweep->count;
}

static inline __attribute__((always_inline)) void follow_peak(struct state state, gsize at,
                                                              const lanes *values, lanes previous,
                                                              int batch, int time) {
    lanes peak = *(lanes *)(state.peak + at), first = *(lanes *)(state.first + at);
    lanes length = *(lanes *)(state.length + at), before = *(lanes *)(state.before + at);
    lanes after = *(lanes *)(state.after + at), open = *(lanes *)(state.open + at);
    lanes now = (lanes){} + (gint16)time;
#pragma GCC unroll 4
    for (int k = 0; k < batch; k++) {
        lanes value = values[k], more = value > peak, same = (value == peak) & open;
        after = CHOOSE(open, value, after);
        before = CHOOSE(more, previous, before);
        first = CHOOSE(more, now, first);
        open = more | same;
        length = (length & ~more) - open;
        peak = CHOOSE(more, value, peak);
        previous = value;
        now += 1;
    }
    *(lanes *)(state.peak + at) = peak, *(lanes *)(state.first + at) = first;
    *(lanes *)(state.length + at) = length, *(lanes *)(state.before + at) = before;
    *(lanes *)(state.after + at) = after, *(lanes *)(state.open + at) = open;
}

/* LANES pixels of `batch` queued frames, of which the first is number `time`. */
static inline __attribute__((always_inline)) void absorb_lanes(struct state state, gsize at,
                                                               gint16 *const *queue, gsize offset,
                                                               int batch, int time,
                                                               int saturation) {
    lanes bias = (lanes){} + (gint16)BIAS, most = (lanes){} + (gint16)(saturation - BIAS);
    lanes peak = *(lanes *)(state.peak + at), darkest = *(lanes *)(state.darkest + at);
    lanes previous = *(lanes *)(queue[0] + offset) ^ bias, values[BATCH];
    previous = CHOOSE(previous > most, most, previous);
    lanes busy = *(lanes *)(state.open + at);
#pragma GCC unroll 4
    for (int k = 0; k < batch; k++) {
        lanes value = *(lanes *)(queue[k + 1] + offset) ^ bias;
        value = CHOOSE(value > most, most, value);
        busy |= value > peak;
        darkest = CHOOSE(value < darkest, value, darkest);
        values[k] = value;
    }
    *(lanes *)(state.darkest + at) = darkest;
    wide any = (wide)busy;
    if (any[0] | any[1] | any[2] | any[3])
        follow_peak(state, at, values, previous, batch, time);
}

static inline __attribute__((always_inline)) void absorb_all(Sweep *sweep, int time) {
    for (gsize i = 0; i < sweep->stride; i += LANES)
        absorb_lanes(sweep->state, i, sweep->queue, i, BATCH, time, sweep->saturation);
}

/* The dispatch is by hand because the resolvers of target_clones run before the sanitizers' own
 * start-up. */
#if defined(__x86_64__)
__attribute__((target("avx2"))) static void absorb_batch_avx2(Sweep *sweep, int time) {
    absorb_all(sweep, time);
}
#endif

static void absorb_batch(Sweep *sweep, int time) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2")) {
        absorb_batch_avx2(sweep, time);
        return;
    }
#endif
    absorb_all(sweep, time);
}

void sweep_add(Sweep *sweep, const guint16 *pixels) {
    g_return_if_fail(sweep->count < sweep->n_frames);
    memcpy(sweep->queue[++sweep->queued], pixels, sweep->n_pixels * sizeof *pixels);
    sweep->count++;
    if (sweep->queued < BATCH)
        return;
    absorb_batch(sweep, sweep->count - BATCH);
    gint16 *spare = sweep->queue[0];
    sweep->queue[0] = sweep->queue[BATCH];
    sweep->queue[BATCH] = spare;
    sweep->queued = 0;
}

/* The vertex of the parabola through (−1, a), (0, b), (1, c). FALSE if it has none. */
static gboolean vertex(double a, double b, double c, double *ret_offset, double *ret_curvature) {
    double curvature = a - 2 * b + c;
    if (!(curvature < 0))
        return FALSE;
    *ret_offset = CLAMP(0.5 * (a - c) / curvature, -0.5, 0.5);
    *ret_curvature = curvature;
    return TRUE;
}

/* The three samples are above background. In logarithms a Gaussian is a parabola, whose curvature
 * is −1/σ². Where a neighbour lies in the background the parabola is fitted to the values. */
static void interpolate(double a, double b, double c, double *ret_offset, double *ret_width) {
    double curvature;
    *ret_offset = 0;
    *ret_width = 0.5;
    if (a > 0 && c > 0 && vertex(log(a), log(b), log(c), ret_offset, &curvature))
        *ret_width = 1 / sqrt(-curvature);
    else if (vertex(a, b, c, ret_offset, &curvature))
        *ret_width = sqrt(b / -curvature);
}

/* A plateau of length frames at the converter's end. Where it begins and ends the pulse crosses the
 * plateau's value, on average half a frame beyond; with the neighbours that gives σ, and their
 * ratio the centre. */
static void across_plateau(double a, double top, double c, int length, double *ret_offset,
                           double *ret_width) {
    double half = 0.5 * (length + 1), low = 0.01 * top;
    double ratio = log(top / CLAMP(sqrt(MAX(a, low) * MAX(c, low)), low, 0.95 * top));
    double variance = (half * half - 0.25 * length * length) / (2 * ratio);
    *ret_width = sqrt(variance);
    *ret_offset = 0.5 * (length - 1);
    if (a > 0 && c > 0)
        *ret_offset += CLAMP(0.5 * variance * log(c / a) / half, -0.5, 0.5);
}

static void finish_pixel(const struct state *state, gsize i, int count, int saturation,
                         double threshold, float *ret_peak, float *ret_width,
                         float *ret_intensity) {
    double dark = state->darkest[i], bright = state->peak[i] - dark;
    int first = state->first[i], length = state->length[i];
    *ret_intensity = (float)MAX(bright, 0);
    *ret_peak = -1;
    *ret_width = 0;
    if (!(bright >= threshold) || bright <= 0 || first == 0 || first + length >= count)
        return;
    double a = state->before[i] - dark, c = state->after[i] - dark, offset, width;
    if (state->peak[i] + BIAS >= saturation || length > 2)
        across_plateau(a, bright, c, length, &offset, &width);
    else
        interpolate(a, bright, length == 1 ? c : bright, &offset, &width);
    *ret_peak = (float)(first + offset);
    *ret_width = (float)width;
}

void sweep_finish(const Sweep *sweep, double threshold, float *ret_peak, float *ret_width,
                  float *ret_intensity) {
    gint16 memory[STATE_PLANES * TILE];
    for (gsize start = 0; start < sweep->stride; start += TILE) {
        gsize n = MIN(TILE, sweep->stride - start);
        /* What is still queued is absorbed into a copy: more frames may follow. */
        for (gsize plane = 0; plane < STATE_PLANES; plane++)
            memcpy(memory + plane * TILE, sweep->memory + sweep->stride * plane + start,
                   n * sizeof *memory);
        struct state state = state_at(memory, TILE);
        for (int k = 0; k < sweep->queued; k++)
            for (gsize i = 0; i < n; i += LANES)
                absorb_lanes(state, i, sweep->queue + k, start + i, 1,
                             sweep->count - sweep->queued + k, sweep->saturation);
        for (gsize i = 0; i < n && start + i < sweep->n_pixels; i++)
            finish_pixel(&state, i, sweep->count, sweep->saturation, threshold,
                         ret_peak + start + i, ret_width + start + i, ret_intensity + start + i);
    }
}
