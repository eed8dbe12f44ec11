/*
 * The preview window: a picture that the user turns with the mouse, and a panel that can be folded.
 * Dragging with the left button orbits, dragging with the right button moves the light, the wheel
 * zooms, and F1 shows all keys.
 *
 * The window follows a session. Products are opened again when they change. While there is no file
 * of eigen-maps yet, the window itself makes eigen-maps of the existing views (live.h). Until a
 * product or such eigen-maps can be shown, the window shows a material that needs no file. If a
 * file cannot be opened, the window shows a sentence with the reason.
 */
#pragma once

#include "viewer_options.h"

struct window_result {
    int n_frames;
    double seconds;       /* time spent drawing the frames */
    double first_seconds; /* time from the start of the program to the first picture */
    char *renderer;       /* g_free() */
    struct viewer_memory memory;
};

/* Runs the window until the user closes it. Fails if there is no window, or if the card cannot
 * draw. If options->close_after is not 0, it also fails if the material, the shape or the
 * environment cannot be opened. */
gboolean window_run(const struct viewer_options *options, struct window_result *ret,
                    GError **error);
