#include "lib/deviate.h"
#include "measurement_parts.h"

#include "frames/sweep.h"

#include <math.h>

#define N_PIXELS     8192
#define N_FRAMES     64
#define BLACK_DN     64.0
#define SATURATED_DN 4014
#define ELECTRONS    (15000.0 / 4031) /* a DN */
#define READ_E       4.0

static double variance_dn(double signal_dn) {
    return (signal_dn * ELECTRONS + READ_E * READ_E) / (ELECTRONS * ELECTRONS) + 1.0 / 12;
}

/* Amplitude and width are unknown too, but even in time: they do not make it worse. */
static double information(double amplitude, double sigma, double time) {
    double sum = 0;
    for (int k = 0; k < N_FRAMES; k++) {
        double t = (k - time) / sigma, value = amplitude * exp(-t * t / 2);
        double slope = value * t / sigma;
        sum += slope * slope / variance_dn(value);
    }
    return sum;
}

struct bench_peaks bench_peaks(double amplitude_dn, double sigma) {
    g_autoptr(Sweep) sweep = sweep_new(N_PIXELS, 1, N_FRAMES, SATURATED_DN);
    GRand *random = g_rand_new_with_seed(5);
    g_autofree double *time = g_new(double, N_PIXELS);
    g_autofree float *peak = g_new(float, N_PIXELS), *width = g_new(float, N_PIXELS);
    g_autofree float *intensity = g_new(float, N_PIXELS);
    guint16 frame[N_PIXELS];
    double bits = 0, squares = 0;
    int n = 0;
    for (int i = 0; i < N_PIXELS; i++) {
        time[i] = g_rand_double_range(random, 20, 40);
        bits += 1 / information(amplitude_dn, sigma, time[i]);
    }
    for (int k = 0; k < N_FRAMES; k++) {
        for (int i = 0; i < N_PIXELS; i++) {
            double t = (k - time[i]) / sigma, value = amplitude_dn * exp(-t * t / 2);
            double dn = BLACK_DN + value + sqrt(variance_dn(value)) * deviate_normal(random);
            frame[i] = (guint16)CLAMP(floor(dn + 0.5), 0, 4095);
        }
        sweep_add(sweep, frame);
    }
    sweep_finish(sweep, 0.5 * amplitude_dn, &(struct sweep_pulses){peak, width, intensity}, NULL);
    for (int i = 0; i < N_PIXELS; i++)
        if (peak[i] >= 0 && fabs(peak[i] - time[i]) < 3 * sigma) {
            squares += (peak[i] - time[i]) * (peak[i] - time[i]);
            n++;
        }
    g_rand_free(random);
    return (struct bench_peaks){amplitude_dn, sqrt(bits / N_PIXELS), sqrt(squares / MAX(n, 1)),
                                1 - (double)n / N_PIXELS};
}
