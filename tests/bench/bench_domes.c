/*
 * What domes with as many lamps and cameras as published ones cost: CPU time, wall time and peak
 * memory of the programs, for the plan of the whole session, and for a session in simulated time
 * with every --every-th lamp as a light and the turntable at --turns angles. With the defaults the
 * captures take some seconds; --every 1 --turns 15 captures all, which takes minutes.
 */
#include "bench.h"
#include "lib/dome.h"
#include "lib/process.h"
#include "lib/remove_tree.h"

#include <glib/gstdio.h>
#include <json-glib/json-glib.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define MESORIG BUILD_DIR "/bin/mesorig"

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
