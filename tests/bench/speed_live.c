/* A clock and 8-bit pictures replace the cameras, so that the network is not measured. A frame that
 * is due while the intake is full, or for longer than a camera's buffers hold it, is dropped. */
#include "speed_parts.h"

#include "bench.h"
#include "capture/intake/intake.h"
#include "lib/remove_tree.h"

#include <glib/gstdio.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define CAMERAS   8
#define WIDTH     1024
#define HEIGHT    768
#define PIXELS    ((gsize)WIDTH * HEIGHT)
#define HZ        15
#define STEPS     192 /* of a sweep */
#define PICTURES  48  /* that are different */
#define BUFFERS   6   /* a camera's, in frames, as the Aravis driver gives it */
#define EXPOSURE  4000
#define THRESHOLD 20

struct live {
    GMainLoop *loop;
    struct devices devices;
    struct Camera cameras[CAMERAS];
    struct session_conf conf;
    char *folder;
    guint8 *pictures[PICTURES], *dark;
    Intake *intake;
    GPtrArray *shots; /* each must stay while it is written */
    gint64 begun_us;
    gint64 taken; /* frames a camera, dropped ones too */
    int sub;      /* of the shot under way */
    struct speed_live ret;
};

static void on_result(const struct intake_result *result, gpointer data) {
    struct live *live = data;
    live->ret.results++;
    live->ret.failed += result->error != NULL;
    if (result->error && live->ret.failed == 1)
        fprintf(stderr, "bench_speed: %s\n", result->error->message);
}

static void on_room(gpointer data) {
}

/* As a driver unpacks Mono8 or Bayer8. */
static Frame *unpack(const guint8 *from) {
    Frame *frame = frame_new(WIDTH, HEIGHT);
    frame->bits = 8;
    frame->cfa = CFA_RGGB;
    frame->exposure_us = EXPOSURE;
    for (gsize i = 0; i < PIXELS; i++)
        frame->pixels[i] = from[i];
    return frame;
}

static void take(struct live *live, gboolean drop) {
    if (live->sub == 0) {
        struct session_shot *begun = g_new0(struct session_shot, 1);
        *begun = (struct session_shot){.id = live->shots->len + 1,
                                       .kind = SHOT_SWEEP,
                                       .cameras = {{(1u << CAMERAS) - 1}},
                                       .sweep_from_deg = -3,
                                       .sweep_to_deg = 3,
                                       .sweep_steps = STEPS};
        g_ptr_array_add(live->shots, begun);
    }
    const struct session_shot *shot = live->shots->pdata[live->shots->len - 1];
    const gboolean last = live->sub == STEPS;
    for (int camera = 0; camera < CAMERAS; camera++) {
        const guint8 *from = last ? live->dark : live->pictures[(live->sub + camera) % PICTURES];
        g_autoptr(Frame) frame = unpack(from);
        const struct taken_frame taken = {.shot = shot,
                                          .sub = live->sub,
                                          .frame = frame,
                                          .row = {.shot = shot->id, .camera = camera}};
        intake_take(live->intake, &taken);
    }
    live->ret.frames += CAMERAS;
    live->ret.dropped += drop ? CAMERAS : 0;
    live->sub = last ? 0 : live->sub + 1;
    live->taken++;
}

static gboolean tick(gpointer data) {
    struct live *live = data;
    const double now_s = (double)(g_get_monotonic_time() - live->begun_us) / G_USEC_PER_SEC;
    while ((double)live->taken / HZ <= now_s) {
        const double late_s = now_s - (double)live->taken / HZ;
        live->ret.late_ms = MAX(live->ret.late_ms, 1e3 * late_s);
        take(live, intake_is_full(live->intake) || late_s * HZ > BUFFERS);
    }
    if (now_s >= live->ret.seconds)
        g_main_loop_quit(live->loop);
    return G_SOURCE_CONTINUE;
}

static struct live *live_new(double seconds, gboolean store, const char *folder, int queue_mib) {
    struct live *live = g_new0(struct live, 1);
    live->ret.seconds = seconds;
    live->loop = g_main_loop_new(NULL, FALSE);
    live->shots = g_ptr_array_new_with_free_func(g_free);
    live->folder = g_build_filename(folder, "bench-live-XXXXXX", NULL);
    g_assert_nonnull(g_mkdtemp(live->folder));
    g_autofree char *laser = g_build_filename(live->folder, "laser", NULL);
    g_mkdir(laser, 0777);
    live->devices.clock = clock_new_real();
    live->devices.geometry.n_cameras = CAMERAS;
    live->devices.geometry.n_lasers = 1;
    g_strlcpy(live->devices.geometry.lasers[0].name, "laser", RIG_NAME);
    for (int i = 0; i < CAMERAS; i++) {
        g_snprintf(live->devices.geometry.cameras[i].name, RIG_NAME, "cam%d", i);
        live->cameras[i].format =
            (struct camera_format){.width = WIDTH, .height = HEIGHT, .bits = 8};
        live->devices.cameras[i] = &live->cameras[i];
    }
    live->conf.laser_exposure_us = EXPOSURE;
    live->conf.laser_threshold_dn = THRESHOLD;
    live->conf.dark_frames = 1;
    live->conf.keep_laser_frames = store;
    GRand *rand = g_rand_new_with_seed(2);
    live->dark = g_new0(guint8, PIXELS);
    for (int k = 0; k < PICTURES; k++) {
        live->pictures[k] = g_new(guint8, PIXELS);
        for (gsize i = 0; i < PIXELS; i++) {
            const double at = (double)(i % WIDTH) / WIDTH * PICTURES - k;
            const double line = fabs(at) < 5 ? 200 * exp(-at * at / 2) : 0;
            live->pictures[k][i] = (guint8)(g_rand_int_range(rand, 2, 8) + (int)line);
        }
    }
    g_rand_free(rand);
    const struct intake_setup setup = {&live->devices, &live->conf, live->folder,
                                       (gsize)queue_mib << 20, NULL};
    const struct intake_hooks hooks = {on_result, on_room, live};
    live->intake = intake_new(&setup, &hooks);
    return live;
}

struct speed_live speed_live(double seconds, gboolean store, const char *folder, int queue_mib) {
    struct live *live = live_new(seconds, store, folder, queue_mib);
    const double before_s = bench_cpu_s();
    live->begun_us = g_get_monotonic_time();
    const guint source = g_timeout_add(2, tick, live);
    g_main_loop_run(live->loop);
    g_source_remove(source);
    struct speed_live ret = live->ret;
    ret.seconds = (double)(g_get_monotonic_time() - live->begun_us) / G_USEC_PER_SEC;
    ret.cores = (bench_cpu_s() - before_s) / ret.seconds;
    ret.mb_s = 1e-6 * (double)ret.frames * (double)PIXELS / ret.seconds;
    intake_free(live->intake);
    remove_tree(live->folder);
    clock_unref(live->devices.clock);
    g_main_loop_unref(live->loop);
    g_ptr_array_unref(live->shots);
    for (int k = 0; k < PICTURES; k++)
        g_free(live->pictures[k]);
    g_free(live->dark);
    g_free(live->folder);
    g_free(live);
    return ret;
}
