/*
 * A laser sweep seen by one camera. The sweep is analysed while the frames arrive (space-time
 * analysis, Wang et al. 2005 §3.2). The result is the time of the peak of every pixel, to a
 * fraction of a frame.
 *
 * A line lights each pixel in a few frames only. Those samples are kept, together with the samples
 * just before and after them. Otherwise only the minimum of each pixel's samples is kept, as its
 * background. A sample belongs to a line if it exceeds the background by the noise margin. The
 * noise is measured in the first two frames; the margin is at least 4 DN, and grows if too many
 * samples exceed it. If one of the first five frames shows that the whole picture of an earlier
 * frame was lit differently, the sweep starts again with this later frame, and all frames before it
 * are left out. Feed the frames in order, each once. One thread at a time.
 */
#pragma once

#include <glib.h>

typedef struct Sweep Sweep;

/* Creates a sweep of n_frames frames, at most 32767. Values from saturation (in DN) on are
 * saturated. */
Sweep *sweep_new(int width, int height, int n_frames, int saturation);
void sweep_free(Sweep *sweep); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Sweep, sweep_free)

/* Adds the next frame, width × height values. */
void sweep_add(Sweep *sweep, const guint16 *pixels);

/* Adds the next n frames in order. The result is the same as that of n calls of sweep_add(), which
 * are slower. */
void sweep_add_some(Sweep *sweep, const guint16 *const *frames, int n);

/* Sets a second sweep over the same steps with a shorter exposure; the exposure of the first sweep
 * is ratio times as long. Both sweeps are used for pulses that saturate the first one. The second
 * sweep is borrowed. Call this function before sweep_finish(), and add frames to both sweeps. */
void sweep_set_shorter(Sweep *sweep, const Sweep *shorter, double ratio);

/* Arrays of width × height each. Time and width are those of the Gaussian that best fits the
 * samples of the pulse, weighted by their noise. */
struct sweep_pulses {
    /* time in frames (0 is the middle of the first frame); −1 if there is no peak, because the
     * maximum is below threshold, or is in the first frame that is not left out, or in the last
     * frame */
    float *peak;
    float *width; /* standard deviation of the pulse in frames; may be NULL */
    /* maximum above background, in DN of the longer of two exposures, at most its saturation */
    float *intensity;
};

/* Writes each pixel's brightest pulse to ret_first, and its second brightest pulse to ret_second
 * (light that the surroundings reflected, or a surface behind an edge). Either result may be NULL.
 * If a pixel has no second pulse, its intensity in ret_second is 0. threshold is in DN. Frames may
 * be added afterwards. */
void sweep_finish(const Sweep *sweep, double threshold, const struct sweep_pulses *ret_first,
                  const struct sweep_pulses *ret_second);

gsize sweep_bytes(const Sweep *sweep); /* returns the memory in use */
