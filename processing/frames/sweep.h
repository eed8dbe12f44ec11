/*
 * A laser sweep seen by one camera, analysed as the frames come (space-time analysis, Wang et al.
 * 2005 §3.2): for every pixel the time at which it was brightest, to a fraction of a frame, without
 * the frames being kept.
 *
 * A line lights each pixel in a few frames only: those samples are kept and all others forgotten,
 * but for each pixel's darkest value, its background. What is above background by less than noise
 * is no line, and counts only just before and after one, where it was kept; the noise is measured
 * in the first two frames (at least 4 DN are taken for it). If one of them was lit differently as a
 * whole, as the next pairs show, the frames up to there are left out. Feed frames in order; a frame
 * may be fed once only. One thread at a time.
 */
#pragma once

#include <glib.h>

typedef struct Sweep Sweep;

/* At most 32767 frames. */
Sweep *sweep_new(int width, int height, int n_frames, int saturation);
void sweep_free(Sweep *sweep); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Sweep, sweep_free)

/* The next frame, width × height values. */
void sweep_add(Sweep *sweep, const guint16 *pixels);

/* The next n frames, in order. As if they were added one by one, but faster: four at a
 * time go past each pixel's background. */
void sweep_add_some(Sweep *sweep, const guint16 *const *frames, int n);
int sweep_count(const Sweep *sweep);

/* The same steps at a shorter exposure, of which sweep's is ratio times as long: both together tell
 * of pulses that are too bright for the longer one. Borrowed. Before the following; frames of both
 * are added as they come. */
void sweep_set_shorter(Sweep *sweep, const Sweep *shorter, double ratio);

/* What is left, each width × height, written to the caller's arrays:
 *   peak       time of the peak in frames (0 is the first frame's middle), −1 where there is none:
 *              peak − background below threshold, or at the very first (that is not left out) or
 * last frame width      standard deviation of the pulse in frames intensity  brightest value above
 * background, of the longer exposure where there are two background is each pixel's own darkest
 * value, threshold in the same units (DN). Time and width are those of the Gaussian that fits all
 * samples of the pulse best, by their noise. */
void sweep_finish(const Sweep *sweep, double threshold, float *ret_peak, float *ret_width,
                  float *ret_intensity);

struct sweep_pulses {
    float *peak, *width, *intensity; /* as above; width may be NULL */
};

/* The same, and that of each pixel's second brightest pulse: light thrown back by what stands
 * around, or a surface behind an edge; intensity is 0 where there is none. Either may be NULL. Both
 * together take little longer than one. */
void sweep_finish_both(const Sweep *sweep, double threshold, const struct sweep_pulses *ret_first,
                       const struct sweep_pulses *ret_second);

gsize sweep_bytes(const Sweep *sweep); /* it occupies */
