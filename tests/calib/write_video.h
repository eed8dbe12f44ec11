/* Writes a Motion JPEG AVI by OpenCV. */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* frames: n_frames × height × width, grey. */
void write_video(const char *path, const guint8 *frames, int n_frames, int width, int height);

G_END_DECLS
