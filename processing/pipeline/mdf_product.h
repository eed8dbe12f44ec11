/* The MDF of a view from its sweeps' files, and the file of all of them: see pipeline.h. */
#pragma once

#include "catalogue.h"
#include "mdf/mdf_lines.h"

struct mdf_result {
    char *inputs; /* hash of what it was made of */
    int index;    /* of the view */
    double theta_deg, phi_deg;
    double centre_mm[3]; /* of the camera, in the sample frame */
    char *agreed;        /* hash of all views by which it was settled; empty: it was not */
    float *planes[6];    /* D, M, N, O, P, S of each texel: pipeline.h */
    struct mdf_lines lines;
};

void mdf_result_free(struct mdf_result *result); /* NULL is ignored */

/* Any thread. */
struct mdf_result *mdf_make_view(const struct mdf_job *job, const struct session_grid *grid,
                                 GCancellable *cancellable, GError **error);

/* results are of n views, NULL where there is none; here and below. */

/* Sets D and P of all by what they have measured (mdf_views.h), if they were not settled by the
 * same views before. Returns whether anything may have changed. */
gboolean mdf_settle(struct mdf_result *const *results, int n, const struct session_grid *grid,
                    GCancellable *cancellable);

gboolean mdf_write(const char *path, struct mdf_result *const *results, int n,
                   const struct session_grid *grid, GError **error);

/* Takes what there is of the catalogue's views; nothing if the file is missing or damaged. Returns
 * whether the file holds something else and should be written again. */
gboolean mdf_read(const char *path, const struct catalogue *catalogue,
                  struct mdf_result **ret_results);

/* How much of the texels of the views that there are was seen by themselves; and what others have
 * predicted of the rest. */
double mdf_coverage(struct mdf_result *const *results, int n, int n_texels, double *ret_predicted);
