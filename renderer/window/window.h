/*
 * The preview window: a picture that the mouse turns, and a panel over it. Drag left: orbit; drag
 * right: move the light; wheel: zoom; F1: help.
 *
 * A session is followed: its products are opened again when they change, and while it has no
 * eigen-maps yet, those of the views that are there are made (live.h). Until something can be
 * shown, a material that needs no file is.
 */
#pragma once

#include "scene/compose.h"

struct window_options {
    const struct method *method, *second; /* second: NULL, or to compare with */
    struct compose compose;
    const char *argument;   /* a session's directory or a file; NULL: the method needs none */
    const char *normal_map; /* a file, for methods that take one; NULL: their own */
    const char *mdf;        /* path of the material's distances; need not be there */
    const struct environment *environment; /* or NULL */
    const char *environment_path;
    const char *shape; /* of scene.h */
    enum scene_up up;
    gboolean floor; /* under the shape */
    int width, height;
    int close_after;        /* frames; 0: when the user closes it */
    const char *screenshot; /* written before it closes; NULL: none */
    gboolean with_panel;    /* that is the window as it is, with its panel */
    gint64 started_us;      /* the program, of g_get_monotonic_time() */
    struct viewer_settings settings;
};

struct window_result {
    int n_frames;
    double seconds;       /* spent drawing them */
    double first_seconds; /* from the program's start to the first picture */
    char *renderer;       /* g_free() it */
    struct viewer_memory memory;
};

gboolean window_run(const struct window_options *options, struct window_result *ret,
                    GError **error);
