/*
 * A laser sweep seen by one camera. The sweep is analysed while the frames arrive (space-time
 * analysis, Wang et al. 2005 §3.2). The result is the time of the peak of every pixel, to a
 * fraction of a frame.
 *
 * A line lights each pixel in a few frames only. The samples of these frames are kept, together
 * with the samples just before and after them. Of all other samples of a pixel, only the minimum is
 * kept. The minimum is the pixel's background.
 *
 * A sample belongs to a line if it exceeds the background by the noise margin. The noise is
 * measured in the first two frames. The margin is at least 4 DN, and grows if too many samples
 * exceed it. If one of the first five frames shows that the whole picture of an earlier frame was
 * lit differently, the sweep starts again with the later frame. All frames before the later frame
 * are then left out.
 *
 * Add the frames in order, each once. One thread at a time.
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

/* Sets a second sweep over the same steps with a shorter exposure. The exposure of `sweep` is ratio
 * times that of `shorter`. Both sweeps are used for pulses that saturate `sweep`. `shorter` is
 * borrowed. Call this function before sweep_finish(), and add frames to both sweeps. */
void sweep_set_shorter(Sweep *sweep, const Sweep *shorter, double ratio);

/* Arrays of width × height each. Time and width are those of the Gaussian that best fits the
 * samples of the pulse, weighted by their noise. */
struct sweep_pulses {
    /* Time in frames. 0 is the middle of the first frame. −1 means that there is no peak. There is
     * none if the maximum is below threshold, or if the maximum is in the first frame of the
     * backgrounds or in the last frame. */
    float *peak;
    float *width; /* standard deviation of the pulse in frames; may be NULL */
    /* Maximum above the background, in DN, at most saturation minus background. With two exposures,
     * it is in DN of the longer one. */
    float *intensity;
};

/* Writes each pixel's brightest pulse to ret_first, and its second brightest pulse to ret_second
 * (light that the surroundings reflected, or a surface behind an edge). Either result may be NULL.
 * If a pixel has no second pulse, its intensity in ret_second is 0. threshold is in DN. Frames may
 * be added afterwards. */
void sweep_finish(const Sweep *sweep, double threshold, const struct sweep_pulses *ret_first,
                  const struct sweep_pulses *ret_second);

gsize sweep_bytes(const Sweep *sweep); /* returns the memory in use */
