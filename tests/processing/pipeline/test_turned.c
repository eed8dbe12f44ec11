/* Frames that were exposed while the turntable turned, each a little elsewhere: the BTF is made of
 * each in its own pose. The exposures of this rig's cameras begin up to 8 ms late, as their time
 * stamps say. */
#include "btf/near_field.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "pipeline/pipeline.h"

#include <math.h>
#include <png.h>
#include <sqlite3.h>
#include <string.h>

#include "exr/exr.h"
#include "lib/capture_run.h"

enum { VIEWS = 8, LIGHTS = 8, TEXELS = 32 };

#define FINE(section)                                                                              \
    {section, "width = 64"}, {section, "height = 64"}, {                                           \
        section, "focal_px = 590"                                                                  \
    }
#define ALL                                                                                        \
    FINE("[camera cam30]"), {"[camera cam60]", NULL}, {"[views]", "rings = 30:8"},                 \
        {"[lights]", "rings = 30:8"}, {"[lights]", "offset_deg = 22.5"}, {"[lasers]", NULL},       \
        {"[world]", "warm_up_s = 2"}, {"[world]", "noise = no"}, {"[world]", "supersample = 3"},   \
        {"[capture]", "exposures_us = 1000"}, {                                                    \
        "[capture]", "blur_texels = 2"                                                             \
    }
static const struct change standing[] = {ALL, {NULL, NULL}};
static const struct change turning[] = {
    ALL, {"[capture]", "motion = continuous"}, {"[camera cam30]", "fault_jitter_ms = 8"}, {0}};

/* Waves of 10 mm, which the cameras resolve, on a flat sample. */
static void write_pictures(const char *directory) {
    enum { SIZE = 128 };
    g_autofree char *flat = g_build_filename(directory, "flat.png", NULL);
    g_autofree char *waves = g_build_filename(directory, "waves.png", NULL);
    guint16 *heights = g_new(guint16, SIZE * SIZE);
    guint8 *colours = g_new(guint8, SIZE * SIZE * 3);
    for (int i = 0; i < SIZE * SIZE; i++) {
        const double x = 10 * G_PI * (i % SIZE) / SIZE, y = 10 * G_PI * (i / SIZE) / SIZE;
        heights[i] = G_MAXUINT16;
        memset(colours + 3 * i, (int)(130 + 100 * sin(x) * sin(y)), 3);
    }
    png_image image = {.version = PNG_IMAGE_VERSION, .width = SIZE, .height = SIZE};
    image.format = PNG_FORMAT_RGB;
    g_assert_true(png_image_write_to_file(&image, waves, 0, colours, 0, NULL));
    image.format = PNG_FORMAT_LINEAR_Y;
    g_assert_true(png_image_write_to_file(&image, flat, 0, heights, 0, NULL));
    g_free(heights);
    g_free(colours);
}

/* A session of that sample. */
static struct run *captured(const struct change *changes) {
    struct run *run = run_new(changes);
    g_autofree char *world = g_build_filename(run->directory, "world.conf", NULL);
    g_autofree char *conf = g_build_filename(run->directory, "session.conf", NULL);
    g_autofree char *text = NULL, *session = NULL;
    g_autoptr(GError) error = NULL;
    devices_close(g_steal_pointer(&run->devices));
    write_pictures(run->directory);
    ok(g_file_get_contents(world, &text, NULL, ERR));
    char **parts = g_strsplit(text, "kind = flat", 2);
    g_autofree char *other = g_strjoinv("kind = picture\npath = flat.png\nalbedo_path = waves.png\n"
                                        "relief_mm = 0.01",
                                        parts);
    g_strfreev(parts);
    ok(g_file_set_contents(world, other, -1, ERR));
    g_file_get_contents(conf, &session, NULL, &error);
    parts = g_strsplit(session, "texels = 8", 2);
    g_autofree char *finer = g_strjoinv("texels = 32", parts);
    g_strfreev(parts);
    session_conf_clear(&run->conf);
    g_assert_true(session_conf_parse(&run->conf, finer, "session.conf", &error));
    run_open_devices(run);
    run_start(run);
    run_to_end(run);
    return run;
}

