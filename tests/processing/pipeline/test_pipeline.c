/* From the frames of a session to its products: of a whole session, again, of a part, during the
 * capture, and sessions that are refused. */
#include "base/data_error.h"
#include "btf/btf.h"
#include "lib/ok.h"
#include "lib/pipeline_fixture.h"
#include "pipeline/catalogue.h"

#include "codecs/eigenmaps/eigenmaps.h"

#include <gio/gio.h>
#include <glib/gstdio.h>

/* The cosine at which the lamp stands over a texel: near-field, so not everywhere that of 35°. */
static double lamp_cosine(const struct session_shot *shot, int turn, int texel) {
    double side = 24.0 / TEXELS, at[3],
           start[3] = {500 * sin(lamp.theta), 0, 500 * cos(lamp.theta)};
    double p[3] = {-12 + (texel % TEXELS + 0.5) * side,
                   12 - ((double)(texel / TEXELS) + 0.5) * side, 5};
    analytic_turn(p, fixture_turn_deg(turn) * DEGREE, p);
    analytic_turn(start, shot->arc_deg * DEGREE, at);
    double way[3] = {at[0] - p[0], at[1] - p[1], at[2] - p[2]};
    return way[2] / sqrt(analytic_dot(way, way));
}

static void check_place(const struct exr_part *part, const char *name, double mm, double theta_deg,
                        double phi_deg) {
    double p[3], theta = theta_deg * DEGREE, phi = phi_deg * DEGREE;
    g_assert_true(exr_get_v3d(part, name, p, NULL));
    g_assert_cmpfloat_with_epsilon(p[0], mm * sin(theta) * cos(phi), 1e-6);
    g_assert_cmpfloat_with_epsilon(p[1], mm * sin(theta) * sin(phi), 1e-6);
    g_assert_cmpfloat_with_epsilon(p[2], mm * cos(theta), 1e-6);
}

static void check_btf(const struct fixture *fixture) {
    static const char *const channels[] = {"R", "G", "B"};
    for (int view = 0; view < N_VIEWS; view++)
        for (int light = 0; light < N_LIGHTS; light++) {
            g_autoptr(GError) error = NULL;
            g_autofree char *file = g_strdup_printf("btf/view_%04d.exr", view);
            g_autofree char *path = fixture_product(fixture, file);
            g_autofree char *name = g_strdup_printf("light_%04d", light);
            g_autoptr(ExrPart) part = exr_read_part(path, name, &error);
            g_assert_no_error(error);
            int turn = view / N_CAMERAS;
            const struct session_shot *shot = &fixture->shots[turn * (N_LIGHTS + N_LASERS) + light];
            for (int i = 0; i < TEXELS * TEXELS * 3; i++) {
                double cosine = lamp_cosine(shot, turn, i / 3);
                g_assert_cmpfloat_with_epsilon(exr_part_plane(part, channels[i % 3])[i / 3],
                                               albedo[i % 3] * cosine, 2e-3 * albedo[i % 3]);
            }
            double theta_deg, phi_deg;
            int holes;
            g_assert_true(exr_get_double(part, "view.theta_deg", &theta_deg, NULL));
            g_assert_true(exr_get_double(part, "light.phi_deg", &phi_deg, NULL));
            g_assert_true(exr_get_int(part, "mesorig.holes", &holes, NULL));
            g_assert_cmpfloat(theta_deg, ==, view % N_CAMERAS ? 50 : 20);
            g_assert_cmpfloat(phi_deg, ==, 40 + 70 * light);
            g_assert_cmpint(holes, ==, 0);
            check_place(part, "view.centre_mm", 650, theta_deg, -fixture_turn_deg(turn));
            check_place(part, "light.position_mm", lamp.distance_mm, 35, phi_deg);
        }
}

static void check_eigenmaps(const struct fixture *fixture, double error_said) {
    g_autofree char *path = fixture_product(fixture, "eigenmaps.exr");
    struct eigenmaps *maps = ok(eigenmaps_read(path, ERR));
    g_assert_cmpint(maps->layout.views.n, ==, N_VIEWS);
    g_assert_cmpint(maps->layout.lights.n, ==, N_LIGHTS);
    g_assert_cmpint(maps->n_terms, ==, 2);
    g_assert_cmpstr(maps->name, ==, "small");
    /* Lamps turn with the sample here, and the diffuser looks alike from everywhere. */
    g_assert_cmpfloat(error_said, <, 0.01);
    g_assert_cmpfloat(error_said, >, 1e-5); /* at least that of half floats */
    for (int light = 0; light < N_LIGHTS; light++) {
        double sum = 0;
        int texel = TEXELS * TEXELS / 2 + TEXELS / 2;
        for (int term = 0; term < 2; term++)
            sum += maps->weights[term * N_VIEWS + 1] *
                   maps->maps[((term * N_LIGHTS + light) * TEXELS * TEXELS + texel) * 3];
        g_assert_cmpfloat_with_epsilon(
            sum, albedo[0] * lamp_cosine(&fixture->shots[light], 0, texel), 0.01);
    }
    eigenmaps_free(maps);
}

