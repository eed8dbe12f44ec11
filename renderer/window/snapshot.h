/* Writes a picture with all settings needed to reproduce it, as text chunks of the PNG file. */
#pragma once

#include "viewer_options.h"

struct snapshot {
    const char *material; /* path; only its last parts are written */
    const char *shape;
    const struct method *first, *second; /* second: NULL, or what the first is compared with */
    const struct compose *how;
    gboolean reference;                     /* from the whole BTF instead */
    const struct viewer_settings *settings; /* tiles as they are, not 0 */
    const struct viewer_options *options;   /* for files that it was made with, and the floor */
    int n_views, n_planned;                 /* of a session that is being captured; else 0 */
};

/* Writes rgb, from viewer_render(), as PNG, or light, from viewer_render_light(), as EXR. The other
 * one is NULL. */
gboolean snapshot_write(const char *path, const struct snapshot *snapshot, const guint8 *rgb,
                        const float *light, int width, int height, GError **error);
