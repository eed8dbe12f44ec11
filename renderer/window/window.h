/*
 * The preview window: a picture that the mouse turns, and a panel over it. Drag left: orbit; drag
 * right: move the light; wheel: zoom; F1: help.
 *
 * A session is followed: its products are opened again when they change, and while it has no
 * eigen-maps yet, those of the views that are there are made (live.h). Until something can be
 * shown, a material that needs no file is.
 */
#pragma once

#include "scene/environment.h"
#include "viewer_options.h"

struct window_result {
    int n_frames;
    double seconds;       /* spent drawing them */
    double first_seconds; /* from the program's start to the first picture */
    char *renderer;       /* g_free() it */
    struct viewer_memory memory;
};

/* environment: or NULL. */
gboolean window_run(const struct viewer_options *options, const struct environment *environment,
                    struct window_result *ret, GError **error);
