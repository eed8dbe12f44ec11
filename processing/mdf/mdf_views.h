/* Consistency of an MDF's views: each view's points are looked up in the others. Any thread. */
#pragma once

#include "base/vec.h"
#include "mdf_lines.h"

#include <gio/gio.h>

struct mdf_eye {           /* a view */
    double centre_mm[3];   /* camera centre, sample frame */
    const float *distance; /* n_texels, mm; −1: unknown */
    const float *other;    /* second most likely distance, mdf_view_other(); may be NULL */
    const float *lasers;   /* number of laser positions that saw it; may be NULL */
};

struct mdf_plane { /* texels of the reference plane, see pipeline.h */
    int width, height;
    double texel_mm, reference_mm;
};

/* The point on the ray of texel i at a distance behind the reference plane. */
struct vec3 mdf_views_point(const struct mdf_eye *eye, const struct mdf_plane *plane, int i,
                            double distance_mm);

/* Where the ray to a point crosses the reference plane, in texels from the centre of the first, and
 * the point's distance in mm behind it. FALSE: outside of the texels; set all the same. */
gboolean mdf_views_look_up(const struct mdf_eye *eye, const struct mdf_plane *plane, struct vec3 p,
                           double *ret_column, double *ret_row, double *ret_mm);

/* Counts for each texel of a view how many other views confirm its point (they see it there, to a
 * third of a texel plus the slope of the surface between texels), and how many deny it (they see
 * through it). Views in which it is hidden, or that look past the texels, count as neither. */
void mdf_views_compare(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                       guint16 *ret_confirmed, guint16 *ret_denied);

/* Whether more views deny than confirm. */
gboolean mdf_views_refuted(guint16 confirmed, guint16 denied);

/* Source of a texel's final distance. */
enum mdf_distance_source {
    MDF_UNSEEN,
    MDF_MEASURED,  /* the view's own */
    MDF_OTHER,     /* the view's own second distance, confirmed by others */
    MDF_PREDICTED, /* from other views, where this one measured nothing, or what they refute */
};

/* Completes a view by all views. Its own measurements stand unless more of the others deny than
 * confirm them. Refuted and missing values are replaced by the view's second distance if another's
 * surface lies there and none sees through it; else by the nearest surface along its ray that at
 * least two others see (between neighbouring texels on one surface, not across depth edges) and
 * hardly any sees through; else they are unknown. No height field is assumed: views in which a
 * point is hidden do not count. ret_source (n_texels): enum mdf_distance_source. */
void mdf_views_settle(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                      float *ret_distance, guint8 *ret_source);

struct mdf_views_sums {
    int n_views;
    gint64 texels, seen; /* of all views */
    gint64 confirmed;    /* by at least one other view, and not refuted */
    gint64 refuted, unknown;
    gint64 above;        /* unknown to their view: the laser shows them above the reference plane */
    double denied_share; /* of all answers of other views */
    struct mdf_lines lines;
};

/* Reads products/mdf.exr and sums over its views. */
gboolean mdf_views_check(const char *path, struct mdf_views_sums *ret, GError **error);
