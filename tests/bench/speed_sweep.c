#include "speed_parts.h"

#include "frames/sweep.h"

#include <glib/gstdio.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define WIDTH     1024
#define HEIGHT    768
#define PIXELS    ((gsize)WIDTH * HEIGHT)
#define FRAMES    96 /* over 50 mm, of which a line is as wide as the demo's: */
#define REPEATS   5
#define TOGETHER  8 /* frames, as the intake hands them over */
#define THRESHOLD 200.0
#define SIGMA     0.7 /* frames */

gint64 speed_now_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return now.tv_sec * G_USEC_PER_SEC + now.tv_nsec / 1000;
}

static double since_s(gint64 begun_us) {
    return (double)(speed_now_us() - begun_us) / G_USEC_PER_SEC;
}

char *speed_peer(const char *script, const char *const *arguments) {
    g_autoptr(GPtrArray) argv = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GError) error = NULL;
    char *out = NULL;
    int status = 0;
    g_ptr_array_add(argv, g_strdup("/usr/bin/python3"));
    g_ptr_array_add(argv, g_strconcat(SOURCE_DIR "/tests/bench/peers/", script, NULL));
    for (; *arguments; arguments++)
        g_ptr_array_add(argv, g_strdup(*arguments));
    g_ptr_array_add(argv, NULL);
    if (!g_spawn_sync(NULL, (char **)argv->pdata, NULL, G_SPAWN_DEFAULT, NULL, NULL, &out, NULL,
                      &status, &error) ||
        !g_spawn_check_wait_status(status, &error)) {
        fprintf(stderr, "bench_speed: %s: %s; it needs the packages in tests/bench/packages.txt\n",
                script, error->message);
        g_clear_pointer(&out, g_free);
    }
    return out;
}

double speed_number(const char *json, const char *name) {
    g_autofree char *key = g_strdup_printf("\"%s\": ", name);
    const char *at = json ? strstr(json, key) : NULL;
    return at ? g_ascii_strtod(at + strlen(key), NULL) : 0;
}

static double time_copy(const guint16 *frames, guint16 *to) {
    const gint64 begun_us = speed_now_us();
    for (gsize t = 0; t < FRAMES; t++) {
        memcpy(to, frames + t * PIXELS, sizeof *to * PIXELS);
        __asm__ volatile("" : : "r"(to) : "memory");
    }
    return since_s(begun_us);
}

static Sweep *time_sweep(const guint16 *frames, int together, double *ret_least_s) {
    Sweep *sweep = sweep_new(WIDTH, HEIGHT, FRAMES, 4095);
    const guint16 *some[TOGETHER];
    const gint64 begun_us = speed_now_us();
    for (gsize t = 0; t < FRAMES; t += (gsize)together) {
        for (gsize k = 0; k < (gsize)together; k++)
            some[k] = frames + (t + k) * PIXELS;
        sweep_add_some(sweep, some, together);
    }
    *ret_least_s = MIN(*ret_least_s, since_s(begun_us));
    return sweep;
}

/* Millions of pixels a second; 0: not known. */
static double rate(double seconds) {
    return seconds > 0 ? 1e-6 * (double)(PIXELS * FRAMES) / seconds : 0;
}

static void run_numpy(const guint16 *frames, const float *peak, struct speed_sweep *ret) {
    g_autofree char *folder = g_dir_make_tmp("bench-speed-XXXXXX", NULL);
    g_autofree char *in = g_build_filename(folder, "frames", NULL);
    g_autofree char *peaks = g_build_filename(folder, "peaks", NULL), *theirs = NULL, *out = NULL;
    const char *const arguments[] = {in, "1024", "768", "200", peaks, NULL};
    gsize length = 0;
    FILE *file = fopen(in, "wb");
    if (file && fwrite(frames, sizeof *frames, FRAMES * PIXELS, file) == FRAMES * PIXELS &&
        fclose(file) == 0)
        out = speed_peer("sweep_numpy.py", arguments);
    ret->maxima_mpx_s = rate(speed_number(out, "maxima"));
    ret->samples_mpx_s = rate(speed_number(out, "samples"));
    ret->to_peaks_mpx_s = rate(speed_number(out, "to_peaks"));
    if (out && g_file_get_contents(peaks, &theirs, &length, NULL) &&
        length == PIXELS * sizeof(float)) {
        const float *numpy = (const float *)(gconstpointer)theirs;
        double squares = 0;
        gsize both = 0, agree = 0;
        for (gsize i = 0; i < PIXELS; i++) {
            agree += (peak[i] >= 0) == (numpy[i] >= 0);
            if (peak[i] < 0 || numpy[i] < 0)
                continue;
            squares += pow((double)peak[i] - (double)numpy[i], 2);
            both++;
        }
        ret->numpy_rms_frames = both ? sqrt(squares / (double)both) : -1;
        ret->numpy_agree = (double)agree / (double)PIXELS;
    }
    g_unlink(in);
    g_unlink(peaks);
    g_rmdir(folder);
}

struct speed_sweep speed_sweep(void) {
    g_autofree guint16 *frames = g_new(guint16, FRAMES * PIXELS), *to = g_new0(guint16, PIXELS);
    g_autofree float *peak = g_new(float, PIXELS), *width = g_new(float, PIXELS);
    g_autofree float *intensity = g_new(float, PIXELS);
    GRand *rand = g_rand_new_with_seed(1);
    for (int t = 0; t < FRAMES; t++) {
        /* A line that goes across the picture once, of another brightness in every pixel, with
         * noise. */
        guint16 *pixels = frames + (gsize)t * PIXELS;
        for (gsize k = 0; k < PIXELS; k++) {
            const double at = (double)(k % WIDTH) / WIDTH * FRAMES - t;
            const double dn = fabs(at) < 6 ? (500 + (double)(k * 7919 % 3000)) *
                                                 exp(-at * at / (2 * SIGMA * SIGMA))
                                           : 0;
            pixels[k] = (guint16)(64 + g_rand_int_range(rand, 0, 16) + lround(dn));
        }
    }
    g_rand_free(rand);
    double copy = G_MAXDOUBLE, some = G_MAXDOUBLE, single = G_MAXDOUBLE, finish = G_MAXDOUBLE;
    for (int i = 0; i < REPEATS; i++) {
        copy = MIN(copy, time_copy(frames, to));
        sweep_free(time_sweep(frames, 1, &single));
        g_autoptr(Sweep) sweep = time_sweep(frames, TOGETHER, &some);
        const gint64 begun_us = speed_now_us();
        sweep_finish(sweep, THRESHOLD, &(struct sweep_pulses){peak, width, intensity}, NULL);
        finish = MIN(finish, since_s(begun_us));
    }
    struct speed_sweep ret = {.sweep_mpx_s = rate(some),
                              .single_mpx_s = rate(single),
                              .memcpy_mpx_s = rate(copy),
                              .peaks_mpx_s = rate(some + finish)};
    run_numpy(frames, peak, &ret);
    return ret;
}
