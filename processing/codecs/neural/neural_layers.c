/* Computes the layers of the network for batches, in vectors of eight floats: steps 4 and 5 of
 * neural.h. The functions are compiled twice, for processors with AVX2 and for others. The two
 * results differ in the last digits. */
#include "neural_private.h"

#include "codecs/lobes/lobes_lanes.h"

#define VECTORS     (NEURAL_BATCH / LANES)
#define LEAK        0.01F
#define LN2         0.69314718F
#define LARGE       5.0F /* above this, S(y) equals y to the last digit */
#define AMBIENT     0.3F /* factor of the part of the colour that has no n·l */
#define AMBIENT_OFF 1.0F
#define CURVE       60.0F       /* the 60 of the curve log(1 + 60 x) / log 61 */
#define CURVE_LOG   4.11087386F /* log 61 */

LANES_INLINE float lanes_sum(lanes x) {
    return ((x[0] + x[1]) + (x[2] + x[3])) + ((x[4] + x[5]) + (x[6] + x[7]));
}

/* Sets `rows` rows of ret to bias + Σ weight · x. rows is a compile-time constant, so that the sums
 * stay in registers. weights is rows × n, and x is n × NEURAL_BATCH. Of each row of x, the first
 * `vectors` vectors are used. Their number is even. */
LANES_INLINE void sum_rows(gsize rows, const float *weights, gsize n, const float *biases,
                           const lanes *x, gsize vectors, gboolean leaky, lanes *ret) {
    for (gsize v = 0; v < vectors; v += 2) {
        lanes sums[4][2];
        for (gsize r = 0; r < rows; r++)
            sums[r][0] = sums[r][1] = lanes_all(biases ? biases[r] : 0);
        for (gsize i = 0; i < n; i++) {
            const lanes a = x[i * VECTORS + v], b = x[i * VECTORS + v + 1];
            for (gsize r = 0; r < rows; r++) {
                sums[r][0] += weights[r * n + i] * a;
                sums[r][1] += weights[r * n + i] * b;
            }
        }
        for (gsize r = 0; r < rows; r++)
            for (gsize k = 0; k < 2; k++)
                ret[r * VECTORS + v + k] =
                    leaky ? lanes_max(sums[r][k], LEAK * sums[r][k]) : sums[r][k];
    }
}

/* Computes a layer of m rows. */
LANES_INLINE void layer(const float *weights, const float *biases, gsize m, gsize n, const lanes *x,
                        gsize vectors, gboolean leaky, lanes *ret) {
    const gsize whole = m & ~(gsize)3;
    for (gsize r = 0; r < whole; r += 4)
        sum_rows(4, weights + r * n, n, biases ? biases + r : NULL, x, vectors, leaky,
                 ret + r * VECTORS);
    for (gsize r = whole; r < m; r++)
        sum_rows(1, weights + r * n, n, biases ? biases + r : NULL, x, vectors, leaky,
                 ret + r * VECTORS);
}

/* Computes S(y) = log(1 + exp(4 y)) / 4. */
LANES_INLINE lanes softplus(lanes y) {
    const lanes soft = 0.25F * LN2 * lanes_log2(1.0F + lanes_exp2((4 / LN2) * y));
    return lanes_if(y > LARGE, y, soft);
}

LANES_INLINE void run(const struct neural_numbers *numbers, int n, struct neural_batch *batch) {
    const gsize vectors = (gsize)(n + 2 * LANES - 1) / (2 * LANES) * 2;
    const gsize n_inputs = (gsize)neural_inputs(numbers->n_channels);
    lanes *hidden[2] = {(lanes *)batch->hidden[0], (lanes *)batch->hidden[1]};
    lanes *outputs = (lanes *)batch->outputs;
    const float *first = numbers->weights, *biases = numbers->biases;
    const float *second = first + NEURAL_HIDDEN * n_inputs;
    const float *third = second + NEURAL_HIDDEN * NEURAL_HIDDEN;
    const lanes *shade = (const lanes *)batch->inputs[n_inputs - NEURAL_LIGHT_INPUTS];
    layer(first, biases, NEURAL_HIDDEN, n_inputs, (const lanes *)batch->inputs, vectors, TRUE,
          hidden[0]);
    layer(second, biases + NEURAL_HIDDEN, NEURAL_HIDDEN, NEURAL_HIDDEN, hidden[0], vectors, TRUE,
          hidden[1]);
    layer(third, biases + 2 * NEURAL_HIDDEN, NEURAL_OUTPUTS, NEURAL_HIDDEN, hidden[1], vectors,
          FALSE, outputs);
    for (int c = 0; c < 3; c++)
        for (int v = 0; v < (int)vectors; v++)
            ((lanes *)batch->colours[c])[v] =
                softplus(outputs[c * VECTORS + v]) * shade[v] +
                AMBIENT * softplus(outputs[(3 + c) * VECTORS + v] - AMBIENT_OFF);
}

