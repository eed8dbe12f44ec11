/*
 * The preview window: a picture that the mouse turns, and beside it a panel that folds. Drag left:
 * orbit; drag right: move the light; wheel: zoom; F1: all keys.
 *
 * The window follows a session: it opens products again when they change, and while the session has
 * no eigen-maps yet, it makes eigen-maps of the views that are there (live.h). Until something can
 * be shown, it shows a material that needs no file. If a file cannot be opened, the window says why
 * in a sentence.
 */
#pragma once

#include "viewer_options.h"

struct window_result {
    int n_frames;
    double seconds;       /* spent drawing them */
    double first_seconds; /* from the program's start to the first picture */
    char *renderer;       /* g_free() it */
    struct viewer_memory memory;
};

/* Returns when the user closes the window. Fails if there is none, if the card cannot draw, and
 * with close_after also if the material, the shape or the environment cannot be opened. */
gboolean window_run(const struct viewer_options *options, struct window_result *ret,
                    GError **error);