/* View by view: VIEWS × LIGHTS × TEXELS² × 3. */
static float *btf_of(struct run *run) {
    static const char *const channels[] = {"R", "G", "B"};
    const struct pipeline_options options = {.n_eigenmaps = 1};
    struct pipeline_result result;
    ok(pipeline_run(run->session, &options, &result, ERR));
    g_assert_cmpint(result.n_views, ==, VIEWS);
    float *ret = g_new(float, VIEWS *LIGHTS *TEXELS *TEXELS * 3), *to = ret;
    for (int v = 0; v < VIEWS; v++) {
        g_autofree char *path = g_strdup_printf("%s/products/btf/view_%04d.exr", run->session, v);
        struct exr_file *file = ok(exr_read(path, ERR));
        g_assert_cmpint(file->parts->len, ==, LIGHTS);
        for (int l = 0; l < LIGHTS; l++)
            for (int c = 0; c < 3; c++, to += TEXELS * TEXELS)
                memcpy(to, exr_part_plane(file->parts->pdata[l], channels[c]),
                       sizeof(float) * TEXELS * TEXELS);
        exr_file_free(file);
    }
    return ret;
}

static double rms_off(const float *a, const float *b) {
    double sum = 0, norm = 0;
    for (int i = 0; i < VIEWS * LIGHTS * TEXELS * TEXELS * 3; i++) {
        sum += (double)(a[i] - b[i]) * (double)(a[i] - b[i]);
        norm += (double)b[i] * (double)b[i];
    }
    return sqrt(sum / norm);
}

/* Forgets where the table was, as if it had stood. */
static void forget_poses(struct run *run) {
    g_autofree char *path = g_build_filename(run->session, "session.db", NULL);
    sqlite3 *db;
    g_assert_cmpint(sqlite3_open(path, &db), ==, SQLITE_OK);
    g_assert_cmpint(
        sqlite3_exec(db, "DELETE FROM value WHERE key GLOB 'turned/*'", NULL, NULL, NULL), ==,
        SQLITE_OK);
    g_assert_cmpint(sqlite3_changes(db), >, 40);
    sqlite3_close(db);
}

/* By how much the frames of passes are elsewhere, in degrees: RMS. */
static double poses_off(struct run *run) {
    g_autoptr(GPtrArray) shots = run_shots(run->session), frames = run_frames(run->session);
    double sum = 0;
    int n = 0;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = shots->pdata[frame->shot - 1];
        const double off = session_frame_turntable_deg(frame, shot) - shot->turntable_deg;
        sum += off * off;
        n += frame->turned;
    }
    g_assert_cmpint(n, >, 40);
    return sqrt(sum / n);
}

/* The places of cameras and lamps in the BTF are those of the frames. */
static void check_places(struct run *run) {
    g_autoptr(GPtrArray) shots = run_shots(run->session), frames = run_frames(run->session);
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, &error);
    g_autoptr(GPtrArray) views = session_views(session, &error);
    g_assert_no_error(error);
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = shots->pdata[frame->shot - 1];
        double eye[3], lamp[3];
        int view = 0;
        if (shot->kind != SHOT_LAMP)
            continue;
        while (((const struct session_direction *)views->pdata[view])->turntable_deg !=
               shot->turntable_deg)
            view++;
        g_autofree char *path =
            g_strdup_printf("%s/products/btf/view_%04d.exr", run->session, view);
        g_autofree char *name = g_strdup_printf("light_%04d", shot->source);
        struct exr_file *file = ok(exr_read_headers(path, ERR));
        const struct exr_part *part = exr_file_part(file, name);
        g_assert_true(exr_get_v3d(part, "view.centre_mm", eye, NULL));
        g_assert_true(exr_get_v3d(part, "light.position_mm", lamp, NULL));
        const double deg = session_frame_turntable_deg(frame, shot);
        g_assert_cmpfloat_with_epsilon(remainder(atan2(eye[1], eye[0]) * 180 / G_PI + deg, 360), 0,
                                       1e-6);
        g_assert_cmpfloat_with_epsilon(
            remainder(atan2(lamp[1], lamp[0]) * 180 / G_PI + deg - shot->arc_deg, 360), 0, 1e-6);
        exr_file_free(file);
    }
}

TEST(own_pose) {
    struct run *still = captured(standing), *run = captured(turning);
    g_autofree float *truth = btf_of(still), *posed = btf_of(run);
    const double off_deg = poses_off(run), with = rms_off(posed, truth);
    check_places(run);
    struct near_field *near = near_field_read(run->session, NULL);
    g_assert_nonnull(near);
    near_field_free(near);
    forget_poses(run);
    g_autofree float *unposed = btf_of(run);
    const double without = rms_off(unposed, truth);
    g_test_message("poses off by %.3f°; BTF by %.4f in their own poses, %.4f in those of the plan",
                   off_deg, with, without);
    g_assert_cmpfloat(off_deg, >, 0.2);
    g_assert_cmpfloat(with, <, 0.6 * without);
    run_free(run);
    run_free(still);
}

TESTS_RUN_BY(run_tests);