static char *hash_products(const struct fixture *fixture) {
    static const char *const names[] = {"btf/view_0000.exr", "btf/view_0003.exr", "mdf.exr",
                                        "eigenmaps.exr"};
    g_autoptr(GChecksum) sum = g_checksum_new(G_CHECKSUM_SHA256);
    for (guint i = 0; i < G_N_ELEMENTS(names); i++) {
        g_autofree char *path = fixture_product(fixture, names[i]), *bytes = NULL;
        gsize length;
        g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
        g_checksum_update(sum, (guchar *)bytes, (gssize)length);
    }
    return g_strdup(g_checksum_get_string(sum));
}

static void test_whole(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 0, fixture->n_shots, NULL);
    fixture_set_state(fixture, "done");
    struct pipeline_result result = fixture_process(fixture, 1, FALSE);
    g_assert_cmpint(result.n_views, ==, N_VIEWS);
    g_assert_cmpint(result.n_lights, ==, N_LIGHTS);
    g_assert_cmpint(result.n_mdf_views, ==, N_VIEWS);
    g_assert_cmpfloat(result.mdf_coverage, ==, 1);
    check_btf(fixture);
    fixture_check_mdf(fixture);
    check_eigenmaps(fixture, result.eigenmaps_error);
    g_autoptr(Session) session = session_open(fixture->path, SESSION_READ, NULL);
    g_autofree char *said = session_value(session, "eigenmaps_error");
    g_assert_cmpfloat(g_ascii_strtod(said, NULL), ==, result.eigenmaps_error);
    g_autofree char *coverage = session_value(session, "mdf_coverage");
    g_assert_cmpfloat(g_ascii_strtod(coverage, NULL), ==, 1);
}

static void test_threads(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 0, fixture->n_shots, NULL);
    fixture_process(fixture, 1, FALSE);
    g_autofree char *one = hash_products(fixture), *products = fixture_product(fixture, NULL);
    remove_tree(products);
    fixture_process(fixture, 4, FALSE);
    g_autofree char *four = hash_products(fixture);
    g_assert_cmpstr(one, ==, four);
}

static gint64 inode_of(const struct fixture *fixture, const char *name) {
    g_autofree char *path = fixture_product(fixture, name);
    GStatBuf status;
    g_assert_cmpint(g_stat(path, &status), ==, 0);
    return (gint64)status.st_ino;
}

/* What is up to date stays; what is not there, damaged, or of other frames is made again. */
static void test_again(struct fixture *fixture, gconstpointer unused) {
    static const char *const names[] = {"btf/view_0000.exr", "btf/view_0001.exr",
                                        "btf/view_0002.exr", "mdf.exr", "eigenmaps.exr"};
    gint64 before[G_N_ELEMENTS(names)];
    fixture_capture(fixture, 0, fixture->n_shots, NULL);
    struct pipeline_result first = fixture_process(fixture, 2, FALSE);
    for (guint i = 0; i < G_N_ELEMENTS(names); i++)
        before[i] = inode_of(fixture, names[i]);
    struct pipeline_result second = fixture_process(fixture, 2, FALSE);
    g_assert_cmpmem(&first, sizeof first, &second, sizeof second);
    for (guint i = 0; i < G_N_ELEMENTS(names); i++)
        g_assert_cmpint(inode_of(fixture, names[i]), ==, before[i]);

    g_autofree char *hash = hash_products(fixture), *gone = fixture_product(fixture, names[1]);
    g_autofree char *cut = fixture_product(fixture, names[0]),
                    *mdf = fixture_product(fixture, names[3]);
    g_unlink(gone);
    g_assert_true(g_file_set_contents(cut, "v/1\1", 4, NULL));
    g_assert_true(g_file_set_contents(mdf, "", 0, NULL));
    fixture_process(fixture, 2, FALSE);
    g_autofree char *again = hash_products(fixture);
    g_assert_cmpstr(hash, ==, again);
    g_assert_cmpint(inode_of(fixture, names[2]), ==, before[2]);

    fixture_capture(fixture, 0, 1, NULL); /* the same picture once more */
    fixture_process(fixture, 2, FALSE);
    g_assert_cmpint(inode_of(fixture, names[2]), ==, before[2]);
}

