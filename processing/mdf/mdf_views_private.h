/* What one view says of another's point: shared by mdf_views.c and mdf_settle.c. Any thread. */
#pragma once

#include "base/vec.h"
#include "mdf_views.h"

#define MDF_TOLERANCE  0.33 /* of a texel: closer is the same surface */
#define MDF_MOST_ASKED 24   /* views that each is compared with: evenly chosen of more */

enum mdf_answer { MDF_NO_ANSWER, MDF_CONFIRMED, MDF_DENIED };

/* Where the ray of texel i is, that far behind the reference plane. */
struct vec3 mdf_views_point(const struct mdf_eye *eye, const struct mdf_plane *plane, int i,
                            double distance_mm);

/* Where the ray from an eye to a point comes through the reference plane, in texels from the centre
 * of the first one, and how far behind that the point lies. FALSE if past the texels. */
gboolean mdf_views_look_up(const struct mdf_eye *eye, const struct mdf_plane *plane, struct vec3 p,
                           double *ret_column, double *ret_row, double *ret_mm);

enum mdf_answer mdf_views_ask(const struct mdf_eye *other, const struct mdf_plane *plane,
                              struct vec3 p);

/* How many others a view is compared with, and which the k-th of them is. */
int mdf_views_asked(int n);
int mdf_views_other(int n, int view, int k);

/* All of them about a point. */
void mdf_views_poll(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                    struct vec3 p, guint16 *ret_confirmed, guint16 *ret_denied);
