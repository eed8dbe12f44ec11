/*
 * What domes with as many lamps and cameras as published ones cost: CPU time, wall time and peak
 * memory of the programs, for the plan of the whole session, and for a session in simulated time
 * with every --every-th lamp as a light and the turntable at --turns angles. With the defaults the
 * captures take some seconds; --every 1 --turns 15 captures all, which takes minutes.
 */
#include "bench.h"
#include "lamps/lamps.h"
#include "lib/deviate.h"
#include "lib/dome.h"
#include "lib/process.h"
#include "lib/remove_tree.h"

#include <glib/gstdio.h>
#include <json-glib/json-glib.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define MESORIG  BUILD_DIR "/bin/mesorig"
#define RAD(deg) ((deg) * (G_PI / 180))
#define TURNS    4    /* angles of the turntable in the calibration of lamps */
#define NOISE_MM 0.02 /* standard deviation of the ends of shadows */

static int every = 25, turns = 1, side = 16;
static gboolean only_plan;

static const GOptionEntry entries[] = {
    {"every", 0, 0, G_OPTION_ARG_INT, &every, "Capture under every N-th lamp (25)", "N"},
    {"turns", 0, 0, G_OPTION_ARG_INT, &turns, "Angles of the turntable, 1 or 15 (1)", "N"},
    {"side", 0, 0, G_OPTION_ARG_INT, &side, "Pixels of a side of the pictures (16)", "N"},
    {"only-plan", 0, 0, G_OPTION_ARG_NONE, &only_plan, "Capture nothing", NULL},
    {NULL},
};

struct cost {
    double cpu_s, wall_s, peak_mib;
};

static double seconds(struct timeval time) {
    return (double)time.tv_sec + 1e-6 * (double)time.tv_usec;
}

/* Runs a program, and ends the bench if the program fails. ret_out may be NULL. The programs that
 * it starts are included once it has waited for them. */
static struct cost run(const char *const *argv, char **ret_out) {
    g_autoptr(GError) error = NULL;
    struct rusage usage;
    int out = -1, status;
    GPid pid;
    const double begun_s = bench_now_s();
    g_spawn_async_with_pipes(NULL, (char **)argv, NULL, G_SPAWN_DO_NOT_REAP_CHILD, NULL, NULL, &pid,
                             NULL, &out, NULL, &error);
    bench_check(error);
    g_autoptr(GString) text = g_string_new(NULL);
    char bytes[4096];
    for (gssize n; (n = read(out, bytes, sizeof bytes)) > 0;)
        g_string_append_len(text, bytes, n);
    close(out);
    if (wait4(pid, &status, 0, &usage) != pid || status != 0)
        bench_fail(1, "%s %s has failed", argv[0], argv[1]);
    if (ret_out)
        *ret_out = g_strdup(text->str);
    return (struct cost){seconds(usage.ru_utime) + seconds(usage.ru_stime), bench_now_s() - begun_s,
                         (double)usage.ru_maxrss / 1024};
}

static void put(const char *name, struct cost cost) {
    bench_row(name, "%.2f{cpu_s} %.2f{wall_s} %.0f{peak_mib}", cost.cpu_s, cost.wall_s,
              cost.peak_mib);
}

static gint64 planned(const char *json, const char *key) {
    g_autoptr(JsonParser) parser = json_parser_new();
    g_autoptr(GError) error = NULL;
    json_parser_load_from_data(parser, json, -1, &error);
    bench_check(error);
    return json_object_get_int_member(json_node_get_object(json_parser_get_root(parser)), key);
}

static const struct lamp_target posts = {
    .kind = LAMP_POLES,
    .plane_mm = 2,
    .radius_mm = 1,
    .plate_mm = {84, 84},
    .marks = {{-22, -20, 24}, {20, -24, 12}, {24, 18, 24}, {-18, 24, 12}, {0, 8, 20}, {-6, -14, 5}},
    .n = 6,
    .tolerance_mm = 0.02};

/* The rig of a dome, whose lamps stand up to 3 mm from their nominal places. */
static struct rig *rig_of(const struct dome *dome, GRand *rand, struct rig **ret_true) {
    struct rig *rig = g_new0(struct rig, 1);
    for (const struct dome_ring *ring = dome->cameras; ring->count; ring++)
        for (int k = 0; k < ring->count; k++) {
            struct rig_camera *camera = &rig->cameras[rig->n_cameras++];
            const struct vec3 out =
                rig_direction(RAD(ring->theta_deg), RAD(k * 360.0 / ring->count));
            *camera = (struct rig_camera){.width = 640,
                                          .height = 640,
                                          .fx_px = 4160,
                                          .fy_px = 4160,
                                          .cx_px = 319.5,
                                          .cy_px = 319.5,
                                          .response = 6000};
            rig_camera_look_at(camera, vec3_scale(out, 650), vec3(0, 0, 0));
        }
    for (const struct dome_ring *ring = dome->lamps; ring->count; ring++)
        for (int k = 0; k < ring->count; k++) {
            const struct vec3 out =
                rig_direction(RAD(ring->theta_deg), RAD(k * 360.0 / ring->count));
            rig->lamps[rig->n_lamps++] = (struct rig_lamp){.position_mm = vec3_scale(out, 400),
                                                           .aim = vec3_scale(out, -1),
                                                           .exponent = 2,
                                                           .intensity = 25,
                                                           .fixed = 1};
        }
    *ret_true = g_memdup2(rig, sizeof *rig);
    for (int l = 0; l < rig->n_lamps; l++) {
        struct vec3 *at = &(*ret_true)->lamps[l].position_mm;
        *at = vec3_add(*at, vec3(g_rand_double_range(rand, -3, 3), g_rand_double_range(rand, -3, 3),
                                 g_rand_double_range(rand, -3, 3)));
    }
    return rig;
}

