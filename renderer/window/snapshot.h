/* Writes a picture with all settings that are needed to reproduce it. In a PNG file the settings
 * are text chunks, and in an EXR file attributes. */
#pragma once

#include "viewer_options.h"

struct snapshot {
    const char *material; /* path; only its last parts are written */
    const char *shape;
    /* second is the method with which first is compared, or NULL. */
    const struct method *first, *second;
    const struct compose *how;
    gboolean reference;                     /* the picture is a reference from the whole BTF */
    const struct viewer_settings *settings; /* with the actual numbers of tiles, not 0 */
    /* options with the files from which the picture was made, and the floor */
    const struct viewer_options *options;
    int n_views, n_planned; /* numbers of measured and of planned views of a live session, else 0 */
};

/* Writes rgb, which comes from compose_render(), as PNG, or light, which comes from
 * viewer_render_light(), as EXR. The other one is NULL. */
gboolean snapshot_write(const char *path, const struct snapshot *snapshot, const guint8 *rgb,
                        const float *light, int width, int height, GError **error);
