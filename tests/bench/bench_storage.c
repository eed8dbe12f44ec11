/*
 * How fast frames and rows reach the disk, against plain write() and fsync() of as many bytes to
 * the same folder in the same run. MB/s are of raw pixels (half), so that methods compare.
 */
#include "bench.h"
#include "exr/exr.h"
#include "exr/exr_half.h"
#include "lib/remove_tree.h"
#include "session/session.h"

#include <fcntl.h>
#include <glib/gstdio.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define REPEATS 7
#define SHOTS   300

static const char *const methods[] = {"none", "zip", "piz"};
static char *folder;

struct result {
    int width, height;
    const char *method;
    double raw_write, raw_read, write, write_sync, read; /* MB/s; raw_write is synced */
    double ratio;                                        /* pixels to bytes on disk */
};

/* A frame as cameras give it: a smooth shape, texture, and shot noise of 12 bits. */
static struct exr_file *make_frame(int width, int height) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    struct exr_file *file = exr_file_new();
    struct exr_part *part = exr_part_new("frame", width, height, channels, EXR_HALF);
    GRand *rand = g_rand_new_with_seed(1);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < width * height; i++) {
            double x = i % width / (double)width, y = i / width / (double)height;
            double level = 1200 * (1 - x * y) * ((i % 8 < 4) ? 1 : 0.6) + 64;
            part->planes[c][i] =
                (float)((level + g_rand_double_range(rand, -30, 30)) / 4096 * (c + 1));
        }
    g_rand_free(rand);
    exr_file_add(file, part);
    return file;
}

static double write_raw(const char *path, const void *bytes, gsize size) {
    double start = bench_now_s();
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (fd < 0 || write(fd, bytes, size) != (gssize)size || fsync(fd) != 0)
        exit(1);
    close(fd);
    return bench_now_s() - start;
}

static double read_raw(const char *path, void *bytes, gsize size) {
    double start = bench_now_s();
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0 || read(fd, bytes, size) != (gssize)size)
        exit(1);
    close(fd);
    return bench_now_s() - start;
}

static double write_exr(const char *path, const struct exr_file *file, int method, gboolean sync) {
    GError *error = NULL;
    double start = bench_now_s();
    exr_write(path, file, (enum exr_compression)method, sync, &error);
    bench_check(error);
    return bench_now_s() - start;
}

static double read_exr(const char *path) {
    GError *error = NULL;
    double start = bench_now_s();
    struct exr_file *file = exr_read(path, &error);
    bench_check(error);
    exr_file_free(file);
    return bench_now_s() - start;
}

static struct result measure(int width, int height, int method) {
    g_autofree char *raw = g_build_filename(folder, "raw", NULL);
    g_autofree char *exr = g_build_filename(folder, "frame.exr", NULL);
    gsize size = (gsize)width * (gsize)height * 3 * 2;
    g_autofree guint8 *bytes = g_malloc(size);
    struct exr_file *file = make_frame(width, height);
    double t[5][REPEATS];
    double mb = (double)size * 1e-6;
    gint64 on_disk = 0;
    for (int c = 0; c < 3; c++)
        exr_half_from_floats((guint16 *)(gpointer)(bytes + size / 3 * (gsize)c),
                             ((struct exr_part *)g_ptr_array_index(file->parts, 0))->planes[c],
                             size / 6);
    for (int i = 0; i < REPEATS; i++) {
        t[0][i] = write_raw(raw, bytes, size);
        t[1][i] = read_raw(raw, bytes, size);
        t[2][i] = write_exr(exr, file, method, FALSE);
        t[3][i] = write_exr(exr, file, method, TRUE);
        t[4][i] = read_exr(exr);
    }
    g_free(exr_sha256(exr, &on_disk, NULL));
    exr_file_free(file);
    g_unlink(raw);
    g_unlink(exr);
    return (struct result){width,
                           height,
                           methods[method],
                           mb / bench_time_quantile(t[0], REPEATS, 0.5),
                           mb / bench_time_quantile(t[1], REPEATS, 0.5),
                           mb / bench_time_quantile(t[2], REPEATS, 0.5),
                           mb / bench_time_quantile(t[3], REPEATS, 0.5),
                           mb / bench_time_quantile(t[4], REPEATS, 0.5),
                           (double)size / (double)on_disk};
}

static double half_mb_per_s(gboolean to_half) {
    enum { N = 1 << 20 };
    g_autofree float *floats = g_new0(float, N);
    g_autofree guint16 *halves = g_new0(guint16, N);
    double t[REPEATS];
    for (int i = 0; i < N; i++)
        floats[i] = (float)(i % 4096) / 4096;
    exr_half_from_floats(halves, floats, N);
    for (int i = 0; i < REPEATS; i++) {
        double start = bench_now_s();
        if (to_half)
            exr_half_from_floats(halves, floats, N);
        else
            exr_half_to_floats(floats, halves, N);
        t[i] = bench_now_s() - start;
    }
    return N * 2e-6 / bench_time_quantile(t, REPEATS, 0.5);
}

