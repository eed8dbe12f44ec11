/*
 * A laser sweep seen by one camera, analysed while the frames arrive (space-time analysis, Wang et
 * al. 2005 §3.2): for every pixel the time of its peak to a fraction of a frame.
 *
 * A line lights each pixel in a few frames only: those samples are kept, with those just before and
 * after, and of all others only each pixel's minimum, its background. A sample belongs to a line if
 * it exceeds the background by the noise margin. The noise is measured in the first two frames; the
 * margin is at least 4 DN. If one of those was lit differently as a whole, as the next pairs show,
 * the frames up to it are left out. Feed frames in order, each once. One thread at a time.
 */
#pragma once

#include <glib.h>

typedef struct Sweep Sweep;

/* At most 32767 frames. */
Sweep *sweep_new(int width, int height, int n_frames, int saturation);
void sweep_free(Sweep *sweep); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Sweep, sweep_free)

/* Adds the next frame, width × height values. */
void sweep_add(Sweep *sweep, const guint16 *pixels);

/* Adds the next n frames in order; the result is that of adding them one by one, but faster. */
void sweep_add_some(Sweep *sweep, const guint16 *const *frames, int n);

/* Borrows a second sweep over the same steps; sweep's exposure is ratio times as long. Pulses that
 * saturate sweep are then measured by both. Call it before sweep_finish(); add frames to both. */
void sweep_set_shorter(Sweep *sweep, const Sweep *shorter, double ratio);

/* Arrays of width × height each. Time and width are those of the Gaussian that fits the samples of
 * the pulse best, weighted by their noise. */
struct sweep_pulses {
    /* time in frames (0 is the middle of the first); −1: none, since the maximum is below
     * threshold, or in the first (that is not left out) or last frame */
    float *peak;
    float *width;     /* standard deviation of the pulse in frames; may be NULL */
    float *intensity; /* maximum above background in DN, of the longer exposure of two */
};

/* Writes each pixel's brightest pulse, and its second brightest (light reflected by the
 * surroundings, or a surface behind an edge), whose intensity is 0 where there is none. Either may
 * be NULL. threshold is in DN. Frames may be added afterwards. */
void sweep_finish(const Sweep *sweep, double threshold, const struct sweep_pulses *ret_first,
                  const struct sweep_pulses *ret_second);

gsize sweep_bytes(const Sweep *sweep); /* memory in use */
