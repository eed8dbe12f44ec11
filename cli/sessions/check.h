/* Parts of “mesorig check”: its plot, and its suspicions about mistakes in the input. */
#pragma once

#include "base/output_file.h"
#include "btf/energy.h"
#include "common/plot.h"
#include "mdf/mdf_views.h"
#include "pipeline/prediction_product.h"

struct check {
    const char *path;
    OutputFile *plot; /* the picture to draw, or NULL */
    /* results */
    struct btf_matrix *btf; /* NULL if there is none */
    struct energy *energy;
    gboolean has_mdf;
    struct mdf_views_sums mdf;
    struct prediction_known predicted;
    char *exposures;       /* what to change in the exposures; NULL if nothing */
    GPtrArray *suspicions; /* of char * */
};

/* Checks a session; a CliWork. data is a struct check of which path, plot and suspicions are set.
 * Fails if there is neither a BTF nor an MDF. Free the results with check_clear(). */
gboolean check_session(const struct work *work, gpointer data, GError **error);
void check_clear(struct check *check);

/* Draws E_r of all views and E_i of all lights, for the central texel and for the mean over all
 * texels, as in Meseth et al. 2003 Fig. 3. */
gboolean plot_energy(const char *path, const struct btf_matrix *btf, const struct energy *energy,
                     GError **error);

/* Appends sentences (g_free()) that name the mistake that explains impossible values: values that
 * contradict reciprocity, too much or too little energy. */
gboolean check_suspect_btf(const struct btf_matrix *btf, const struct energy *energy,
                           GPtrArray *ret, GError **error);

/* Appends a sentence (g_free()) for an MDF that has hardly any measured surface, or that has
 * surface above the reference plane of the session's grid. */
void check_suspect_mdf(const struct mdf_views_sums *mdf, const struct session_grid *grid,
                       GPtrArray *ret);
