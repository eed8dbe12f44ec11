/* How well sweep.h tells a pulse's time, against the Cramér–Rao bound: part of bench_measurement.
 */
#pragma once

#include <glib.h>

struct bench_peaks {
    double amplitude_dn, bound, rms; /* frames */
    double missed;                   /* part of the pulses: not found, or more than 3 σ away */
};

/* The noise is that of the simulated cameras: 12 bits for 15000 electrons, 4 of read noise.
 * sigma: of the pulse, in frames. */
struct bench_peaks bench_peaks(double amplitude_dn, double sigma);
