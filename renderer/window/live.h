/*
 * A session that is still being captured: eigen-maps of the views that processing has written so
 * far (products/btf), computed in a separate thread, and the list of planned views. While
 * more views have half of their pictures than processing has written, the eigen-maps are those of
 * the pictures so far, and of predicted ones (live_pictures.h).
 */
#pragma once

#include "codecs/eigenmaps/eigenmaps.h"
#include "scene/hatching.h"

/* Computes eigen-maps of the views that exist, and returns their number in *ret_n_views. Blocks.
 * Any thread may call it. */
struct eigenmaps *live_eigenmaps(const char *session, int *ret_n_views, GError **error);

/* Returns all planned views, a GArray of struct planned_view. Returns NULL with an error if session
 * is not a session. */
GArray *live_views(const char *session, GError **error);

typedef struct Live Live; /* belongs to one thread */

Live *live_new(const char *session);
void live_free(Live *live); /* ends the thread when it reads the next file; NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Live, live_free)

/* Returns immediately. If a computation has finished since the last call, returns its eigen-maps,
 * which the caller then owns, and the number of their views of the BTF in *ret_n_views. If it has
 * failed, returns NULL with an error. Otherwise returns NULL without an error. Starts a new
 * computation if there are more views than in the last one, or every few seconds to read pictures.
 */
struct eigenmaps *live_poll(Live *live, int *ret_n_views, GError **error);

/* Returns how many pictures are measured, and the expected error, for the user
 * (live_pictures_text()). Returns NULL before pictures were read. Valid until live_poll(). */
const char *live_text(const Live *live);

/* While the eigen-maps are those of pictures, marks the views of live_views() as measured of which
 * at least half of the pictures are measured. */
void live_mark_pictures(const Live *live, GArray *views);
