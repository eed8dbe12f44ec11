/* Measures the difference between the products and frames of two sessions of the same plan. */
#pragma once

#include "exr/exr.h"

#include <math.h>
#include <string.h>

struct difference {
    double rms; /* of the differences, relative to the RMS of the values of the first session */
    double systematic; /* mean difference, relative to the mean value of the first session */
    /* for the MDF: share of the texels that have a value in only one session */
    double seen_differently;
    int n_files;
    gint64 n_values;
};

struct difference_sums {
    double squares, reference, sum, reference_sum;
    gint64 n, unequal, all;
};

/* Compares the EXR files in a folder of session a with the files of the same names in session b.
 * Every file of session a must also be in session b. folder is "frames", "products/btf" or
 * "products". If holes is TRUE, only mdf.exr is compared, whose texels may lack a value; folder
 * must then be "products". */
gboolean difference_folder(const char *session_a, const char *session_b, const char *folder,
                           gboolean holes, struct difference *ret, GError **error);
