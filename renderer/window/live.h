/*
 * A session that is still being captured: its list of planned views, and its eigen-maps so far,
 * which a separate thread computes. Usually the eigen-maps are made from the views that processing
 * has written (products/btf).
 *
 * A view is called half captured if at least half of its pictures are measured. If there are more
 * half captured views than written views, the eigen-maps are made from the pictures so far and from
 * predicted pictures (live_pictures.h).
 */
#pragma once

#include "codecs/eigenmaps/eigenmaps.h"
#include "scene/hatching.h"

/* Computes eigen-maps of the views that processing has written. *ret_n_views is the number of these
 * views. Returns NULL with an error on failure. Blocks. Any thread may call it. */
struct eigenmaps *live_eigenmaps(const char *session, int *ret_n_views, GError **error);

/* Returns all planned views, a GArray of struct planned_view. `measured` of a view says whether
 * processing has written the view. Free the array with g_array_unref(). Returns NULL with an error
 * if session is not a session. */
GArray *live_views(const char *session, GError **error);

typedef struct Live Live; /* belongs to one thread */

Live *live_new(const char *session);
void live_free(Live *live); /* waits until the thread has ended; NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Live, live_free)

/* If a computation has finished since the last call, returns its result. Otherwise starts a
 * computation if none is running and one is due. Does not wait.
 *
 * If the computation has succeeded, returns its eigen-maps, which the caller then owns.
 * *ret_n_views is then the number of views of the BTF in the eigen-maps, or 0 if they are made from
 * pictures. If the computation has failed, returns NULL with an error. If none has finished,
 * returns NULL without an error.
 *
 * A computation is due when the BTF has more views than in the last computation. It is also due
 * every few seconds, to read pictures. */
struct eigenmaps *live_poll(Live *live, int *ret_n_views, GError **error);

/* Returns a text for the user: how many pictures are measured, and the expected error
 * (live_pictures_text()). Returns NULL while no pictures have been read. The text is valid until
 * the next call of live_poll(). */
const char *live_text(const Live *live);

/* If the eigen-maps are made from pictures, sets `measured` of each view of live_views(). It
 * becomes TRUE if at least half of the pictures of the view are measured, and otherwise FALSE. If
 * the eigen-maps are not made from pictures, nothing is changed. */
void live_mark_pictures(const Live *live, GArray *views);
