/*
 * Path tracing (Kajiya 1986): the light that a camera sees, with any number of reflections. At each
 * point the sky, one area and every point-like lamp are looked for, and a direction is drawn from
 * the surface; the two ways to find sky and areas are weighted by the power heuristic (Veach &
 * Guibas 1995). Paths end at random where little light is left, which changes no mean.
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
    int samples; /* of a pixel */
    int depth;   /* reflections, at most */
    guint64 seed;
    enum trace_drawing drawing;
    gboolean lamps_too; /* FALSE: light is found by following the surfaces alone; then lamps that
                           are points are not seen. To compare with */
};

extern const struct trace_options trace_options_default;
/* The error names the option, its value and the range. */
gboolean trace_options_check(const struct trace_options *options, GError **error);

typedef struct trace_picture {
    int width, height;
    float *rgb;      /* height × width × 3, radiance, top row first */
    float *variance; /* height × width: of a sample's luminance, estimated from all of the pixel's;
                        that of the pixel is it / samples. 0 with 1 sample */
} TracePicture;
void trace_picture_free(TracePicture *picture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TracePicture, trace_picture_free)

/* Reports the stage "trace" and can be cancelled. */
TracePicture *trace_render(const TraceScene *scene, const struct trace_options *options,
                           const struct work *work, GError **error);
