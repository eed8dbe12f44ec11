/* Makes the MDF of a view from its sweeps' files, and the file of all views: see pipeline.h. */
#pragma once

#include "catalogue.h"
#include "mdf/mdf_lines.h"

struct mdf_result {
    char *inputs; /* hash of its inputs */
    int index;    /* of the view */
    double theta_deg, phi_deg;
    double centre_mm[3]; /* of the camera, in the sample frame */
    char *agreed;        /* hash of all views that settled it; empty: not settled */
    float *planes[6];    /* D, M, N, O, P, S of each texel: pipeline.h */
    struct mdf_lines lines;
    int above; /* mdf_view_above() */
};

void mdf_result_free(struct mdf_result *result); /* NULL is ignored */

/* Any thread. */
struct mdf_result *mdf_make_view(const struct mdf_job *job, const struct session_grid *grid,
                                 GCancellable *cancellable, GError **error);

/* Here and below: results of n views, NULL where there is none. */

/* Sets D and P of all views from their measurements (mdf_views.h), unless they were set from the
 * same views before. settled is called after each view. Returns whether anything may have
 * changed. */
gboolean mdf_settle(struct mdf_result *const *results, int n, const struct session_grid *grid,
                    GCancellable *cancellable, void (*settled)(gpointer data), gpointer data);

gboolean mdf_write(const char *path, struct mdf_result *const *results, int n,
                   const struct session_grid *grid, GError **error);

/* Reads the catalogue's views from the file; none if it is missing or damaged. Returns whether
 * the file differs from the results and should be written again. */
gboolean mdf_read(const char *path, const struct catalogue *catalogue,
                  struct mdf_result **ret_results);

/* Returns the share of all texels of the existing views that was measured; ret_predicted: the share
 * that other views predicted. */
double mdf_coverage(struct mdf_result *const *results, int n, int n_texels, double *ret_predicted);
