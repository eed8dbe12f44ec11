/* A mesostructure distance function as in products/mdf.exr (pipeline.h), prepared for drawing.
 * Distances along the viewing ray become depths below the reference plane, which change little
 * between views. Texels that no laser saw get the values of their neighbours. */
#pragma once

#include <glib.h>

#define MDF_TABLE_ERROR mdf_table_error_quark()
GQuark mdf_table_error_quark(void);
enum mdf_table_error {
    /* The file has no views or too many texels. Or a view lacks distances, differs from the first
     * view in size, has no texel that a laser saw, or has a distance, a scale or a texel size out
     * of range. */
    MDF_TABLE_ERROR_FORMAT,
};

#define MDF_TABLE_MAX_TEXELS (1 << 27) /* maximum number of texels of all views together */

struct mdf_table {
    int width, height, n_views;
    /* the first n_measured views are measured, the others are added; 0: all are measured */
    int n_measured;
    double texel_mm;
    float *theta_deg, *phi_deg; /* n_views */
    float *depth_mm;            /* n_views × height × width; top row first */
    double deepest_mm;
    /* for each element of depth_mm, whether a laser saw the texel, or the view was traced; NULL
     * means TRUE for all */
    guint8 *seen;
};

/* Creates a table. theta_deg and phi_deg have n_views elements and are copied; if one is NULL, its
 * angles are 0. The depths are not set, and seen is NULL. */
struct mdf_table *mdf_table_new(int width, int height, int n_views, double texel_mm,
                                const float *theta_deg, const float *phi_deg);

/* Returns a copy of the measured views only. */
struct mdf_table *mdf_table_copy_measured(const struct mdf_table *table);

/* Reads products/mdf.exr, or a compressed form of it (mdf_packed.h). Returns NULL with
 * MDF_TABLE_ERROR_FORMAT, or with an error of exr_read() or exr_get_double(). */
struct mdf_table *mdf_table_read(const char *path, GError **error);
/* Adds views at grazing angles, which were not measured. The added views are traced over the relief
 * of the steep views (mdf_grazing.c). */
void mdf_table_add_grazing(struct mdf_table *table);
/* For tests and benches. Returns by how much the relief must be raised so that views traced in the
 * flattest measured directions have the measured mean depth. The unit is the standard deviation of
 * the depths within a texel; the result is 0 … 2. */
double mdf_table_raised(const struct mdf_table *table);

/* For tests and benches. Replaces the depths of all views by those of one relief, which is made
 * from the steepest views. */
void mdf_table_trace(struct mdf_table *table);

/* Sets texels with values below 0 to the mean of their neighbours. The texels are a periodic
 * tile. At least one must be ≥ 0. */
void mdf_table_fill(float *depth, int width, int height);

/* Returns the RMS difference in mm between the depths of the first n_measured views of two tables,
 * over texels that a laser saw in the first table. ret_most_mm (may be NULL) receives the 99th
 * percentile of the absolute differences. Both are 0 if no laser saw a texel. */
double mdf_table_difference(const struct mdf_table *table, int n_measured,
                            const struct mdf_table *other, double *ret_most_mm);

typedef struct mdf_table MdfTable;
void mdf_table_free(struct mdf_table *table); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfTable, mdf_table_free)
