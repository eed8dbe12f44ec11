/* How far the products and frames of two sessions of the same plan are apart. */
#pragma once

#include "exr/exr.h"

#include <math.h>
#include <string.h>

struct difference {
    double rms;              /* of differences, relative to the RMS of the first's values */
    double systematic;       /* the mean difference, relative to the first's mean value */
    double seen_differently; /* MDF: part of the texels that only one of them has a value for */
    int n_files;
    gint64 n_values;
};

struct difference_sums {
    double squares, reference, sum, reference_sum;
    gint64 n, unequal, all;
};

/* folder: "frames", "products/btf" or, with holes, "products" for mdf.exr only. Every file of
 * session a must be in b. */
gboolean difference_folder(const char *session_a, const char *session_b, const char *folder,
                           gboolean holes, struct difference *ret, GError **error);
