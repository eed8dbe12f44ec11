/*
 * Path tracing (Kajiya 1986): the light that a camera sees, with any number of reflections. At each
 * point, the sky, one area and every point-like lamp are sampled, and a further direction is drawn
 * from the surface. Light of the sky and of areas is found in both ways. The power heuristic
 * weights the two ways (Veach & Guibas 1995). Paths end at random where little light is left, which
 * does not change the expected value of a pixel.
 *
 * The same scene and options give the same picture with any number of threads.
 */
#pragma once

#include "trace_scene.h"

#define TRACE_MAX_SIDE    16384
#define TRACE_MAX_PIXELS  (64 << 20)
#define TRACE_MAX_SAMPLES (1 << 20)
#define TRACE_MAX_DEPTH   1000

struct trace_options {
    int width, height;
    int samples; /* samples per pixel */
    int depth;   /* largest number of reflections */
    guint64 seed;
    enum trace_drawing drawing;
    /* If FALSE, light is found only by following reflections. This is for comparisons. Point-like
     * lamps then give no light. */
    gboolean lamps_too;
};

extern const struct trace_options trace_options_default;
/* Checks options. The error names the option, its value and the range. */
gboolean trace_options_check(const struct trace_options *options, GError **error);

typedef struct trace_picture {
    int width, height;
    float *rgb; /* height × width × 3, radiance, top row first */
    /* height × width: variance of the luminance of a single sample, estimated from all samples of
     * the pixel. To get the variance of the pixel, divide by the number of samples. With one
     * sample, the value is 0. */
    float *variance;
} TracePicture;
void trace_picture_free(TracePicture *picture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TracePicture, trace_picture_free)

/* Renders a picture. Reports its progress as the stage "trace" of `work`, and can be cancelled by
 * `work`. Returns NULL with an error on failure. Free the picture with trace_picture_free(). */
TracePicture *trace_render(const TraceScene *scene, const struct trace_options *options,
                           const struct work *work, GError **error);
