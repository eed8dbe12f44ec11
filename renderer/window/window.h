/*
 * The preview window: a picture that the mouse turns, and beside it a panel that folds. Drag left:
 * orbit; drag right: move the light; wheel: zoom; F1: all keys.
 *
 * A session is followed: its products are opened again when they change, and while it has no
 * eigen-maps yet, those of the views that are there are made (live.h). Until something can be
 * shown, a material that needs no file is. What cannot be opened is a sentence in the window.
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
