#include "mdf_blocks.h"

#include <math.h>
#include <string.h>

#define SIDE   MDF_BLOCK_SIDE
#define TEXELS (SIDE * SIDE)
#define STEPS  7   /* number of steps from the first end value of a block to the second */
#define MOST   255 /* maximum of an end value */
#define ROUNDS 4

/* The format BC4 has an index for each of the eight values. codes[i] is the index of the value that
 * is i steps from the first end, if the first end is the larger one. */
static const guint8 codes[STEPS + 1] = {0, 2, 3, 4, 5, 6, 7, 1};

struct block {
    int ends[2]; /* the values of a block lead from the first end to the second in seven steps */
    guint8 at[TEXELS]; /* for each texel, the number of steps from the first end */
    double error;
};

int mdf_blocks_across(int n) {
    return (n + SIDE - 1) / SIDE;
}

gsize mdf_blocks_bytes(int width, int height) {
    return (gsize)mdf_blocks_across(width) * (gsize)mdf_blocks_across(height) * MDF_BLOCK_BYTES;
}

/* Assigns the nearest of the eight values to each depth. Sets block->at, and block->error to the
 * sum of the squared differences. */
static void assign(struct block *block, const double *values) {
    const double from = block->ends[0], along = block->ends[1] - from;
    block->error = 0;
    for (int i = 0; i < TEXELS; i++) {
        const double at = along != 0 ? round((values[i] - from) / along * STEPS) : 0;
        block->at[i] = (guint8)CLAMP(at, 0, STEPS);
        const double rest = from + along * block->at[i] / STEPS - values[i];
        block->error += rest * rest;
    }
}

static int whole_end(double value) {
    return (int)CLAMP(round(value), 0, MOST);
}

/* Finds the ends e_0 and e_1 that are best for the depths d and the given steps i, with t = i / 7.
 * They minimise Σ ((1 − t) e_0 + t e_1 − d)². The normal equations are [a b; b c] e = [x; y].
 * Returns FALSE if all steps are equal, because the equations then have no unique solution. */
static gboolean fit_ends(struct block *block, const double *values) {
    double a = 0, b = 0, c = 0, x = 0, y = 0;
    for (int i = 0; i < TEXELS; i++) {
        const double t = (double)block->at[i] / STEPS, s = 1 - t;
        a += s * s;
        b += s * t;
        c += t * t;
        x += s * values[i];
        y += t * values[i];
    }
    const double determinant = a * c - b * b;
    if (determinant < 1e-6)
        return FALSE;
    block->ends[0] = whole_end((c * x - b * y) / determinant);
    block->ends[1] = whole_end((a * y - b * x) / determinant);
    return TRUE;
}

/* Finds the ends and indices of a block. Begins with the maximum and the minimum depth as ends.
 * Then fits ends and indices in turn, for at most ROUNDS rounds, as long as the error decreases. */
static void fit(struct block *best, const double *values) {
    double least = values[0], most = values[0];
    for (int i = 1; i < TEXELS; i++) {
        least = MIN(least, values[i]);
        most = MAX(most, values[i]);
    }
    best->ends[0] = whole_end(most);
    best->ends[1] = whole_end(least);
    /* If both ends were rounded to the same whole number, takes the whole numbers below and above
     * the depths. A block has six further values between these. */
    if (best->ends[0] == best->ends[1] && most > least) {
        best->ends[0] = whole_end(ceil(most));
        best->ends[1] = whole_end(floor(least));
    }
    assign(best, values);
    for (int round = 0; round < ROUNDS; round++) {
        struct block next = *best;
        if (!fit_ends(&next, values))
            return;
        assign(&next, values);
        if (next.error >= best->error)
            return;
        *best = next;
    }
}

void mdf_blocks_encode(const float *depth, int width, int height, double least, double deepest,
                       guint8 *ret) {
    const double scale = deepest > least ? MOST / (deepest - least) : 0;
    for (int j = 0; j < height; j += SIDE)
        for (int i = 0; i < width; i += SIDE, ret += MDF_BLOCK_BYTES) {
            double values[TEXELS];
            struct block block;
            for (int k = 0; k < TEXELS; k++) {
                const int x = MIN(i + k % SIDE, width - 1), y = MIN(j + k / SIDE, height - 1);
                values[k] =
                    CLAMP(scale * (depth[(gsize)y * (gsize)width + (gsize)x] - least), 0, MOST);
            }
            fit(&block, values);
            /* The larger end is stored first, because the card otherwise gets only six values from
             * the two ends. If the ends are equal, all indices are 0, because index 0 always stands
             * for the first end. */
            const gboolean swap = block.ends[0] < block.ends[1];
            const gboolean same = block.ends[0] == block.ends[1];
            guint64 bits = 0;
            for (int k = 0; k < TEXELS; k++) {
                const int at = swap ? STEPS - block.at[k] : block.at[k];
                bits |= (guint64)(same ? 0 : codes[at]) << (3 * k);
            }
            ret[0] = (guint8)block.ends[swap];
            ret[1] = (guint8)block.ends[!swap];
            for (int k = 0; k < 6; k++)
                ret[2 + k] = (guint8)(bits >> (8 * k));
        }
}

void mdf_blocks_decode(const guint8 *blocks, int width, int height, double least, double deepest,
                       float *ret_depth) {
    for (int j = 0; j < height; j += SIDE)
        for (int i = 0; i < width; i += SIDE, blocks += MDF_BLOCK_BYTES) {
            /* Computes the eight values of a block according to the format. If the first end is
             * larger than the second, eight values lead from end to end. Otherwise six values do,
             * and the last two values are 0 and MOST. */
            const int steps = blocks[0] > blocks[1] ? STEPS : STEPS - 2;
            double values[STEPS + 1] = {blocks[0], blocks[1], [6] = 0, [7] = MOST};
            guint64 bits = 0;
            for (int k = 1; k < steps; k++)
                values[k + 1] = ((steps - k) * values[0] + k * values[1]) / steps;
            for (int k = 0; k < 6; k++)
                bits |= (guint64)blocks[2 + k] << (8 * k);
            for (int k = 0; k < TEXELS; k++)
                if (i + k % SIDE < width && j + k / SIDE < height)
                    ret_depth[(gsize)(j + k / SIDE) * (gsize)width + (gsize)(i + k % SIDE)] =
                        (float)(least + values[bits >> (3 * k) & 7] * (deepest - least) / MOST);
        }
}
