/*
 * How fast measurement keeps up, each figure next to its limit or its peer in the same run:
 * space-time analysis of laser frames against memcpy and NumPy; rectification against decoding and
 * OpenCV; eight cameras' frames analysed as they come (--live), and stored (--store). Peers are in
 * peers/, and what they need in packages.txt.
 */
#include "bench.h"
#include "speed_parts.h"

#include <stdio.h>

static gboolean json, no_sweep, no_rectify;
static double live_s, store_s;
static char *folder;
static int queue_mib, memory_views;

static const GOptionEntry entries[] = {
    {"json", 0, 0, G_OPTION_ARG_NONE, &json, "One JSON object", NULL},
    {"no-sweep", 0, 0, G_OPTION_ARG_NONE, &no_sweep, "Leave space-time analysis out", NULL},
    {"no-rectify", 0, 0, G_OPTION_ARG_NONE, &no_rectify, "Leave rectification out", NULL},
    {"live", 0, 0, G_OPTION_ARG_DOUBLE, &live_s, "Analyse eight cameras for so long", "SECONDS"},
    {"store", 0, 0, G_OPTION_ARG_DOUBLE, &store_s, "Store their frames for so long", "SECONDS"},
    {"queue", 0, 0, G_OPTION_ARG_INT, &queue_mib, "Frames that may wait (as in the daemon)", "MIB"},
    {"memory", 0, 0, G_OPTION_ARG_INT, &memory_views,
     "Process so many views of 256² texels and 96 lights, and say what memory it took", "VIEWS"},
    {"folder", 0, 0, G_OPTION_ARG_FILENAME, &folder, "Where to store", "DIR"},
    {NULL},
};

static double times(double ours, double theirs) {
    return theirs > 0 ? ours / theirs : 0;
}

static void print_sweep(void) {
    const struct speed_sweep s = speed_sweep();
    printf(json ? "\"sweep\": {\"mpx_s\": %.0f, \"memcpy_mpx_s\": %.0f, \"to_memcpy\": %.3f, "
                  "\"single_mpx_s\": %.0f, \"single_to_memcpy\": %.3f, "
                : "space-time analysis: %.0f Mpx/s, eight frames at a time; memcpy %.0f, ratio "
                  "%.2f; %.0f frame by frame, ratio %.2f\n",
           s.sweep_mpx_s, s.memcpy_mpx_s, s.sweep_mpx_s / s.memcpy_mpx_s, s.single_mpx_s,
           s.single_mpx_s / s.memcpy_mpx_s);
    printf(json
               ? "\"numpy_maxima_mpx_s\": %.1f, \"to_numpy_maxima\": %.1f, "
                 "\"numpy_samples_mpx_s\": %.1f, \"to_numpy_samples\": %.1f, "
               : "NumPy: %.1f Mpx/s where it keeps maxima, %.1f times as fast; %.1f where it keeps "
                 "all that we keep, %.1f times\n",
           s.maxima_mpx_s, times(s.sweep_mpx_s, s.maxima_mpx_s), s.samples_mpx_s,
           times(s.sweep_mpx_s, s.samples_mpx_s));
    printf(json ? "\"peaks_mpx_s\": %.0f, \"numpy_to_peaks_mpx_s\": %.1f, "
                  "\"numpy_rms_frames\": %.5f, \"numpy_agree\": %.6f}, "
                : "with times found: %.0f Mpx/s, all samples fitted; NumPy %.1f, three samples, "
                  "its peaks %.5f frames (RMS) from ours, %.6f of the pixels alike\n",
           s.peaks_mpx_s, s.to_peaks_mpx_s, s.numpy_rms_frames, s.numpy_agree);
}

static void print_rectify(void) {
    const struct speed_rectify r = speed_rectify();
    printf(
        json ? "\"rectify\": {\"decode_ms\": %.2f, \"rectify_ms\": %.2f, \"prepare_ms\": %.0f, "
               "\"error\": %.5f, \"opencv_ms\": %.2f, \"opencv_error\": %.5f, "
               "\"opencv_reaches\": %s, \"to_opencv\": %.2f}, "
             : "rectification: decoding %.2f ms a frame, rectifying %.2f; a view prepared in %.0f "
               "ms; error %.5f\nOpenCV: %.2f ms, error %.5f, as good: %s; we are %.2f times as "
               "fast\n",
        r.decode_ms, r.rectify_ms, r.prepare_ms, r.error, r.opencv_ms, r.opencv_error,
        r.opencv_reaches ? (json ? "true" : "yes") : (json ? "false" : "no, its best"),
        r.rectify_ms > 0 ? r.opencv_ms / r.rectify_ms : 0);
}

static void print_live(const char *name, double seconds, gboolean store) {
    const struct speed_live l =
        speed_live(seconds, store, folder ? folder : g_get_tmp_dir(), queue_mib);
    printf(json ? "\"%s\": {\"seconds\": %.1f, \"mb_s\": %.1f, \"frames\": %" G_GINT64_FORMAT
                  ", \"dropped\": %" G_GINT64_FORMAT ", \"cores\": %.3f, \"late_ms\": %.0f, "
                  "\"results\": %" G_GINT64_FORMAT ", \"failed\": %" G_GINT64_FORMAT "}, "
                : "%s: %.1f s at %.1f MB/s, %" G_GINT64_FORMAT " frames, %" G_GINT64_FORMAT
                  " dropped, %.2f cores, at most %.0f ms late; %" G_GINT64_FORMAT
                  " sweeps written, %" G_GINT64_FORMAT " failed\n",
           name, l.seconds, l.mb_s, l.frames, l.dropped, l.cores, l.late_ms, l.results, l.failed);
}

static void print_memory(void) {
    const struct speed_memory m = speed_memory(memory_views, folder ? folder : g_get_tmp_dir());
    printf(json ? "\"memory\": {\"texels\": %d, \"views\": %d, \"lights\": %d, \"peak_mib\": %.0f, "
                  "\"seconds\": %.1f, \"ok\": %s}, "
                : "processing %d² texels, %d views, %d lights: at most %.0f MiB, %.1f s%s\n",
           m.texels, m.views, m.lights, m.peak_mib, m.seconds,
           m.ok ? (json ? "true" : "") : (json ? "false" : ", failed"));
}

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, entries, NULL);
    printf(json ? "{" : "");
    if (memory_views > 0) /* first: a child begins with what its parent has */
        print_memory();
    if (!no_sweep)
        print_sweep();
    if (!no_rectify)
        print_rectify();
    if (live_s > 0)
        print_live("live", live_s, FALSE);
    if (store_s > 0)
        print_live("store", store_s, TRUE);
    printf(json ? "\"processors\": %u}\n" : "%u processors\n", g_get_num_processors());
    return 0;
}