static void brighter(struct exr_part *part, const struct session_shot *shot) {
    for (int i = 0; i < SIDE * SIDE; i++)
        part->planes[0][i] *= 1.1f;
}

static void test_retaken(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 0, fixture->n_shots, brighter);
    fixture_process(fixture, 2, FALSE);
    gint64 other = inode_of(fixture, "btf/view_0002.exr");
    fixture_capture(fixture, 0, N_LIGHTS, NULL); /* the lights of turn 0 */
    fixture_process(fixture, 2, FALSE);
    g_assert_cmpint(inode_of(fixture, "btf/view_0002.exr"), ==, other);
    fixture_capture(fixture, N_LIGHTS + N_LASERS, fixture->n_shots, NULL);
    fixture_process(fixture, 2, FALSE);
    check_btf(fixture);
}

static void test_missing(struct fixture *fixture, gconstpointer unused) {
    fixture_process_fails(fixture, DATA_ERROR_INCOMPLETE, "4 of 4 views");
    fixture_capture(fixture, 0, N_LIGHTS + N_LASERS, NULL);
    fixture_process_fails(fixture, DATA_ERROR_INCOMPLETE, "2 of 4 views");
    fixture_set_state(fixture, "aborted");
    struct pipeline_result result = fixture_process(fixture, 2, TRUE);
    g_assert_cmpint(result.n_views, ==, 2);
    g_assert_cmpint(result.n_mdf_views, ==, 2);
    /* The rest comes later; what there was stays. */
    gint64 before = inode_of(fixture, "btf/view_0001.exr");
    fixture_capture(fixture, N_LIGHTS + N_LASERS, fixture->n_shots, NULL);
    result = fixture_process(fixture, 2, TRUE);
    g_assert_cmpint(result.n_views, ==, 4);
    g_assert_cmpint(inode_of(fixture, "btf/view_0001.exr"), ==, before);
    check_btf(fixture);
    fixture_check_mdf(fixture);
}

/* A view without any picture of a lamp waits for them, also if all sweeps are there. */
static void test_no_lamps(struct fixture *fixture, gconstpointer unused) {
    for (int i = 0; i < fixture->n_shots; i++)
        if (fixture->shots[i].kind == SHOT_SWEEP)
            fixture_capture(fixture, i, i + 1, NULL);
    fixture_process_fails(fixture, DATA_ERROR_INCOMPLETE, "4 of 4 views lack some of their frames");
}

/* The last report of each stage, by its name: done and total. */
static void keep_last(const struct work_progress *progress, gpointer data) {
    g_hash_table_insert(data, g_strdup(progress->stage),
                        g_strdup_printf("%d/%d", progress->done, progress->total));
}

/* What the plan leaves out is no part of a stage: its progress ends with all of it. */
static void test_skipped(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 1, fixture->n_shots - 1, NULL);
    g_autoptr(Session) session = session_open(fixture->path, SESSION_CAPTURE, NULL);
    for (int i = 0; i < 2; i++)
        g_assert_true(session_commit_shot(session, i ? fixture->n_shots : 1, SHOT_SKIPPED, NULL, 0,
                                          "the arc stands in the way", NULL));
    g_clear_pointer(&session, session_close);
    g_autoptr(GHashTable) last = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
    const struct pipeline_options options = {
        .n_eigenmaps = 2, .work.progress = keep_last, .work.data = last};
    struct pipeline_result result;
    ok(pipeline_run(fixture->path, &options, &result, ERR));
    g_assert_cmpstr(g_hash_table_lookup(last, "btf"), ==, "2/2");
    g_assert_cmpstr(g_hash_table_lookup(last, "mdf"), ==, "4/4");
    g_assert_cmpint(result.n_views, ==, 2); /* a light is missing in two */
    g_assert_cmpint(result.n_mdf_views, ==, 4);
    fixture_check_mdf(fixture);
}

/* Of a picture left out on purpose: predicted from all views, with error bars, and the same in the
 * next run, which makes nothing. */
