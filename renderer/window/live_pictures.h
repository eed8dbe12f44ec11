/*
 * The pictures of a session so far, and the prediction of the others (processing/partial). The
 * window shows them while processing has written few views or none. Measured and predicted pictures
 * are returned together, as eigen-maps. A line of text says how many pictures are measured.
 *
 * live_pictures_read() and live_pictures_eigenmaps() take seconds. A LivePictures belongs to one
 * thread at a time.
 */
#pragma once

#include "base/work.h"
#include "codecs/eigenmaps/eigenmaps.h"

typedef struct LivePictures LivePictures;

LivePictures *live_pictures_new(const char *session);
void live_pictures_free(LivePictures *pictures); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LivePictures, live_pictures_free)

/* Reads the pictures that are new, and predicts the others. Returns whether any picture is new.
 * Returns FALSE with an error if the session cannot be read, if it has no pictures under lamps, or
 * if stop is cancelled. */
gboolean live_pictures_read(LivePictures *pictures, GCancellable *stop, GError **error);

/* Makes eigen-maps of all planned views, from measured and predicted pictures. At least one picture
 * must have been measured. Fails if stop is cancelled. */
struct eigenmaps *live_pictures_eigenmaps(LivePictures *pictures, GCancellable *stop,
                                          GError **error);

/* Returns a line of text such as “200 of 3600 pictures are measured. Expected error 4.1 % (3.6 to
 * 4.7 %), 2 % in about 6 min.” Free it with g_free(). */
char *live_pictures_text(const LivePictures *pictures);

/* Returns the number of planned views, or 0 before the first live_pictures_read(). */
int live_pictures_n_views(const LivePictures *pictures);
/* Returns whether at least half of the pictures of a view are measured. */
gboolean live_pictures_has_view(const LivePictures *pictures, int view);