/* Sets two rows and `columns` columns of the result of multiply(). `columns` is a compile-time
 * constant. */
LANES_INLINE void multiply_block(const lanes *a, const lanes *b, gsize columns, gsize n,
                                 float *ret) {
    lanes sums[2][4] = {{{0}}};
    for (gsize v = 0; v < VECTORS; v++)
        for (gsize k = 0; k < 2; k++)
            for (gsize j = 0; j < columns; j++)
                sums[k][j] += a[k * VECTORS + v] * b[j * VECTORS + v];
    for (gsize k = 0; k < 2; k++)
        for (gsize j = 0; j < columns; j++)
            ret[k * n + j] = lanes_sum(sums[k][j]);
}

/* Sets ret (m × n) to A Bᵀ, where A is m × NEURAL_BATCH, B is n × NEURAL_BATCH, and m is even. */
LANES_INLINE void multiply(const lanes *a, gsize m, const lanes *b, gsize n, float *ret) {
    const gsize whole = n & ~(gsize)3;
    for (gsize r = 0; r < m; r += 2) {
        for (gsize i = 0; i < whole; i += 4)
            multiply_block(a + r * VECTORS, b + i * VECTORS, 4, n, ret + r * n + i);
        for (gsize i = whole; i < n; i++)
            multiply_block(a + r * VECTORS, b + i * VECTORS, 1, n, ret + r * n + i);
    }
}

LANES_INLINE void sum_all(const lanes *a, int m, float *ret) {
    for (int r = 0; r < m; r++) {
        lanes sum = lanes_all(0);
        for (int v = 0; v < VECTORS; v++)
            sum += a[r * VECTORS + v];
        ret[r] = lanes_sum(sum);
    }
}

/* Multiplies a gradient by the slope of max(y, 0.01 y). */
LANES_INLINE void slope_back(const float y[NEURAL_HIDDEN][NEURAL_BATCH], lanes *gradient) {
    for (int i = 0; i < NEURAL_HIDDEN * VECTORS; i++)
        gradient[i] = lanes_if(((const lanes *)y)[i] > 0, gradient[i], LEAK * gradient[i]);
}

/* Computes the slope of S(y), 1 / (1 + exp(−4 y)). */
LANES_INLINE lanes softplus_slope(lanes y) {
    return 1.0F / (1.0F + lanes_exp2((-4 / LN2) * y));
}

/* Sets gradient to the gradient of the loss by the outputs, and returns the loss. share is the
 * weight of a squared difference in the loss. */
LANES_INLINE lanes loss_back(const struct neural_batch *batch, const lanes *shade, float share,
                             const struct neural_lesson *lesson, lanes *gradient) {
    const float scale = LN2 / CURVE_LOG; /* factor from log₂ to the curve */
    lanes loss = lanes_all(0);
    for (int c = 0; c < 3; c++)
        for (int v = 0; v < VECTORS; v++) {
            const lanes colour = ((const lanes *)batch->colours[c])[v];
            const lanes target = ((const lanes *)lesson->targets[c])[v];
            const lanes wanted = scale * lanes_log2(1 + CURVE * lanes_max(target, lanes_all(0)));
            const lanes off = scale * lanes_log2(1 + CURVE * colour) - wanted;
            const lanes used = lanes_if(target > -G_MAXFLOAT, off, lanes_all(0));
            const lanes by_colour = 2 * share * used * (CURVE / CURVE_LOG) / (1 + CURVE * colour);
            const lanes lit = ((const lanes *)batch->outputs[c])[v];
            const lanes rest = ((const lanes *)batch->outputs[3 + c])[v] - AMBIENT_OFF;
            gradient[c * VECTORS + v] = by_colour * shade[v] * softplus_slope(lit);
            gradient[(3 + c) * VECTORS + v] = by_colour * AMBIENT * softplus_slope(rest);
            loss += used * used;
        }
    return loss;
}

