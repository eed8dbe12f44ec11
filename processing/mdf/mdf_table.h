/* A mesostructure distance function as in products/mdf.exr (pipeline.h), prepared for drawing:
 * distances along the viewing ray become depths below the reference plane, which change little
 * between views, and texels that no laser saw get the values of their neighbours. */
#pragma once

#include <glib.h>

#define MDF_TABLE_ERROR mdf_table_error_quark()
GQuark mdf_table_error_quark(void);
enum mdf_table_error {
    MDF_TABLE_ERROR_FORMAT, /* parts are missing, differ in size, or have no distances */
};

#define MDF_TABLE_MAX_TEXELS (1 << 27) /* of all views together */

struct mdf_table {
    int width, height, n_views;
    double texel_mm;
    float *theta_deg, *phi_deg; /* n_views */
    float *depth_mm;            /* n_views × height × width; top row first */
    double deepest_mm;
    guint8 *seen; /* same shape: whether a laser saw the texel, or the view was traced; NULL: all */
};

/* Angles (n_views) are copied, NULL: 0; depths are not set, seen is NULL. */
struct mdf_table *mdf_table_new(int width, int height, int n_views, double texel_mm,
                                const float *theta_deg, const float *phi_deg);

/* Reads products/mdf.exr, or a compressed form of it (mdf_packed.h). */
struct mdf_table *mdf_table_read(const char *path, GError **error);
/* Adds unmeasured views at grazing angles, traced over the steep views' relief (mdf_grazing.c). */
void mdf_table_add_grazing(struct mdf_table *table);
/* For tests and benches: by how many standard deviations of the depths within a texel the relief
 * must be raised so that it has, traced along the flattest measured views, their mean depth. 0 … 2.
 */
double mdf_table_raised(const struct mdf_table *table);

/* For tests and benches: replaces all views by the picture of one relief, that of the steepest
 * views. */
void mdf_table_trace(struct mdf_table *table);

/* Sets texels below 0 of a periodic tile to their neighbours' mean; at least one must be ≥ 0. */
void mdf_table_fill(float *depth, int width, int height);

/* RMS difference in mm between the measured views of two tables, over texels that the first one
 * saw; ret_most_mm: the 99th percentile (may be NULL). */
double mdf_table_difference(const struct mdf_table *table, int n_measured,
                            const struct mdf_table *other, double *ret_most_mm);

typedef struct mdf_table MdfTable;
void mdf_table_free(struct mdf_table *table); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfTable, mdf_table_free)
