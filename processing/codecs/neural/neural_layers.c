/* The layers of the network on batches, in vectors of eight floats: steps 4 and 5 of neural.h. They
 * are compiled for processors with AVX2 and for others, whose results differ in the last digits. */
#include "neural_private.h"

#include "codecs/lobes/lobes_lanes.h"

#define VECTORS     (NEURAL_BATCH / LANES)
#define LEAK        0.01F
#define LN2         0.69314718F
#define LARGE       5.0F /* S(y) = y above, to the last digit */
#define AMBIENT     0.3F /* factor of the part of the colour that has no n·l */
#define AMBIENT_OFF 1.0F

/* Sets `rows` rows of ret to bias + Σ weight · x. rows is a constant, so that the sums stay in
 * registers. weights is rows × n, `apart` floats from row to row; x is n × NEURAL_BATCH. */
LANES_INLINE void sum_rows(int rows, const float *weights, int apart, const float *biases, int n,
                           const lanes *x, gboolean leaky, lanes *ret) {
    for (int v = 0; v < VECTORS; v += 2) {
        lanes sums[4][2];
        for (int r = 0; r < rows; r++)
            sums[r][0] = sums[r][1] = lanes_all(biases ? biases[r] : 0);
        for (int i = 0; i < n; i++) {
            const lanes a = x[i * VECTORS + v], b = x[i * VECTORS + v + 1];
            for (int r = 0; r < rows; r++) {
                sums[r][0] += weights[r * apart + i] * a;
                sums[r][1] += weights[r * apart + i] * b;
            }
        }
        for (int r = 0; r < rows; r++)
            for (int k = 0; k < 2; k++)
                ret[r * VECTORS + v + k] =
                    leaky ? lanes_max(sums[r][k], LEAK * sums[r][k]) : sums[r][k];
    }
}

/* A layer of m rows. */
LANES_INLINE void layer(const float *weights, const float *biases, int m, int n, const lanes *x,
                        gboolean leaky, lanes *ret) {
    int r = 0;
    for (; r + 4 <= m; r += 4)
        sum_rows(4, weights + r * n, n, biases + r, n, x, leaky, ret + r * VECTORS);
    for (; r < m; r++)
        sum_rows(1, weights + r * n, n, biases + r, n, x, leaky, ret + r * VECTORS);
}

/* S(y) = log(1 + exp(4 y)) / 4 */
LANES_INLINE lanes softplus(lanes y) {
    const lanes soft = 0.25F * LN2 * lanes_log2(1.0F + lanes_exp2((4 / LN2) * y));
    return lanes_if(y > LARGE, y, soft);
}

LANES_INLINE void run(const struct neural_numbers *numbers, struct neural_batch *batch) {
    const int n_inputs = neural_inputs(numbers->n_channels);
    lanes *hidden[2] = {(lanes *)batch->hidden[0], (lanes *)batch->hidden[1]};
    lanes *outputs = (lanes *)batch->outputs;
    const float *first = numbers->weights, *biases = numbers->biases;
    const float *second = first + NEURAL_HIDDEN * n_inputs;
    const float *third = second + NEURAL_HIDDEN * NEURAL_HIDDEN;
    const lanes *shade = (const lanes *)batch->inputs[n_inputs - NEURAL_LIGHT_INPUTS];
    layer(first, biases, NEURAL_HIDDEN, n_inputs, (const lanes *)batch->inputs, TRUE, hidden[0]);
    layer(second, biases + NEURAL_HIDDEN, NEURAL_HIDDEN, NEURAL_HIDDEN, hidden[0], TRUE, hidden[1]);
    layer(third, biases + 2 * NEURAL_HIDDEN, NEURAL_OUTPUTS, NEURAL_HIDDEN, hidden[1], FALSE,
          outputs);
    for (int c = 0; c < 3; c++)
        for (int v = 0; v < VECTORS; v++)
            ((lanes *)batch->colours[c])[v] =
                softplus(outputs[c * VECTORS + v]) * shade[v] +
                AMBIENT * softplus(outputs[(3 + c) * VECTORS + v] - AMBIENT_OFF);
}

/* The function for the processor is chosen as in lobes_fit.c. */
#if defined(__x86_64__)
__attribute__((target("avx2,fma"))) static void run_avx2(const struct neural_numbers *numbers,
                                                         struct neural_batch *batch) {
    run(numbers, batch);
}
#endif

void neural_run(const struct neural_numbers *numbers, struct neural_batch *batch) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        run_avx2(numbers, batch);
        return;
    }
#endif
    run(numbers, batch);
}
