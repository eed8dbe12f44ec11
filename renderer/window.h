/* The preview window. Drag left: orbit; drag right: move the light; wheel: zoom; F1: help. */
#pragma once

#include "view.h"

struct window_options {
    const struct method *method;
    const char *material; /* path: shown in the title, and read again when it changes */
    const char *mdf;      /* path of the material's distances; need not be there */
    const char *shape;    /* of scene.h */
    enum scene_up up;
    gboolean floor; /* under the shape */
    int width, height;
    int close_after;        /* frames; 0: when the user closes it */
    const char *screenshot; /* written before an automatic close; NULL: none */
    struct view_settings settings;
};

struct window_result {
    int n_frames;
    double seconds; /* spent drawing them */
    char *renderer; /* g_free() it */
};

gboolean window_run(const struct window_options *options, struct window_result *ret,
                    GError **error);
