/* Makes sessions from files of measured BRDFs and of RTI. Like the sessions of import.h, they have
 * a BTF and eigen-maps as products, and their value "imported" names the file. Any thread. */
#pragma once

#include "formats/brdf/brdf.h"
#include "formats/import.h"

struct import_brdf_wish {
    enum brdf_kind kind;
    struct brdf_coding coding; /* for UTIA's files */
    int texels;                /* number of equal texels in each dimension; 0 means 1 */
    double texel_mm;           /* 0 means 1 */
    /* Path of a table of directions (btf_directions.h), which are used both as views and as lights.
     * NULL stands for the 241 directions of UTIA if the file is one of UTIA's, and for the 81
     * directions of the papers if it is not. */
    const char *directions;
};

/* Imports a BRDF file. The values of the BTF are B = π f_r cos θ_l at the directions of the
 * wish. */
gboolean import_brdf(const char *path, const char *file, const struct import_brdf_wish *wish,
                     const struct work *work, struct import_result *ret, GError **error);

/* Imports a .ptm or .rti (rti.h) under the lights of a table, or under the 81 directions of the
 * papers. The values of the file are sRGB, and are converted to linear. */
gboolean import_ptm(const char *path, const char *file, const char *directions,
                    const struct import_wish *wish, const struct work *work,
                    struct import_result *ret, GError **error);
