/* Compares the views of an MDF: the points of each view are looked up in the other views. Any
 * thread. */
#pragma once

#include "base/vec.h"
#include "mdf_lines.h"

#include <glib.h>

struct mdf_eye {           /* a view */
    double centre_mm[3];   /* camera centre, sample frame */
    const float *distance; /* n_texels, mm; −1 if unknown */
    const float *other;    /* second most likely distance, see mdf_view_other(); may be NULL */
    const float *lasers;   /* number of laser positions that saw each texel; may be NULL */
};

struct mdf_plane { /* the texels of the reference plane, see pipeline.h */
    int width, height;
    double texel_mm, reference_mm;
};

/* Returns the point on the ray of texel i that is distance_mm behind the reference plane, along the
 * ray. */
struct vec3 mdf_views_point(const struct mdf_eye *eye, const struct mdf_plane *plane, int i,
                            double distance_mm);

/* Gives the position at which the ray to the point p crosses the reference plane (ret_column,
 * ret_row), in texels from the centre of the first texel. ret_mm receives the distance of p behind
 * the plane, along the ray. Returns FALSE if the position is outside of the texels; the results are
 * set even then. */
gboolean mdf_views_look_up(const struct mdf_eye *eye, const struct mdf_plane *plane, struct vec3 p,
                           double *ret_column, double *ret_row, double *ret_mm);

/* Counts for each texel of a view how many other views confirm its point (ret_confirmed) and how
 * many deny it (ret_denied). At most 24 other views are asked, evenly spread.
 * - A view confirms a point that lies on the surface that it sees, within a third of a texel plus
 *   the slope of the surface between texels.
 * - A view denies a point through which it sees.
 * - A view does neither if the point is hidden, unknown or outside of its texels. */
void mdf_views_compare(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                       guint16 *ret_confirmed, guint16 *ret_denied);

/* Returns whether more views deny a point than confirm it. */
gboolean mdf_views_refuted(guint16 confirmed, guint16 denied);

/* Source of a texel's final distance. */
enum mdf_distance_source {
    MDF_UNSEEN,
    MDF_MEASURED, /* measured by the view itself */
    MDF_OTHER,    /* the view's own second distance, which at least one other view confirms */
    /* from other views: this view measured nothing, or other views refute its measurement */
    MDF_PREDICTED,
};

/* Completes a view with the help of all views. The view's own measurements stay, except where more
 * of the other views deny than confirm them. A refuted or missing value is replaced by the first of
 * these that exists:
 * - the view's second distance, if the surface of another view lies there and no view sees through
 *   that point
 * - the nearest surface along the texel's ray that at least two other views see and that hardly any
 *   view sees through. The surface is interpolated between neighbouring texels, but not across
 *   depth edges.
 *
 * A missing value is not replaced by a surface that continues that of measured neighbours: several
 * lasers would have reached this surface, and the view would have measured it. Without a
 * replacement the value is unknown (−1).
 *
 * The surface need not be a height field, because views in which a point is hidden do not count.
 * ret_source (n_texels) receives values of enum mdf_distance_source. */
void mdf_views_settle(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                      float *ret_distance, guint8 *ret_source);

struct mdf_views_sums {
    int n_views;
    /* texels: number of texels of all views
     * seen: number of texels with a distance */
    gint64 texels, seen;
    gint64 confirmed; /* number of texels that at least one other view confirms, and that are not
                         refuted */
    /* refuted: number of texels that more other views deny than confirm
     * unknown: number of texels with a distance that no other view confirms or denies */
    gint64 refuted, unknown;
    /* number of texels without a distance whose surface the laser shows above the reference
       plane */
    gint64 above;
    double denied_share; /* share of denials among all answers of other views */
    struct mdf_lines lines;
};

/* Reads products/mdf.exr and sums over its views. Uses the distances that each view measured itself
 * (channel M), or channel D if there is no M. Fails if the file cannot be read or has no views.
 * Fails also if a view
 * - lacks distances or the position of its camera,
 * - differs from the first view in size,
 * - has distances that are not finite, or
 * - has a camera below the reference plane. */
gboolean mdf_views_check(const char *path, struct mdf_views_sums *ret, GError **error);
