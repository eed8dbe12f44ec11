/*
 * What capturing costs: the demo's rig with one turntable angle, in virtual time, once for its
 * lamps and once for one ring of lasers. CPU time is told apart by thread: the main loop's, the
 * intake lanes', and the simulator's, which a real rig does not have. Bytes reach the disk at a
 * ratio to plain write() and fsync() of as many in the same folder.
 * usage: bench_capture [--json] [FOLDER]
 */
#include "bench.h"
#include "capture/capture.h"

#include <glib/gstdio.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#define DEMO SOURCE_DIR "/etc/demo/"

static const char session_format[] = "[session]\nname = bench\n"
                                     "[sample]\nwidth_mm = 50\nheight_mm = 50\ntexels = 64\n"
                                     "reference_mm = 5\ndepth_mm = 5\n"
                                     "[views]\nrings = 15:1; 30:1; 45:1; 60:1; 75:1\n"
                                     "[%s]\n%s\noffset_deg = 15\n"
                                     "[capture]\nexposures_us = 4000; 16000\n"
                                     "laser_exposure_us = 4000\nsweep_steps = 96\n"
                                     "sweep_margin_mm = 2\ndark_frames = 4\nretries = 3\n"
                                     "laser_threshold_dn = 40\n";

struct cpu { /* s */
    double main_loop, lanes, simulator, other;
};

struct result {
    struct cpu cpu;
    double real_s;
    gint64 frames;
    int cameras;
    double bytes, plain_s;
};

static char *read_task(const char *task, const char *name) {
    char *text = NULL;
    g_autofree char *path = g_build_filename("/proc/self/task", task, name, NULL);
    return g_file_get_contents(path, &text, NULL, NULL) ? g_strchomp(text) : g_strdup("");
}

/* Of the threads there are now; all that matter live as long as the capture does. */
static struct cpu cpu_now(void) {
    struct cpu cpu = {0};
    g_autofree char *own = g_strdup_printf("%d", (int)getpid());
    g_autoptr(GDir) tasks = g_dir_open("/proc/self/task", 0, NULL);
    const char *task;
    while (tasks && (task = g_dir_read_name(tasks))) {
        g_autofree char *name = read_task(task, "comm"), *times = read_task(task, "schedstat");
        double s = g_ascii_strtod(times, NULL) * 1e-9;
        if (g_str_equal(task, own))
            cpu.main_loop += s;
        else if (g_str_has_prefix(name, "cam"))
            cpu.lanes += s;
        else if (g_str_has_prefix(name, "pool"))
            cpu.simulator += s;
        else
            cpu.other += s;
    }
    return cpu;
}

/* Writes every file of a folder once more, plainly, and takes them all away. */
static void write_again(const char *folder, const char *beside, struct result *to) {
    g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *path = g_build_filename(folder, name, NULL), *bytes = NULL;
        gsize n;
        if (g_file_test(path, G_FILE_TEST_IS_DIR)) {
            write_again(path, beside, to);
        } else if (g_file_get_contents(path, &bytes, &n, NULL)) {
            double start = bench_now_s();
            FILE *file = fopen(beside, "wb");
            if (!file || fwrite(bytes, 1, n, file) != n || fflush(file) || fsync(fileno(file)))
                perror(beside);
            if (file)
                fclose(file);
            g_remove(beside);
            to->plain_s += bench_now_s() - start;
            to->bytes += (double)n;
            g_remove(path);
        }
    }
    g_rmdir(folder);
}

static void on_event(Capture *capture, const char *level, const char *source, const char *message,
                     gpointer data) {
    if (!g_str_equal(level, "info"))
        fprintf(stderr, "bench_capture: %s: %s\n", source, message);
}

static void bench(struct devices *devices, const char *folder, const char *kind, const char *rings,
                  struct result *ret) {
    struct session_conf conf = {0};
    g_autoptr(GError) error = NULL;
    g_autofree char *text = g_strdup_printf(session_format, kind, rings);
    g_autofree char *session = g_strdup_printf("%s/%s.session", folder, kind);
    g_autofree char *beside = g_build_filename(folder, "plain", NULL);
    session_conf_parse(&conf, text, kind, &error);
    bench_check(error);
    struct capture_callbacks callbacks = {.event = on_event};
    struct capture_status status;
    g_autoptr(GError) failure = NULL;
    double start = bench_now_s();
    Capture *capture = capture_start(devices, &conf, session, &callbacks, &failure);
    bench_check(failure);
    struct cpu before = cpu_now();
    do {
        g_main_context_iteration(NULL, TRUE);
        capture_get_status(capture, &status);
    } while (status.state < CAPTURE_PAUSED);
    struct cpu after = cpu_now();
    *ret = (struct result){.cpu = {after.main_loop - before.main_loop, after.lanes - before.lanes,
                                   after.simulator - before.simulator, after.other - before.other},
                           .real_s = bench_now_s() - start,
                           .frames = status.frames,
                           .cameras = devices->geometry.n_cameras};
    if (status.state != CAPTURE_DONE)
        bench_fail(1, "not all was captured: %s", status.reason);
    capture_free(capture);
    write_again(session, beside, ret);
    session_conf_clear(&conf);
}

/* A step is one picture of every camera. */
static void print_result(const char *kind, const struct result *r, gboolean json) {
    double steps = (double)r->frames / r->cameras, us = 1e6 / steps;
    double mb_s = r->bytes * 1e-6 / r->real_s, plain_mb_s = r->bytes * 1e-6 / r->plain_s;
    printf(json ? "\"%s\": {\"main_us\": %.1f, \"lanes_us\": %.1f, \"simulator_us\": %.1f, "
                  "\"other_us\": %.1f, \"frames_s\": %.0f, \"mb_s\": %.1f, \"plain_mb_s\": %.1f, "
                  "\"write_ratio\": %.3f}, "
                : "%s, CPU a step: main loop %.1f µs, lanes %.1f µs, simulator %.1f µs, other "
                  "%.1f µs; %.0f frames/s; %.1f MB/s, plain %.1f MB/s, ratio %.3f\n",
           kind, r->cpu.main_loop * us, r->cpu.lanes * us, r->cpu.simulator * us, r->cpu.other * us,
           (double)r->frames / r->real_s, mb_s, plain_mb_s, mb_s / plain_mb_s);
}

int main(int argc, char **argv) {
    gboolean json = FALSE;
    const GOptionEntry entries[] = {
        {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Print one JSON object", NULL}, {NULL}};
    bench_parse(&argc, &argv, entries, "[FOLDER]");
    const char *in = argc > 1 ? argv[1] : g_get_tmp_dir();
    g_autofree char *folder = g_build_filename(in, "bench_capture.XXXXXX", NULL);
    g_autoptr(GError) error = NULL;
    struct result lamps, lasers;
    if (!g_mkdtemp(folder))
        bench_fail(1, "%s: %s", folder, g_strerror(errno));
    struct devices *devices = devices_open(DEMO "rig.conf", &error);
    bench_check(error);
    bench(devices, folder, "lights", "preset = 12x5", &lamps);
    bench(devices, folder, "lasers", "rings = 15:2; 45:6", &lasers);
    devices_close(devices);
    g_rmdir(folder);
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    printf("%s", json ? "{" : "");
    print_result("lamps", &lamps, json);
    print_result("lasers", &lasers, json);
    printf(json ? "\"peak_mb\": %.0f}\n" : "peak memory %.0f MB\n", (double)usage.ru_maxrss / 1024);
    return 0;
}
