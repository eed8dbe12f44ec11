/* The parts of bench_speed, a file each. */
#pragma once

#include <glib.h>

/* The time to process laser frames, compared with the time to copy them, and with NumPy. */
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

/* What rectifying costs next to decoding, and next to OpenCV at the same error. */
struct speed_rectify {
    double decode_ms, rectify_ms; /* a frame, one core */
    double prepare_ms;            /* a view */
    double error;                 /* RMS, relative, of texels against their exact means */
    double opencv_ms;             /* 0: there is none */
    double opencv_error;          /* of its fastest way that reaches ours, else of its best */
    gboolean opencv_reaches;
};
struct speed_rectify speed_rectify(void);

/* Eight cameras' laser frames as they come, in real time, analysed or stored. */
struct speed_live {
    double seconds;
    gint64 frames, dropped; /* of all cameras */
    double mb_s;            /* of raw pixels, 8 bits */
    double cores;           /* processor time over time, the pictures' unpacking included */
    double late_ms;         /* the latest a frame was taken up */
    gint64 results, failed; /* sweeps written */
};

/* store: every frame is kept on disk as well, below folder, and removed afterwards. queue_mib: of
 * frames that may wait for a worker; 0: as in the daemon. */
struct speed_live speed_live(double seconds, gboolean store, const char *folder, int queue_mib);

/* The memory that processing a large session takes. */
struct speed_memory {
    double peak_mib; /* of the process that ran it, as the kernel says */
    double seconds;
    int texels, views, lights; /* texels across */
    gboolean ok;
};

/* views × 96 lights of 256 × 256 texels at 2 pixels a texel, BTF and eigen-maps, in folder. What is
 * held at a time is some views and columns, however many there are; an MDF would hold 12 bytes a
 * texel and view more. */
struct speed_memory speed_memory(int views, const char *folder);

/* The CPU time of `mesorig process`, and the limit of it: the time to read, decode and rectify each
 * file of the session once. */
struct speed_processing {
    int texels, views, files; /* texels across; files of pictures and sweeps */
    double megapixels;        /* of all files */
    double decode_s, rectify_s, limit_s, process_s, peak_mib;
    gboolean ok;
};
/* session: a session whose frames are processed once more, in a copy with hard links below folder.
 * NULL: a session of texels × texels is made there, with two views of 24 lights and 10 sweeps. */
struct speed_processing speed_processing(int texels, const char *session, const char *folder);
