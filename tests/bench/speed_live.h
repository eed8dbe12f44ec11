/* Eight cameras' laser frames as they come, in real time, analysed or stored: part of bench_speed.
 */
#pragma once

#include <glib.h>

struct speed_live {
    double seconds;
    gint64 frames, dropped; /* of all cameras */
    double mb_s;            /* of raw pixels, 8 bits */
    double cores;           /* processor time over time, the pictures' unpacking included */
    double late_ms;         /* the latest a frame was taken up */
    gint64 results, failed; /* sweeps written */
};

/* store: every frame is kept on disk, too, below folder, and removed afterwards. queue_mib: of
 * frames that may wait for a worker; 0: as in the daemon. */
struct speed_live speed_live(double seconds, gboolean store, const char *folder, int queue_mib);
