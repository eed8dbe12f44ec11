/* All frames are one file with many names, because only the size of the frames matters here, not
 * their contents. */
#include "speed_parts.h"

#include "calibration/calibration.h"
#include "exr/exr.h"
#include "lib/remove_tree.h"
#include "measurement_rig.h"
#include "pipeline/pipeline.h"

#include <glib/gstdio.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define TEXELS 256
#define LIGHTS 96
#define CAMERA 2 /* at 45° */

/* Lamps at as many places of the arc as it takes; as many turns of the table as there are views. */
static void make_plan(const struct rig *rig, int views, struct session_plan *plan,
                      struct session_direction *view, struct session_direction *light,
                      struct session_shot *shot) {
    for (int v = 0; v < views; v++)
        view[v] = (struct session_direction){.index = v,
                                             .device = CAMERA,
                                             .theta_deg = 45,
                                             .phi_deg = -2.0 * v,
                                             .turntable_deg = 2.0 * v};
    for (int l = 0; l < LIGHTS; l++)
        light[l] = (struct session_direction){
            .index = l, .device = l % rig->n_lamps, .theta_deg = 10 + l / 2.0, .phi_deg = 3.0 * l};
    for (int i = 0; i < views * LIGHTS; i++)
        shot[i] = (struct session_shot){.id = i + 1,
                                        .kind = SHOT_LAMP,
                                        .pose = i,
                                        .turntable_deg = view[i / LIGHTS].turntable_deg,
                                        .arc_deg = 3.0 * (i % LIGHTS),
                                        .source = i % LIGHTS,
                                        .device = light[i % LIGHTS].device,
                                        .cameras = camera_set_of(CAMERA)};
    plan->views = view;
    plan->lights = light;
    plan->shots = shot;
    plan->n_views = views;
    plan->n_lights = LIGHTS;
    plan->n_shots = views * LIGHTS;
}

static void commit_all(Session *session, const struct session_plan *plan, const struct rig *rig,
                       const char *frame) {
    gint64 bytes = 0;
    g_autofree char *sum = exr_sha256(frame, &bytes, NULL);
    for (int i = 0; i < plan->n_shots; i++) {
        g_autofree char *relative = session_frame_path(&plan->shots[i], rig->cameras[CAMERA].name);
        g_autofree char *path = session_file(session, relative);
        const struct session_frame row = {
            .shot = i + 1, .camera = CAMERA, .path = relative, .sha256 = sum, .bytes = bytes};
        g_assert_cmpint(link(frame, path), ==, 0);
        g_assert_true(session_commit_shot(session, i + 1, SHOT_DONE, &row, 1, NULL, NULL));
    }
    g_assert_true(session_set_value(session, "state", "done", NULL));
}

static void make_session(const char *path, const char *frame, int views) {
    const struct bench_setup setup = {
        .material = "weave", .texels = TEXELS, .texel_mm = 50.0 / TEXELS, .pixels_a_texel = 2};
    struct rig *rig = g_new0(struct rig, 1);
    bench_rig(&setup, rig);
    g_autofree char *calibration = rig_to_text(rig);
    g_autofree struct session_direction *view = g_new0(struct session_direction, views);
    g_autofree struct session_direction *light = g_new0(struct session_direction, LIGHTS);
    g_autofree struct session_shot *shot = g_new0(struct session_shot, views * LIGHTS);
    struct session_plan plan = {.grid = bench_grid(&setup)};
    const struct session_texts texts = {"", "", calibration, NULL};
    g_autoptr(GError) error = NULL;
    make_plan(rig, views, &plan, view, light, shot);
    bench_write_frame(frame, &rig->cameras[CAMERA]);
    g_autoptr(Session) session = session_create(path, "memory", &texts, &plan, &error);
    if (!session)
        g_error("%s", error->message);
    commit_all(session, &plan, rig, frame);
    g_free(rig);
}

struct speed_memory speed_memory(int views, const char *folder) {
    g_autofree char *own = g_build_filename(folder, "bench-memory-XXXXXX", NULL);
    g_assert_nonnull(g_mkdtemp(own));
    g_autofree char *path = g_build_filename(own, "memory.session", NULL);
    g_autofree char *frame = g_build_filename(own, "frame.exr", NULL);
    make_session(path, frame, views);
    /* In a process of its own, of which the kernel tells what it took. */
    const gint64 begun_us = g_get_monotonic_time();
    const pid_t child = fork();
    struct rusage usage;
    int status = 1;
    if (child == 0) {
        const struct pipeline_options options = {.n_eigenmaps = 4};
        struct pipeline_result result;
        g_autoptr(GError) error = NULL;
        const gboolean ok = pipeline_run(path, &options, &result, &error);
        if (!ok)
            fprintf(stderr, "bench_speed: %s\n", error->message);
        _exit(!ok);
    }
    const gboolean ended = child > 0 && wait4(child, &status, 0, &usage) == child;
    const struct speed_memory ret = (struct speed_memory){
        .peak_mib = ended ? (double)usage.ru_maxrss / 1024 : 0,
        .seconds = (double)(g_get_monotonic_time() - begun_us) / G_USEC_PER_SEC,
        .texels = TEXELS,
        .views = views,
        .lights = LIGHTS,
        .ok = ended && status == 0};
    remove_tree(own);
    return ret;
}
