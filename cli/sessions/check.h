/* Parts of “mesorig check”: its plot, and its suspicions about mistakes in the input. */
#pragma once

#include "base/output_file.h"
#include "btf/energy.h"
#include "common/plot.h"
#include "mdf/mdf_views.h"
#include "pipeline/prediction_product.h"

/* The error of interpolation between the measured directions. To find it, some views and lights
 * that were measured are predicted from the others. */
struct check_directions {
    /* Numbers of views and lights that were predicted. Both are 0 if there are too few directions,
     * or if they cannot be interpolated. */
    int views, lights;
    double error; /* RMS error of R, G and B, relative to the measured values */
};

struct check {
    const char *path;
    OutputFile *plot; /* the picture to draw, or NULL */
    /* results */
    struct btf_matrix *btf; /* NULL if there is none */
    struct energy *energy;
    struct check_directions directions;
    gboolean has_mdf;
    struct mdf_views_sums mdf;
    struct prediction_known predicted;
    char *exposures;       /* advice how to change the exposures; NULL if there is none */
    GPtrArray *suspicions; /* of char * */
};

/* Checks a session. The function is a CliWork, and data is a struct check. The caller sets its
 * members path, plot and suspicions. Returns FALSE with an error if the session has neither a BTF
 * nor an MDF. Free the results with check_clear(). */
gboolean check_session(const struct work *work, gpointer data, GError **error);
void check_clear(struct check *check);

/* Draws the energies E_r of all views and E_i of all lights (btf/energy.h), as in Meseth et al.
 * 2003 Fig. 3. They are drawn for the texel energy->texel, and for the mean over all texels. path
 * ends in .png or .svg. */
gboolean plot_energy(const char *path, const struct btf_matrix *btf, const struct energy *energy,
                     GError **error);

/* Leaves out a tenth of the views and of the lights, which are chosen at random with the seed 1,
 * and predicts them from the others. Uses at most 1024 texels (codecs/codec/held_out.h). */
gboolean check_directions(const struct btf_matrix *btf, struct check_directions *ret,
                          const struct work *work, GError **error);

/* Looks for values that no material has, and appends sentences (g_free()) that name the mistake
 * that explains them. The mistakes are, in this order:
 * - values that contradict reciprocity,
 * - lights that are dark in all views,
 * - too much or too little energy.
 *
 * Only the first that applies is named, because it causes the others. Returns FALSE with an error
 * if the values cannot be read. */
gboolean check_suspect_btf(const struct btf_matrix *btf, const struct energy *energy,
                           GPtrArray *ret, GError **error);

/* Appends a sentence (g_free()) for an MDF that has hardly any measured surface, or that has
 * surface above the reference plane of the session's grid. */
void check_suspect_mdf(const struct mdf_views_sums *mdf, const struct session_grid *grid,
                       GPtrArray *ret);
