/*
 * How fast frames are processed. Each figure stands next to its limit, or next to another program
 * in the same run: space-time analysis of laser frames against memcpy and NumPy; rectification
 * against decoding and OpenCV; eight cameras' frames analysed as they come (--live), and stored
 * (--store); `mesorig process` against reading, decoding and rectifying (--processing). Peers are
 * in peers/, and what they need in packages.txt.
 */
#include "bench.h"
#include "speed_parts.h"

static gboolean no_sweep, no_rectify;
static double live_s, store_s;
static char *folder, *session;
static int queue_mib, memory_views, processing_texels;

static const GOptionEntry entries[] = {
    {"no-sweep", 0, 0, G_OPTION_ARG_NONE, &no_sweep, "Leave space-time analysis out", NULL},
    {"no-rectify", 0, 0, G_OPTION_ARG_NONE, &no_rectify, "Leave rectification out", NULL},
    {"live", 0, 0, G_OPTION_ARG_DOUBLE, &live_s, "Analyse eight cameras for so long", "SECONDS"},
    {"store", 0, 0, G_OPTION_ARG_DOUBLE, &store_s, "Store their frames for so long", "SECONDS"},
    {"queue", 0, 0, G_OPTION_ARG_INT, &queue_mib, "Frames that may wait (as in the daemon)", "MIB"},
    {"memory", 0, 0, G_OPTION_ARG_INT, &memory_views,
     "Process so many views of 256² texels and 96 lights, and say what memory it took", "VIEWS"},
    {"processing", 0, 0, G_OPTION_ARG_INT, &processing_texels,
     "Process a session of so many texels across, and compare with the limit", "TEXELS"},
    {"session", 0, 0, G_OPTION_ARG_FILENAME, &session, "Process the frames of this session", "DIR"},
    {"folder", 0, 0, G_OPTION_ARG_FILENAME, &folder, "Where to store", "DIR"},
    {NULL},
};

static double times(double ours, double theirs) {
    return theirs > 0 ? ours / theirs : 0;
}

static void print_sweep(void) {
    const struct speed_sweep s = speed_sweep();
    bench_row("sweep",
              "%.0f{mpx_s} %.0f{memcpy_mpx_s} %.3f{to_memcpy} %.0f{single_mpx_s} "
              "%.3f{single_to_memcpy} %.1f{numpy_maxima_mpx_s} %.1f{to_numpy_maxima} "
              "%.1f{numpy_samples_mpx_s} %.1f{to_numpy_samples} %.0f{peaks_mpx_s} "
              "%.1f{numpy_to_peaks_mpx_s} %.5f{numpy_rms_frames} %.6f{numpy_agree}",
              s.sweep_mpx_s, s.memcpy_mpx_s, s.sweep_mpx_s / s.memcpy_mpx_s, s.single_mpx_s,
              s.single_mpx_s / s.memcpy_mpx_s, s.maxima_mpx_s, times(s.sweep_mpx_s, s.maxima_mpx_s),
              s.samples_mpx_s, times(s.sweep_mpx_s, s.samples_mpx_s), s.peaks_mpx_s,
              s.to_peaks_mpx_s, s.numpy_rms_frames, s.numpy_agree);
}

static void print_rectify(void) {
    const struct speed_rectify r = speed_rectify();
    bench_begin("rectify");
    bench_put("%.2f{decode_ms} %.2f{rectify_ms} %.0f{prepare_ms} %.5f{error} %.2f{opencv_ms} "
              "%.5f{opencv_error}",
              r.decode_ms, r.rectify_ms, r.prepare_ms, r.error, r.opencv_ms, r.opencv_error);
    bench_put_boolean("opencv_reaches", r.opencv_reaches);
    bench_put("%.2f{to_opencv}", r.rectify_ms > 0 ? r.opencv_ms / r.rectify_ms : 0);
    bench_end();
}

static void print_live(const char *name, double seconds, gboolean store) {
    const struct speed_live l =
        speed_live(seconds, store, folder ? folder : g_get_tmp_dir(), queue_mib);
    bench_row(name,
              "%.1f{seconds} %.1f{mb_s} %" G_GINT64_FORMAT "{frames} %" G_GINT64_FORMAT
              "{dropped} %.3f{cores} %.0f{late_ms} %" G_GINT64_FORMAT "{results} %" G_GINT64_FORMAT
              "{failed}",
              l.seconds, l.mb_s, l.frames, l.dropped, l.cores, l.late_ms, l.results, l.failed);
}

static void print_memory(void) {
    const struct speed_memory m = speed_memory(memory_views, folder ? folder : g_get_tmp_dir());
    bench_begin("memory");
    bench_put("%d{texels} %d{views} %d{lights} %.0f{peak_mib} %.1f{seconds}", m.texels, m.views,
              m.lights, m.peak_mib, m.seconds);
    bench_put_boolean("ok", m.ok);
    bench_end();
}

static void print_processing(void) {
    const struct speed_processing p =
        speed_processing(processing_texels, session, folder ? folder : g_get_tmp_dir());
    bench_begin("processing");
    bench_put("%d{texels} %d{views} %d{files} %.0f{megapixels} %.3f{decode_s} %.3f{rectify_s} "
              "%.3f{limit_s} %.3f{process_s} %.2f{to_limit} %.0f{peak_mib}",
              p.texels, p.views, p.files, p.megapixels, p.decode_s, p.rectify_s, p.limit_s,
              p.process_s, times(p.process_s, p.limit_s), p.peak_mib);
    bench_put_boolean("ok", p.ok);
    bench_end();
}

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, entries, NULL);
    bench_begin(NULL);
    if (memory_views > 0) /* first: a child begins with what its parent has */
        print_memory();
    if (processing_texels > 0 || session)
        print_processing();
    if (!no_sweep)
        print_sweep();
    if (!no_rectify)
        print_rectify();
    if (live_s > 0)
        print_live("live", live_s, FALSE);
    if (store_s > 0)
        print_live("store", store_s, TRUE);
    bench_put("%u{processors}", g_get_num_processors());
    bench_end();
    return 0;
}
