/* Looks up a point of one view in another. Shared by mdf_views.c and mdf_settle.c. Any thread. */
#pragma once

#include "mdf_views.h"

/* in texels; points that are closer than this are on the same surface */
#define MDF_TOLERANCE 0.33
/* maximum number of views with which a view is compared; if there are more, an evenly spaced
 * selection is used */
#define MDF_MAX_ASKED 24

enum mdf_answer { MDF_NO_ANSWER, MDF_CONFIRMED, MDF_DENIED };

enum mdf_answer mdf_views_ask(const struct mdf_eye *other, const struct mdf_plane *plane,
                              struct vec3 p);

/* mdf_views_asked() returns the number of views with which a view is compared. mdf_views_other()
 * returns the index of the k-th of them. */
int mdf_views_asked(int n);
int mdf_views_other(int n, int view, int k);

/* Counts the views, among those with which a view is compared, that confirm and that deny a
 * point. */
void mdf_views_poll(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                    struct vec3 p, guint16 *ret_confirmed, guint16 *ret_denied);