static void check_left_out(const struct fixture *fixture, const char *name, int light) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = fixture_product(fixture, name);
    g_autofree char *part_name = g_strdup_printf("light_%04d", light);
    g_autoptr(ExrPart) part = exr_read_part(path, part_name, &error);
    g_assert_no_error(error);
    const float *const rgb[3] = {exr_part_plane(part, "R"), exr_part_plane(part, "G"),
                                 exr_part_plane(part, "B")};
    const float *mark = exr_part_plane(part, "mark"), *sigma = exr_part_plane(part, "sigma");
    double theta_deg = 0;
    g_assert_true(exr_get_double(part, "light.theta_deg", &theta_deg, NULL));
    g_assert_nonnull(mark);
    g_assert_nonnull(sigma);
    for (int i = 0; i < TEXELS * TEXELS; i++) {
        g_assert_cmpfloat(mark[i], ==, BTF_FLAG_PREDICTED);
        g_assert_cmpfloat(sigma[i], >, 0);
        for (int c = 0; c < 3; c++) /* the exact θ of a texel differs by 2° at most */
            g_assert_cmpfloat_with_epsilon((double)rgb[c][i], albedo[c] * cos(theta_deg * DEGREE),
                                           0.05 * albedo[c]);
    }
}

static void test_left_out(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 0, 1, NULL);
    fixture_capture(fixture, 2, fixture->n_shots, NULL);
    g_assert_cmpint(fixture->shots[1].kind, ==, SHOT_LAMP);
    g_autoptr(Session) session = session_open(fixture->path, SESSION_CAPTURE, NULL);
    g_assert_true(session_commit_shot(session, fixture->shots[1].id, SHOT_SKIPPED, NULL, 0,
                                      SESSION_LEFT_OUT " it can be predicted", NULL));
    g_clear_pointer(&session, session_close);
    const struct pipeline_result result = fixture_process(fixture, 2, FALSE);
    g_assert_cmpint(result.n_views, ==, 4); /* more than a tenth is missing, on purpose */
    g_assert_cmpint(result.n_predicted, ==, N_CAMERAS);
    g_assert_cmpint(result.n_left_out, ==, N_CAMERAS);
    g_assert_cmpfloat(result.prediction_error, <, 0.05);
    g_assert_cmpfloat(result.prediction_error, >, 0);
    for (int view = 0, n = 0; view < N_VIEWS; view++) {
        g_autofree char *name = g_strdup_printf("btf/view_%04d.exr", view);
        g_autofree char *path = fixture_product(fixture, name);
        g_autoptr(ExrFile) file = exr_read_headers(path, NULL);
        for (guint k = 0; k < file->parts->len; k++) {
            int left_out = 0;
            exr_get_int(g_ptr_array_index(file->parts, k), "mesorig.left_out", &left_out, NULL);
            n += left_out;
            if (left_out)
                check_left_out(fixture, name, (int)k);
        }
        g_assert_cmpint(n, <=, N_CAMERAS);
    }
    g_autofree char *path = fixture_product(fixture, "btf/view_0000.exr");
    g_autofree char *before = exr_sha256(path, NULL, NULL);
    const struct pipeline_result again = fixture_process(fixture, 1, FALSE);
    g_autofree char *after = exr_sha256(path, NULL, NULL);
    g_assert_cmpstr(before, ==, after);
    g_assert_cmpfloat(again.prediction_error, ==, result.prediction_error);
}

struct follower {
    struct fixture *fixture;
    int reports;
};

static gpointer capture_slowly(gpointer data) {
    struct fixture *fixture = data;
    for (int i = 0; i < fixture->n_shots; i += 4) {
        g_usleep(100000);
        fixture_capture(fixture, i, MIN(i + 4, fixture->n_shots), NULL);
    }
    return NULL;
}

static void count_reports(const struct work_progress *progress, gpointer data) {
    struct follower *follower = data;
    g_assert_cmpint(progress->done, <=, progress->total);
    g_assert_true(progress->left_s >= 0 || progress->left_s == -1);
    follower->reports++;
}

static void test_follow(struct fixture *fixture, gconstpointer unused) {
    struct follower follower = {fixture, 0};
    struct pipeline_options options = {
        .n_eigenmaps = 2, .follow = TRUE, .work.progress = count_reports, .work.data = &follower};
    struct pipeline_result result;
    fixture_set_state(fixture, "running");
    GThread *thread = g_thread_new("capture", capture_slowly, fixture);
    ok(pipeline_run(fixture->path, &options, &result, ERR));
    g_thread_join(thread);
    g_assert_cmpint(result.n_views, ==, N_VIEWS);
    g_assert_cmpint(follower.reports, >=, 3 * N_VIEWS);
    check_btf(fixture);
    fixture_check_mdf(fixture);
}

