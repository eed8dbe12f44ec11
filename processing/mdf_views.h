/*
 * Whether the views of an MDF agree: a point that one view sees is looked for in the others. Any
 * thread.
 */
#pragma once

#include "mdf_product.h"

#include <gio/gio.h>

struct mdf_eye {           /* a view */
    double centre_mm[3];   /* of the camera, sample frame */
    const float *distance; /* of each texel, mm; −1: not seen */
};

struct mdf_plane { /* texels of the reference plane, as in pipeline.h */
    int width, height;
    double texel_mm, reference_mm;
};

/* How many others of n views confirm each texel of a view: they see its point there, to a third of
 * a texel and what the surface rises between texels; and how many deny it: they see through it.
 * Views for which something lies before it, or that look past the texels, say neither. */
void mdf_views_compare(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                       guint16 *ret_confirmed, guint16 *ret_denied);

/* More deny than confirm it. */
gboolean mdf_views_refuted(guint16 confirmed, guint16 denied);

struct mdf_views_sums {
    int n_views;
    gint64 texels, seen; /* of all views */
    gint64 confirmed;    /* by one other view at least, and not refuted */
    gint64 refuted, unknown;
    double denied_share; /* of all that others said of a point */
    struct mdf_lines lines;
};

/* Of a products/mdf.exr. */
gboolean mdf_views_check(const char *path, struct mdf_views_sums *ret, GError **error);
