/* Parts of “mesorig check”: its plot, and what may be wrong. */
#pragma once

#include "base/output_file.h"
#include "btf/energy.h"
#include "common/plot.h"
#include "mdf/mdf_views.h"
#include "pipeline/prediction_product.h"

struct check {
    const char *path;
    OutputFile *plot; /* NULL, or the picture to draw */
    /* found */
    struct btf_matrix *btf; /* NULL: there is none */
    struct energy *energy;
    gboolean has_mdf;
    struct mdf_views_sums mdf;
    struct prediction_known predicted;
    char *exposures;       /* what to change about them; NULL: nothing */
    GPtrArray *suspicions; /* char * */
};

/* A CliWork; data: struct check, whose first fields and suspicions are set. It is an error if there
 * is neither a BTF nor an MDF. */
gboolean check_session(const struct work *work, gpointer data, GError **error);
void check_clear(struct check *check);

/* Draws E_r of all views and E_i of all lights, of the central texel and of the mean over texels,
 * as in Meseth et al. 2003 Fig. 3. */
gboolean plot_energy(const char *path, const struct btf_matrix *btf, const struct energy *energy,
                     GError **error);

/* Appends sentences (g_free()) that say which mistake explains impossible values: values that
 * contradict reciprocity, too much or too little energy. */
gboolean check_suspect_btf(const struct btf_matrix *btf, const struct energy *energy,
                           GPtrArray *ret, GError **error);

/* The same for an MDF with hardly any measured surface, or with surface above the reference
 * plane of the session's grid. */
void check_suspect_mdf(const struct mdf_views_sums *mdf, const struct session_grid *grid,
                       GPtrArray *ret);
