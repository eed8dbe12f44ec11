/* Looking up a point of one view in another: shared by mdf_views.c and mdf_settle.c. Any thread. */
#pragma once

#include "mdf_views.h"

#define MDF_TOLERANCE 0.33 /* of a texel: closer points are on the same surface */
#define MDF_MAX_ASKED 24   /* views that each is compared with: of more, an even selection */

enum mdf_answer { MDF_NO_ANSWER, MDF_CONFIRMED, MDF_DENIED };

enum mdf_answer mdf_views_ask(const struct mdf_eye *other, const struct mdf_plane *plane,
                              struct vec3 p);

/* Number of views that a view is compared with, and index of the k-th of them. */
int mdf_views_asked(int n);
int mdf_views_other(int n, int view, int k);

/* Counts their answers about a point. */
void mdf_views_poll(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                    struct vec3 p, guint16 *ret_confirmed, guint16 *ret_denied);
