/* The BTF's part of bench_measurement. */
#pragma once

#include "end_to_end/demo_pictures.h"
#include "measurement_rig.h"

struct bench_cell { /* a view and a lamp */
    GArray *errors; /* float: of each texel and colour, relative */
    GArray *bias;   /* with their signs */
    int saturated;  /* pixels */
    /* Sums over values of (error / σ)², σ being of noise alone, and of noise and structure; values
     * off by more than 3 σ */
    double chi_noise, chi;
    gint64 values, beyond;
};

/* ret: RIG_VIEWS × RIG_VIEWS cells, view by view; errors are appended. picture, if not NULL, gets
 * views and lights of every sort. */
void bench_btf(const struct bench_setup *setup, int truth_samples, struct bench_cell *ret,
               struct demo_btf *picture);

double bench_quantile(GArray *values, double q); /* sorts them */
