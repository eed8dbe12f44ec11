/* Writes a picture with all settings needed to reproduce it, as text chunks of the PNG file. */
#pragma once

#include "scene/compose.h"

struct snapshot {
    const char *material; /* path; only its last parts are shown */
    const char *shape;
    gboolean floor;                      /* under it */
    const struct method *first, *second; /* second: NULL, or what the first is compared with */
    const struct compose *how;
    gboolean reference;                     /* from the whole BTF instead */
    const struct viewer_settings *settings; /* tiles as they are, not 0 */
    const char *environment;                /* its file, or NULL */
    const char *mdf, *normal_map;           /* the same */
    int n_views, n_planned;                 /* of a session that is being captured; else 0 */
};

gboolean snapshot_write(const char *path, const struct snapshot *snapshot, const guint8 *rgb,
                        int width, int height, GError **error);

/* The same of viewer_render_light(), as EXR. */
gboolean snapshot_write_light(const char *path, const struct snapshot *snapshot, const float *rgb,
                              int width, int height, GError **error);
