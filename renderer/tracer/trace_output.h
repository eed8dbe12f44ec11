/* Writes pictures as files: EXR (radiance) and PNG (exposed, with a tone curve, sRGB). If writing
 * fails, an existing file is not changed. */
#pragma once

#include "trace_path.h"

/* Writes an EXR with two parts. The part "picture" has channels R, G, B, and the options as
 * attributes. The part "variance" has a channel Y (trace_path.h). */
gboolean trace_write_exr(const TracePicture *picture, const struct trace_options *options,
                         const char *path, GError **error);
/* Writes a PNG that shows radiance as mesorig-view does: times 0.8 · 2^EV, then the tone curve of
 * shaders/tone.glsl. */
gboolean trace_write_png(const TracePicture *picture, double exposure_ev, const char *path,
                         GError **error);