static gpointer cancel_soon(gpointer data) {
    g_usleep(300000);
    g_cancellable_cancel(data);
    return NULL;
}

static void test_cancel(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    struct pipeline_options options = {
        .n_eigenmaps = 2, .follow = TRUE, .work.cancellable = cancellable};
    struct pipeline_result result;
    GThread *thread = g_thread_new("cancel", cancel_soon, cancellable);
    g_assert_false(pipeline_run(fixture->path, &options, &result, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    g_thread_join(thread);
    g_clear_error(&error);
    fixture_capture(fixture, 0, fixture->n_shots, NULL);
    g_assert_false(pipeline_run(fixture->path, &options, &result, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
}

static void test_damaged(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 0, fixture->n_shots, NULL);
    for (int kind = 0; kind < 2; kind++) {
        const struct session_shot *shot = &fixture->shots[kind ? N_LIGHTS : 1];
        g_autofree char *relative = session_frame_path(shot, "cam50"), *bytes = NULL;
        g_autofree char *path = g_build_filename(fixture->path, relative, NULL);
        gsize length;
        g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
        g_assert_true(g_file_set_contents(path, bytes, (gssize)length / 2, NULL));
        fixture_process_fails(fixture, DATA_ERROR_INVALID, relative);
        bytes[length / 2] ^= 1;
        g_assert_true(g_file_set_contents(path, bytes, (gssize)length, NULL));
        fixture_process_fails(fixture, DATA_ERROR_INVALID, "SHA-256");
        g_unlink(path);
        fixture_process_fails(fixture, DATA_ERROR_INVALID, relative);
        bytes[length / 2] ^= 1;
        g_assert_true(g_file_set_contents(path, bytes, (gssize)length, NULL));
    }
    fixture_process(fixture, 2, FALSE);
    check_btf(fixture);
    fixture_check_mdf(fixture);
}

static void other_sweep(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind == SHOT_SWEEP && shot->id == N_LIGHTS + 1)
        exr_set_double(part, "sweep.from_deg", -5);
}

static void other_shot(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind == SHOT_LAMP)
        exr_set_int(part, "mesorig.shot", 77);
}

static void test_mixed_up(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 0, fixture->n_shots, other_shot);
    fixture_process_fails(fixture, DATA_ERROR_INVALID, "77");
    fixture_capture(fixture, 0, fixture->n_shots, other_sweep);
    fixture_process_fails(fixture, DATA_ERROR_INVALID, "000004");
    /* A picture of another camera. */
    fixture_capture(fixture, 0, fixture->n_shots, NULL);
    struct exr_part *part =
        exr_part_new("radiance", 8, 8, (const char *const[]){"Y", NULL}, EXR_HALF);
    struct session_frame frames[2] = {fixture_write_frame(fixture, part, &fixture->shots[0], 0)};
    g_autoptr(Session) session = session_open(fixture->path, SESSION_CAPTURE, NULL);
    part = lamp_frame(&fixture->shots[0], 1);
    frames[1] = fixture_write_frame(fixture, part, &fixture->shots[0], 1);
    session_commit_shot(session, 1, SHOT_DONE, frames, 2, NULL, NULL);
    g_clear_pointer(&session, session_close);
    fixture_process_fails(fixture, DATA_ERROR_INVALID, "8 × 8");
    for (int i = 0; i < 2; i++) {
        g_free(frames[i].path);
        g_free(frames[i].sha256);
    }
}

static void test_no_session(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(GError) error = NULL;
    struct pipeline_options options = {.n_eigenmaps = 2};
    struct pipeline_result result;
    g_assert_false(pipeline_run(fixture->folder, &options, &result, &error));
    g_assert_nonnull(error);
}

int main(int argc, char **argv) {
    static const struct pipeline_test tests[] = {
        {"/pipeline/whole", test_whole},           {"/pipeline/threads", test_threads},
        {"/pipeline/again", test_again},           {"/pipeline/retaken", test_retaken},
        {"/pipeline/missing", test_missing},       {"/pipeline/skipped", test_skipped},
        {"/pipeline/left-out", test_left_out},     {"/pipeline/follow", test_follow},
        {"/pipeline/no-lamps", test_no_lamps},     {"/pipeline/cancel", test_cancel},
        {"/pipeline/damaged", test_damaged},       {"/pipeline/mixed-up", test_mixed_up},
        {"/pipeline/no-session", test_no_session},
    };
    return fixture_run_tests(argc, argv, tests, G_N_ELEMENTS(tests));
}
