/*
 * Makes sessions from files of measured BRDFs and of RTI. Like those of import.h, they have a BTF
 * and eigen-maps as products, and their value "imported" names the file. Any thread.
 */
#pragma once

#include "brdf/brdf.h"
#include "formats/import.h"

struct import_brdf_wish {
    enum brdf_kind kind;
    struct brdf_coding coding; /* of UTIA's files */
    int texels;                /* across and down, all alike; 0: 1 */
    double texel_mm;           /* 0: 1 */
    const char *directions; /* a table as btf_directions_read() takes it; NULL: UTIA's own 241, else
                               the papers' 81, of views and lights */
};

/* Values are B = π f_r cos θ_l at the directions. */
gboolean import_brdf(const char *path, const char *file, const struct import_brdf_wish *wish,
                     const struct work *work, struct import_result *ret, GError **error);

/* Imports a .ptm or .rti (rti.h) under the lights of a table, or the papers' 81. f is sRGB, and
 * made linear. */
gboolean import_ptm(const char *path, const char *file, const char *directions,
                    const struct import_wish *wish, const struct work *work,
                    struct import_result *ret, GError **error);