static Session *make_session(const char *path) {
    static const struct session_texts texts = {"", "", "", NULL};
    g_autofree struct session_shot *shots = g_new0(struct session_shot, SHOTS);
    struct session_plan plan = {.grid = {64, 64, 50, 50, 5, 5}, .shots = shots, .n_shots = SHOTS};
    GError *error = NULL;
    Session *session;
    for (int i = 0; i < SHOTS; i++)
        shots[i] = (struct session_shot){.id = i + 1, .source = -1, .device = -1, .cameras = 31};
    session = session_create(path, "bench", &texts, &plan, &error);
    bench_check(error);
    return session;
}

/* Five cameras a shot, whose files are there already. */
static double commits_per_s(void) {
    g_autofree char *path = g_build_filename(folder, "bench.session", NULL);
    Session *session = make_session(path);
    g_autofree char *sha256 = g_strnfill(64, '0');
    GError *error = NULL;
    double seconds = 0;
    for (int i = 1; i <= SHOTS; i++) {
        struct session_frame frames[5];
        double start;
        for (int c = 0; c < 5; c++) {
            g_autofree char *camera = g_strdup_printf("cam%d", c), *file = NULL;
            struct session_shot shot = {.id = i};
            frames[c] = (struct session_frame){.shot = i,
                                               .camera = c,
                                               .sha256 = sha256,
                                               .bytes = 1,
                                               .path = session_frame_path(&shot, camera)};
            file = session_file(session, frames[c].path);
            g_file_set_contents(file, "x", 1, NULL);
        }
        start = bench_now_s();
        session_commit_shot(session, i, SHOT_DONE, frames, 5, NULL, &error);
        seconds += bench_now_s() - start;
        bench_check(error);
        for (int c = 0; c < 5; c++)
            g_free(frames[c].path);
    }
    session_close(session);
    return SHOTS / seconds;
}

/* What a commit cannot do without: one page appended and on disk. */
static double syncs_per_s(void) {
    g_autofree char *path = g_build_filename(folder, "syncs", NULL);
    static const char page[4096];
    int fd = open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    double start = bench_now_s(), seconds;
    for (int i = 0; i < SHOTS; i++)
        if (write(fd, page, sizeof page) != sizeof page || fsync(fd) != 0)
            exit(1);
    seconds = bench_now_s() - start;
    close(fd);
    g_unlink(path);
    return SHOTS / seconds;
}

static void print_text(const struct result *r) {
    printf("%4d×%-4d %-4s  write %6.1f  synced %6.1f (%.2f of raw)  read %6.1f (%.2f of raw)  "
           "ratio %.2f\n",
           r->width, r->height, r->method, r->write, r->write_sync, r->write_sync / r->raw_write,
           r->read, r->read / r->raw_read, r->ratio);
}

static void print_json(const struct result *r, gboolean last) {
    printf("    {\"width\": %d, \"height\": %d, \"compression\": \"%s\", "
           "\"raw_write_sync_mb_per_s\": %.1f, \"raw_read_mb_per_s\": %.1f, "
           "\"write_mb_per_s\": %.1f, \"write_sync_mb_per_s\": %.1f, \"read_mb_per_s\": %.1f, "
           "\"write_sync_to_raw\": %.3f, \"read_to_raw\": %.3f, \"ratio\": %.3f}%s\n",
           r->width, r->height, r->method, r->raw_write, r->raw_read, r->write, r->write_sync,
           r->read, r->write_sync / r->raw_write, r->read / r->raw_read, r->ratio, last ? "" : ",");
}

static void measure_exr(gboolean json) {
    static const int sizes[][2] = {{160, 160}, {1024, 768}};
    for (gsize s = 0; s < G_N_ELEMENTS(sizes); s++)
        for (int method = EXR_NONE; method <= EXR_PIZ; method++) {
            struct result result = measure(sizes[s][0], sizes[s][1], method);
            if (json)
                print_json(&result, s == G_N_ELEMENTS(sizes) - 1 && method == EXR_PIZ);
            else
                print_text(&result);
        }
}

static void measure_rest(gboolean json) {
    double commits = commits_per_s(), syncs = syncs_per_s();
    printf(json ? "  \"half_from_float_mb_per_s\": %.0f,\n  \"half_to_float_mb_per_s\": %.0f,\n"
                  "  \"commits_per_s\": %.0f,\n  \"page_syncs_per_s\": %.0f,\n"
                  "  \"commits_to_syncs\": %.3f\n"
                : "half %.0f MB/s from, %.0f MB/s to float\n%.0f shots a second committed; %.0f "
                  "pages a second synced (%.2f)\n",
           half_mb_per_s(TRUE), half_mb_per_s(FALSE), commits, syncs, commits / syncs);
}

int main(int argc, char **argv) {
    gboolean json = FALSE;
    g_autofree char *where = NULL;
    GOptionEntry entries[] = {
        {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Print one JSON object", NULL},
        {"directory", 'd', 0, G_OPTION_ARG_FILENAME, &where, "Measure this disk", "DIR"},
        {NULL},
    };
    bench_parse(&argc, &argv, entries, "- measure storage");
    folder = g_build_filename(where ? where : g_get_tmp_dir(), "mesorig-bench-XXXXXX", NULL);
    if (!g_mkdtemp(folder))
        bench_fail(1, "%s: cannot be made", folder);
    fputs(json ? "{\n  \"exr\": [\n" : "", stdout);
    measure_exr(json);
    fputs(json ? "  ],\n" : "", stdout);
    measure_rest(json);
    fputs(json ? "}\n" : "", stdout);
    remove_tree(folder);
    g_free(folder);
    return 0;
}
