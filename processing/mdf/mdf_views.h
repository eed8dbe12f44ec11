/*
 * Whether the views of an MDF agree: a point that one view sees is looked for in the others. Any
 * thread.
 */
#pragma once

#include "mdf_lines.h"

#include <gio/gio.h>

struct mdf_eye {           /* a view */
    double centre_mm[3];   /* of the camera, sample frame */
    const float *distance; /* of each texel, mm; −1: not seen */
    const float *other;    /* what else it may have seen there, mdf_view_other(); may be NULL */
    const float *lasers;   /* positions that saw it; may be NULL */
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

/* Where a texel's distance is from in the end. */
enum mdf_source {
    MDF_UNSEEN,
    MDF_MEASURED,  /* the view's own */
    MDF_OTHER,     /* the view's own, too: what it may have seen, which others confirm */
    MDF_PREDICTED, /* from where others see the surface; the view itself measured nothing there, or
                      something that they refute */
};

/* What a view sees, by all views. Its own measurements stand unless more of the others deny than
 * confirm them; in place of those, and where it has none, comes what it may have seen if others see
 * that as well; else the nearest surface along its ray that at least two others see (each as it
 * lies between four neighbouring texels that are on one surface, so that no view's edges are
 * bridged) and that hardly any sees through; else, of what was refuted, nothing. Structure that is
 * no height field is not harmed: a point is looked for along each view's own ray, and views to
 * which it is hidden say nothing of it. ret_source: of each texel, enum mdf_source. */
void mdf_views_settle(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                      float *ret_distance, guint8 *ret_source);

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
