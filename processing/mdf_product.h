/* The MDF of a view from its sweeps' files, and the file of all of them: see pipeline.h. */
#pragma once

#include "catalogue.h"

/* What lines in the reference region said of the sweeps' planes. */
struct mdf_lines {
    int sweeps, found, disagree; /* found: with a line; disagree: of them, with the calibration */
    double squares_deg2;         /* of the sheets' angles against the calibration, found */
    double worst_deg;            /* of those that disagree, or else of all; signed */
    int worst_position;          /* laser position; −1: no line was found */
};
struct mdf_result {
    char *inputs; /* hash of what it was made of */
    int index;    /* of the view */
    double theta_deg, phi_deg;
    double centre_mm[3]; /* of the camera, in the sample frame */
    float *planes[3];    /* D, N, S of each texel */
    struct mdf_lines lines;
};

void mdf_result_free(struct mdf_result *result); /* NULL is ignored */

/* Any thread. */
struct mdf_result *mdf_make_view(const struct mdf_job *job, const struct session_grid *grid,
                                 GCancellable *cancellable, GError **error);

/* results are of n views, NULL where there is none. */
gboolean mdf_write(const char *path, struct mdf_result *const *results, int n,
                   const struct session_grid *grid, GError **error);

/* Takes what there is of the catalogue's views; nothing if the file is missing or damaged. Returns
 * whether the file holds something else and should be written again. */
gboolean mdf_read(const char *path, const struct catalogue *catalogue,
                  struct mdf_result **ret_results);

/* Of a part of products/mdf.exr; FALSE: it does not say. */
gboolean mdf_lines_read(const struct exr_part *part, struct mdf_lines *ret);

/* Adds those of one view or of several. */
void mdf_lines_add(struct mdf_lines *to, const struct mdf_lines *more);

/* How much of the texels of the views that there are was seen. */
double mdf_coverage(struct mdf_result *const *results, int n, int n_texels);