/* Ends of the posts' shadows that cameras measure, with noise: all lamps, and each camera at one of
 * the TURNS angles. */
static GArray *sights_of(const struct rig *rig, GRand *rand) {
    GArray *sights = g_array_new(FALSE, FALSE, sizeof(struct lamp_sight));
    for (int t = 0; t < TURNS; t++)
        for (int c = t; c < rig->n_cameras; c += TURNS)
            for (int l = -1; l < rig->n_lamps; l++)
                for (int m = 0; m < posts.n; m++) {
                    struct lamp_sight s = {.lamp = l,
                                           .camera = c,
                                           .mark = m,
                                           .turntable_rad = RAD(90 * t + 10),
                                           .sigma = NOISE_MM};
                    const struct vec3 from =
                        l < 0 ? rig_camera_centre_mm(&rig->cameras[c]) : rig->lamps[l].position_mm;
                    struct vec3 end;
                    if (!lamp_shadow_mm(&posts, m, lamp_mark_mm(&posts, m, 0),
                                        rig_turn(from, -s.turntable_rad), &end, NULL) ||
                        hypot(end.x, end.y) > 40)
                        continue;
                    s.x = end.x + NOISE_MM * deviate_sum(rand);
                    s.y = end.y + NOISE_MM * deviate_sum(rand);
                    g_array_append_val(sights, s);
                }
    return sights;
}

/* Estimates the places of all lamps at the same time. */
static void measure_lights(const struct dome *dome) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GRand) rand = g_rand_new_with_seed(3);
    g_autofree struct rig *placed = NULL, *rig = rig_of(dome, rand, &placed);
    g_autofree struct lamps_result *result = g_new0(struct lamps_result, 1);
    g_autoptr(GArray) sights = sights_of(placed, rand);
    const double begun_s = bench_cpu_s();
    lamps_fit(rig, &posts, (const struct lamp_sight *)(gpointer)sights->data, (int)sights->len,
              result, &error);
    const double cpu_s = bench_cpu_s() - begun_s;
    bench_check(error);
    g_autofree double *off_mm = g_new(double, rig->n_lamps);
    for (int l = 0; l < rig->n_lamps; l++)
        off_mm[l] =
            vec3_length(vec3_sub(result->rig.lamps[l].position_mm, placed->lamps[l].position_mm));
    bench_row("lights", "%u{sights} %.2f{cpu_s} %.3f{median_off_mm}", sights->len, cpu_s,
              bench_time_quantile(off_mm, rig->n_lamps, 0.5));
    lamps_result_clear(result);
}

static void measure(const struct dome *dome) {
    g_autoptr(GError) error = NULL;
    g_autofree char *folder = g_dir_make_tmp("mesorig-dome-XXXXXX", &error);
    bench_check(error);
    g_autofree char *rig = g_build_filename(folder, "rig.conf", NULL);
    g_autofree char *conf = g_build_filename(folder, "session.conf", NULL);
    g_autofree char *session = g_build_filename(folder, "x.session", NULL);
    g_autofree char *page = g_build_filename(folder, "page.html", NULL);
    g_autofree char *picture = g_build_filename(folder, "picture.png", NULL);
    g_autofree char *plan = NULL;
    dome_write(dome, folder, side, 1, dome->turns);
    bench_begin(dome->name);
    bench_put("%d{lamps} %d{cameras}", dome_n_lamps(dome), dome_n_cameras(dome));
    const struct cost cost =
        run((const char *[]){MESORIG, "plan", "--json", rig, conf, NULL}, &plan);
    bench_row("plan",
              "%.2f{cpu_s} %.2f{wall_s} %.0f{peak_mib} %" G_GINT64_FORMAT
              "{views} %" G_GINT64_FORMAT "{shots} %" G_GINT64_FORMAT "{frames}",
              cost.cpu_s, cost.wall_s, cost.peak_mib, planned(plan, "views"),
              planned(plan, "shots"), planned(plan, "frames"));
    if (!only_plan) {
        measure_lights(dome);
        const struct {
            const char *name;
            const char *argv[8];
        } steps[] = {
            {"capture", {MESORIG, "capture", "--yes", rig, conf, "-o", session, NULL}},
            {"process", {MESORIG, "process", session, NULL}},
            {"info", {MESORIG, "info", session, NULL}},
            {"verify", {MESORIG, "verify", session, NULL}},
            {"check", {MESORIG, "check", session, NULL}},
            {"report", {MESORIG, "report", session, "-o", page, NULL}},
            {"view", {BUILD_DIR "/bin/mesorig-view", session, "--render", picture, NULL}},
        };
        dome_write(dome, folder, side, every, MIN(turns, dome->turns));
        for (gsize i = 0; i < G_N_ELEMENTS(steps); i++)
            put(steps[i].name, run(steps[i].argv, NULL));
    }
    bench_end();
    remove_tree(folder);
}

int main(int argc, char **argv) {
    bench_parse(&argc, &argv, entries, NULL);
    if (every < 1 || side < 1 || (turns != 1 && turns != 15))
        bench_fail(2, "--every and --side must be at least 1, and --turns 1 or 15");
    bench_begin(NULL);
    measure(&dome_of_lamps);
    measure(&dome_of_cameras);
    bench_end();
    return 0;
}
