/* What absorbing laser frames costs beside copying them, and beside NumPy: part of bench_speed. */
#pragma once

#include <glib.h>

struct speed_sweep {
    double single_mpx_s;              /* frame by frame */
    double sweep_mpx_s, memcpy_mpx_s; /* one core */
    double peaks_mpx_s;               /* with the pulses' times found: sweep_finish () */
    double maxima_mpx_s, samples_mpx_s, to_peaks_mpx_s; /* NumPy's, of its script; 0: none */
    double numpy_rms_frames;                            /* between its peaks and ours */
    double numpy_agree; /* of the pixels: both or neither see a peak */
};
struct speed_sweep speed_sweep(void);

/* Of the calling thread on its processor, so that what else the machine does counts little. */
gint64 speed_now_us(void);

/* Runs a peer and gives what it printed; NULL: it failed, which is told. g_free() */
char *speed_peer(const char *script, const char *const *arguments);

/* A number of an object of JSON; 0: not there. */
double speed_number(const char *json, const char *name);
