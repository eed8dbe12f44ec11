/* Pictures as files: EXR (radiance) and PNG (exposed, toned, sRGB). A file is whole or, as after an
 * error, what it was before. */
#pragma once

#include "trace_path.h"

/* Parts: "picture" with channels R, G, B and attributes of the options; "variance" with Y
 * (trace_path.h). */
gboolean trace_write_exr(const TracePicture *picture, const struct trace_options *options,
                         const char *path, GError **error);
/* As mesorig-view shows radiance: times 0.8 · 2^EV, then the tone curve of shaders/resolve.frag. */
gboolean trace_write_png(const TracePicture *picture, double exposure_ev, const char *path,
                         GError **error);
