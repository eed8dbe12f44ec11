/*
 * A mesostructure distance function as products/mdf.exr holds it (pipeline.h), made ready for
 * drawing: distances along the viewing ray become depths below the reference plane, which change
 * little from one view to the next, and texels that no laser saw take those of their neighbours.
 */
#pragma once

#include <glib.h>

#define MDF_TABLE_ERROR mdf_table_error_quark()
GQuark mdf_table_error_quark(void);
enum mdf_table_error {
    MDF_TABLE_ERROR_FORMAT, /* parts are missing, differ in size, or hold no distances */
};

#define MDF_TABLE_MAX_TEXELS (1 << 27) /* of all views */

struct mdf_table {
    int width, height, n_views;
    double texel_mm;
    float *theta_deg, *phi_deg; /* of each view */
    float *depth_mm;            /* view × row × column; top row first */
    double deepest_mm;
    guint8 *seen; /* of each texel of each view read: whether a laser saw it; NULL: all */
};

/* products/mdf.exr, or what mdf_packed.h made of it. */
struct mdf_table *mdf_table_read(const char *path, GError **error);
/* Adds views nearly along the surface, traced over the relief that the measured ones give, where
 * none was measured. */
void mdf_table_add_grazing(struct mdf_table *table);

/* All views become what one relief, that which the steepest ones give, looks like from there. */
void mdf_table_trace(struct mdf_table *table);

/* Texels below 0 of a tile that repeats take the mean of their neighbours; there must be one that
 * is not. */
void mdf_table_fill(float *depth, int width, int height);

/* RMS in mm between measured views of two tables, of texels that the first one saw; and what 99 %
 * of them are within (NULL: not asked). */
double mdf_table_difference(const struct mdf_table *table, int n_measured,
                            const struct mdf_table *other, double *ret_most_mm);

struct mdf_table *mdf_table_copy(const struct mdf_table *table);
void mdf_table_free(struct mdf_table *table); /* NULL is ignored */
