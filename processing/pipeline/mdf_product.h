/* Makes the MDF of a view from the files of its sweeps, and the file of all views. See
 * pipeline.h. */
#pragma once

#include "catalogue.h"
#include "mdf/mdf_lines.h"

struct mdf_result {
    char *inputs; /* hash of the view's inputs */
    int index;    /* position in the session's list of views, from 0 */
    double theta_deg, phi_deg;
    double centre_mm[3]; /* position of the camera in the sample frame */
    /* hash of all views from which D and P were set; empty if D and P were set from this view
     * alone */
    char *agreed;
    float *planes[6]; /* D, M, N, O, P, S of each texel: pipeline.h */
    struct mdf_lines lines;
    int above; /* number of texels from mdf_view_above() */
};

void mdf_result_free(struct mdf_result *result); /* NULL is ignored */

/* Makes the MDF of a view. D and P are set from this view alone; mdf_settle() completes them.
 * Returns NULL with an error if the file of a sweep cannot be read, if its sweep is not that of the
 * plan, if lines_in_pictures needs a frame that was not kept, or if cancelled. Any thread. */
struct mdf_result *mdf_make_view(const struct mdf_job *job, const struct session_grid *grid,
                                 GCancellable *cancellable, GError **error);

/* In this function and the following ones, results has n elements, one for each view; the element
 * of a missing view is NULL. */

/* Sets D and P of all views from their measurements (mdf_views.h). Does nothing if they were
 * already set from the same views. settled is called after each view. If cancelled, the remaining
 * views stay as they are. Returns whether any value may have changed. */
gboolean mdf_settle(struct mdf_result *const *results, int n, const struct session_grid *grid,
                    GCancellable *cancellable, void (*settled)(gpointer data), gpointer data);

gboolean mdf_write(const char *path, struct mdf_result *const *results, int n,
                   const struct session_grid *grid, GError **error);

/* Reads the catalogue's views from the file to ret_results, which has one element for each of these
 * views. Reads none if the file is missing or damaged. Returns TRUE if the file should be written
 * again: it is damaged, or it has other parts than the views that were read. Returns FALSE
 * otherwise, also if the file is missing. */
gboolean mdf_read(const char *path, const struct catalogue *catalogue,
                  struct mdf_result **ret_results);

/* Returns the share of the texels of all existing views whose D was measured by the view itself (M
 * or O). ret_predicted receives the share that was predicted from other views. Both are 0 if there
 * are no views. */
double mdf_coverage(struct mdf_result *const *results, int n, int n_texels, double *ret_predicted);
