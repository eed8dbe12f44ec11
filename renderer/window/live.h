/*
 * A session that is still being captured: eigen-maps of the views that processing has written so
 * far (products/btf), computed in a thread of their own, and the list of planned views.
 */
#pragma once

#include "eigenmaps/eigenmaps.h"
#include "scene/hatching.h"

/* Computes eigen-maps of the views that exist, and their number. Blocks. Any thread. */
struct eigenmaps *live_eigenmaps(const char *session, int *ret_n_views, GError **error);

/* All planned views, a GArray of struct planned_view; NULL with an error if session is not one. */
GArray *live_views(const char *session, GError **error);

typedef struct Live Live; /* belongs to one thread */

Live *live_new(const char *session);
void live_free(Live *live); /* NULL is ignored; ends the thread where it next reads */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Live, live_free)

/* Returns at once: NULL, or newer eigen-maps than before, which the caller then owns. Computes
 * again when there are more views than last time. NULL with an error once a computation has
 * failed. */
struct eigenmaps *live_poll(Live *live, int *ret_n_views, GError **error);