LANES_INLINE void run_back(const struct neural_numbers *numbers, const float *transposed,
                           float share, struct neural_batch *batch, struct neural_lesson *lesson) {
    const gsize n_inputs = (gsize)neural_inputs(numbers->n_channels);
    const gsize second = NEURAL_HIDDEN * n_inputs, third = second + NEURAL_HIDDEN * NEURAL_HIDDEN;
    const lanes *shade = (const lanes *)batch->inputs[n_inputs - NEURAL_LIGHT_INPUTS];
    const lanes *hidden[2] = {(const lanes *)batch->hidden[0], (const lanes *)batch->hidden[1]};
    struct neural_gradient *to = &lesson->gradient;
    lanes outputs[NEURAL_OUTPUTS * VECTORS], back[2][NEURAL_HIDDEN * VECTORS];
    run(numbers, NEURAL_BATCH, batch);
    lesson->loss = (double)lanes_sum(loss_back(batch, shade, share, lesson, outputs));
    multiply(outputs, NEURAL_OUTPUTS, hidden[1], NEURAL_HIDDEN, to->weights + third);
    sum_all(outputs, NEURAL_OUTPUTS, to->biases + 2 * NEURAL_HIDDEN);
    layer(transposed + third, NULL, NEURAL_HIDDEN, NEURAL_OUTPUTS, outputs, VECTORS, FALSE,
          back[1]);
    slope_back(batch->hidden[1], back[1]);
    multiply(back[1], NEURAL_HIDDEN, hidden[0], NEURAL_HIDDEN, to->weights + second);
    sum_all(back[1], NEURAL_HIDDEN, to->biases + NEURAL_HIDDEN);
    layer(transposed + second, NULL, NEURAL_HIDDEN, NEURAL_HIDDEN, back[1], VECTORS, FALSE,
          back[0]);
    slope_back(batch->hidden[0], back[0]);
    multiply(back[0], NEURAL_HIDDEN, (const lanes *)batch->inputs, n_inputs, to->weights);
    sum_all(back[0], NEURAL_HIDDEN, to->biases);
    layer(transposed, NULL, n_inputs - NEURAL_LIGHT_INPUTS, NEURAL_HIDDEN, back[0], VECTORS, FALSE,
          (lanes *)lesson->inputs);
}

/* The functions for the processor are chosen as in lobes_fit.c. */
#if defined(__x86_64__)
#define AVX2 __attribute__((target("avx2,fma")))
AVX2 static void run_avx2(const struct neural_numbers *numbers, int n, struct neural_batch *batch) {
    run(numbers, n, batch);
}
AVX2 static void run_back_avx2(const struct neural_numbers *numbers, const float *transposed,
                               float share, struct neural_batch *batch,
                               struct neural_lesson *lesson) {
    run_back(numbers, transposed, share, batch, lesson);
}
static gboolean has_avx2(void) {
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
}
#else
#define has_avx2()    FALSE
#define run_avx2      run
#define run_back_avx2 run_back
#endif

void neural_run(const struct neural_numbers *numbers, int n, struct neural_batch *batch) {
    if (has_avx2())
        run_avx2(numbers, n, batch);
    else
        run(numbers, n, batch);
}

void neural_run_back(const struct neural_numbers *numbers, const float *transposed, float share,
                     struct neural_batch *batch, struct neural_lesson *lesson) {
    if (has_avx2())
        run_back_avx2(numbers, transposed, share, batch, lesson);
    else
        run_back(numbers, transposed, share, batch, lesson);
}
