/* A long computation that is cancelled or killed: it continues later, and its result is the same
 * bit for bit. */
#include "exr/checkpoint.h"

#include "btf/btf_checkpoint.h"
#include "codecs/lpca/lpca_choose.h"
#include "codecs/lpca/lpca_pack.h"
#include "lib/lpca_fixture.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#define PERIOD_S 20 /* as without checkpoint_set_period() */

struct fixture {
    char *dir, *path;
    struct btf_matrix *btf;
};

static void set_up(struct fixture *fixture, gconstpointer unused) {
    fixture->dir = g_dir_make_tmp("mesorig-checkpoint-XXXXXX", NULL);
    fixture->path = g_build_filename(fixture->dir, "lpca.exr.checkpoint", NULL);
    fixture->btf = lpca_fixture_mixture(36, 31, 5, 7, 6, 7, 0.05);
}

static void tear_down(struct fixture *fixture, gconstpointer unused) {
    g_unlink(fixture->path);
    g_assert_cmpint(g_rmdir(fixture->dir), ==, 0);
    btf_matrix_free(fixture->btf);
    g_free(fixture->path);
    g_free(fixture->dir);
}

static void assert_note(const struct fixture *fixture, const char *what, const char *has) {
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(fixture->path);
    btf_checkpoint_begin(checkpoint, fixture->btf, what);
    if (!has) {
        g_assert_null(checkpoint_note(checkpoint));
        return;
    }
    g_assert_nonnull(strstr(checkpoint_note(checkpoint), fixture->path));
    g_assert_nonnull(strstr(checkpoint_note(checkpoint), has));
}

static void save_two(const struct fixture *fixture, const double *values, const int *flags) {
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(fixture->path);
    btf_checkpoint_begin(checkpoint, fixture->btf, "work");
    checkpoint_keep_flags(checkpoint, "flags", flags, 5);
    checkpoint_keep(checkpoint, "values", values, sizeof(double) * 3);
    checkpoint_save(checkpoint);
}

/* Every byte comes back, also what as a float is not a number; sizes are asked. */
static void test_file(struct fixture *fixture, gconstpointer unused) {
    const double values[3] = {G_PI, -0.0, 1e300};
    const int flags[5] = {1, 0, 1, 1, 0};
    assert_note(fixture, "work", NULL);
    save_two(fixture, values, flags);
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(fixture->path);
    btf_checkpoint_begin(checkpoint, fixture->btf, "work");
    btf_checkpoint_begin(checkpoint, fixture->btf, "other work, of which the first call knows");
    g_assert_nonnull(strstr(checkpoint_note(checkpoint), "going on"));
    g_assert_cmpmem(checkpoint_get(checkpoint, "values", sizeof values), sizeof values, values,
                    sizeof values);
    g_assert_cmpmem(checkpoint_get(checkpoint, "flags", sizeof flags), sizeof flags, flags,
                    sizeof flags);
    g_assert_null(checkpoint_get(checkpoint, "values", sizeof values - 8));
    g_assert_null(checkpoint_get(checkpoint, "more", 4));
    checkpoint_remove(checkpoint);
    g_assert_null(checkpoint_get(checkpoint, "values", sizeof values));
    g_assert_false(g_file_test(fixture->path, G_FILE_TEST_EXISTS));
}

/* Work that failed for good takes its own file with it, and no other's. */
static void test_discarded(struct fixture *fixture, gconstpointer unused) {
    const double values[3] = {1, 2, 3};
    const int flags[5] = {0};
    save_two(fixture, values, flags);
    g_autoptr(Checkpoint) other = checkpoint_new(fixture->path);
    btf_checkpoint_begin(other, fixture->btf, "other work");
    checkpoint_discard(other);
    g_assert_true(g_file_test(fixture->path, G_FILE_TEST_EXISTS));
    g_autoptr(Checkpoint) same = checkpoint_new(fixture->path);
    btf_checkpoint_begin(same, fixture->btf, "work");
    checkpoint_discard(same);
    g_assert_false(g_file_test(fixture->path, G_FILE_TEST_EXISTS));
    checkpoint_keep(other, "values", values, sizeof values);
    checkpoint_save(other);
    g_assert_true(g_file_test(fixture->path, G_FILE_TEST_EXISTS));
    checkpoint_discard(other);
    g_assert_false(g_file_test(fixture->path, G_FILE_TEST_EXISTS));
}

/* Of something else, or damaged in any way, it counts as nothing, and that is said. */
static void test_refused(struct fixture *fixture, gconstpointer unused) {
    const double values[3] = {1, 2, 3};
    const int flags[5] = {0};
    g_autofree char *bytes = NULL;
    gsize size;
    save_two(fixture, values, flags);
    assert_note(fixture, "work", "going on");
    assert_note(fixture, "other work", "of other options");
    fixture->btf->values[7] += 1e-3F;
    assert_note(fixture, "work", "of another BTF");
    fixture->btf->values[7] -= 1e-3F;
    fixture->btf->layout.lights.phi_deg[1] += 1;
    assert_note(fixture, "work", "of another BTF");
    fixture->btf->layout.lights.phi_deg[1] -= 1;
    g_assert_true(g_file_get_contents(fixture->path, &bytes, &size, NULL));
    g_assert_true(g_file_set_contents(fixture->path, bytes, (gssize)size / 2, NULL));
    assert_note(fixture, "work", "starting from the beginning");
    char *two = memmem(bytes, size, &values[1], sizeof *values);
    g_assert_nonnull(two);
    two[6] ^= 1;
    g_assert_true(g_file_set_contents(fixture->path, bytes, (gssize)size, NULL));
    assert_note(fixture, "work", "is damaged");
    g_assert_true(g_file_set_contents(fixture->path, "not this", -1, NULL));
    assert_note(fixture, "work", "starting from the beginning");
}

/* Cancels, or kills the process, at the stage's at-th word of progress. */
struct interrupt {
    const char *stage;
    int at, heard;
    gboolean kill;
    GCancellable *cancellable;
};

static void interrupt(const struct work_progress *progress, gpointer data) {
    struct interrupt *interrupt = data;
    if (strcmp(progress->stage, interrupt->stage) != 0 || ++interrupt->heard != interrupt->at)
        return;
    if (interrupt->kill)
        kill(getpid(), SIGKILL);
    g_cancellable_cancel(interrupt->cancellable);
}

typedef struct lpca *(*Work)(const struct btf_matrix *btf, struct lpca_options *options,
                             GError **error);

static struct lpca *plain(const struct btf_matrix *btf, struct lpca_options *options,
                          GError **error) {
    options->n_clusters = 6;
    options->n_components = 5;
    return lpca_compute(btf, options, error);
}

static struct lpca *logarithms(const struct btf_matrix *btf, struct lpca_options *options,
                               GError **error) {
    options->colours = LPCA_LOG;
    return plain(btf, options, error);
}

/* Only what is to be packed is weighed once more. */
static struct lpca *weighed(const struct btf_matrix *btf, struct lpca_options *options,
                            GError **error) {
    options->to_pack = TRUE;
    return plain(btf, options, error);
}

static struct lpca *to_target(const struct btf_matrix *btf, struct lpca_options *options,
                              GError **error) {
    options->n_clusters = 6;
    options->n_components = 16;
    options->target = 0.1;
    return lpca_compute(btf, options, error);
}

static struct lpca *choose(const struct btf_matrix *btf, struct lpca_options *options,
                           GError **error) {
    const struct lpca_target wanted = {0.15, 0, 16, LPCA_HALF, 0};
    return lpca_choose(btf, options, &wanted, error);
}

static struct lpca *pack(const struct btf_matrix *btf, struct lpca_options *options,
                         GError **error) {
    const struct lpca_target wanted = {.error = 0.1};
    return lpca_pack(btf, options, &wanted, error);
}

/* Works with the fixture's checkpoint until the stage's at-th word of progress (−1: to the end). */
static struct lpca *attempt(const struct fixture *fixture, Work work, const char *stage, int at,
                            int n_threads, double period_s, GError **error) {
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(fixture->path);
    struct interrupt cut = {stage, at, 0, FALSE, cancellable};
    struct lpca_options options = {.work.n_threads = n_threads,
                                   .work.progress = interrupt,
                                   .work.data = &cut,
                                   .work.cancellable = cancellable,
                                   .checkpoint = checkpoint};
    const gboolean going_on = g_file_test(fixture->path, G_FILE_TEST_EXISTS);
    checkpoint_set_period(checkpoint, period_s);
    struct lpca *lpca = work(fixture->btf, &options, error);
    if (going_on)
        g_assert_nonnull(strstr(checkpoint_note(checkpoint), "going on"));
    g_test_message("%s, %d: %d words", stage, at, cut.heard);
    return lpca;
}

static struct lpca *without_cuts(const struct fixture *fixture, Work work) {
    struct lpca_options options = {.work.n_threads = 1};
    struct lpca *whole = work(fixture->btf, &options, NULL);
    g_assert_nonnull(whole);
    return whole;
}

static void assert_same_result(struct lpca *lpca, const struct lpca *whole) {
    lpca_fixture_assert_same(lpca, whole);
    g_assert_true(lpca->error == whole->error);
    lpca_free(lpca);
}

/* Cuts each run off at its at-th word of a stage, until one comes to its end. */
static void check(const struct fixture *fixture, Work work, const char *stage, int at) {
    struct lpca *whole = without_cuts(fixture, work), *pieces = NULL;
    int runs = 0;
    for (; !pieces; runs++) {
        g_autoptr(GError) error = NULL;
        g_assert_cmpint(runs, <, 199);
        g_assert_cmpint(g_file_test(fixture->path, G_FILE_TEST_EXISTS), ==, runs > 0);
        pieces = attempt(fixture, work, stage, at, 2, 0, &error);
        if (!pieces)
            g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    }
    g_test_message("%s, %d: %d runs", stage, at, runs);
    g_assert_cmpint(runs, >, 1);
    assert_same_result(pieces, whole);
    lpca_free(whole);
    g_unlink(fixture->path);
}

static void test_cancelled(struct fixture *fixture, gconstpointer unused) {
    check(fixture, plain, "cluster", 2);
    check(fixture, plain, "cluster", 3);
    check(fixture, logarithms, "cluster", 4);
    check(fixture, to_target, "cluster", 7);
    check(fixture, choose, "cluster", 9);
}

/* One word a stage, at its end, is heard for certain: of that word a run is cut off once. */
static void check_once(const struct fixture *fixture, Work work, const char *stage, int at) {
    struct lpca *whole = without_cuts(fixture, work);
    g_assert_null(attempt(fixture, work, stage, at, 0, PERIOD_S, NULL));
    struct lpca *rest = attempt(fixture, work, stage, -1, 0, PERIOD_S, NULL);
    g_assert_nonnull(rest);
    assert_same_result(rest, whole);
    lpca_free(whole);
    g_unlink(fixture->path);
}

static void test_stages(struct fixture *fixture, gconstpointer unused) {
    check_once(fixture, plain, "reduce", 1);
    check_once(fixture, plain, "refine", 1);
    check_once(fixture, weighed, "refine", 1);
    check_once(fixture, weighed, "weights", 1);
    check_once(fixture, pack, "weights", 1);
    check_once(fixture, logarithms, "check", 1);
    check_once(fixture, to_target, "check", 1);
    check_once(fixture, choose, "refine", 9);
    check_once(fixture, pack, "reduce", 1);
    check_once(fixture, pack, "check", 2);
}

static gpointer copy_of(const Checkpoint *checkpoint, const char *name, gsize size) {
    gconstpointer found = checkpoint_get(checkpoint, name, size);
    g_assert_nonnull(found);
    return g_memdup2(found, size);
}

/* Views' columns are 21 of 105; squares are six doubles a view, as 12 floats. */
static gboolean is_undone(const char *name, gsize at) {
    if (strcmp(name, "lpca.brdfs") == 0)
        return at % 105 / 21 % 2 == 1;
    if (strcmp(name, "lpca.squares") == 0)
        return at / 12 % 2 == 1;
    return at / 5 >= 1024;
}

static void spoil(const char *name, float *values, gsize size) {
    for (gsize at = 0; at < size / sizeof *values; at++)
        if (is_undone(name, at))
            values[at] = 3;
}

/* A stage that was cut off in its middle, where blocks that are not done hold anything. */
static void undo(const struct fixture *fixture, int to_pack, int n_blocks,
                 const char *const spoiled[]) {
    static const char *const all[] = {"lpca.state",   "lpca.mean",  "lpca.rows",
                                      "lpca.labels",  "lpca.brdfs", "lpca.weights",
                                      "lpca.squares", "lpca.means", "lpca.bases"};
    g_autofree char *what = g_strdup_printf("lpca 6 × 5, colours 0, %d, error 0", to_pack);
    guint n_spoiled = 0;
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(fixture->path);
    g_autoptr(GPtrArray) copies = g_ptr_array_new_with_free_func(g_free);
    btf_checkpoint_begin(checkpoint, fixture->btf, what);
    g_assert_nonnull(strstr(checkpoint_note(checkpoint), "going on"));
    g_autofree int *done = copy_of(checkpoint, "lpca.blocks", sizeof(int) * (gsize)n_blocks);
    for (int i = 0; i < n_blocks; i++) {
        g_assert_cmpint(done[i], ==, 1);
        done[i] = i % 2 == 0;
    }
    checkpoint_keep_flags(checkpoint, "lpca.blocks", done, n_blocks);
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++)
        for (gsize bytes = 4; bytes < 1 << 20; bytes += 4) {
            if (!checkpoint_get(checkpoint, all[i], bytes))
                continue;
            char *copy = copy_of(checkpoint, all[i], bytes);
            g_ptr_array_add(copies, copy);
            if (g_strv_contains(spoiled, all[i])) {
                spoil(all[i], (float *)(gpointer)copy, bytes);
                n_spoiled++;
            }
            checkpoint_keep(checkpoint, all[i], copy, bytes);
            break;
        }
    g_assert_cmpuint(n_spoiled, ==, g_strv_length((char **)(gpointer)spoiled));
    checkpoint_save(checkpoint);
}

static void check_middle(const struct fixture *fixture, Work work, const char *stage, int n_blocks,
                         const char *const spoiled[]) {
    struct lpca_options options = {.work.n_threads = 1};
    struct lpca *whole = work(fixture->btf, &options, NULL);
    g_assert_null(attempt(fixture, work, stage, 1, 1, PERIOD_S, NULL));
    undo(fixture, options.to_pack, n_blocks, spoiled);
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(fixture->path);
    options.checkpoint = checkpoint;
    assert_same_result(work(fixture->btf, &options, NULL), whole);
    lpca_free(whole);
    checkpoint_remove(checkpoint);
}

static void test_middle(struct fixture *fixture, gconstpointer unused) {
    static const char *const views[] = {"lpca.brdfs", "lpca.squares", NULL};
    static const char *const weights[] = {"lpca.weights", NULL};
    check_middle(fixture, plain, "refine", 5, views);
    check_middle(fixture, weighed, "refine", 5, views);
    check_middle(fixture, weighed, "weights", 2, weights);
}

/* In a process of its own, which is killed. */
static void work_and_die(const struct fixture *fixture) {
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(g_getenv("MESORIG_TEST_PATH"));
    struct interrupt cut = {g_getenv("MESORIG_TEST_STAGE"), 1, 0, TRUE, NULL};
    struct lpca_options options = {.work.n_threads = 2,
                                   .work.progress = interrupt,
                                   .work.data = &cut,
                                   .checkpoint = checkpoint};
    if (strcmp(cut.stage, "cluster") == 0)
        cut.at = 5;
    checkpoint_set_period(checkpoint, 0);
    weighed(fixture->btf, &options, NULL);
    g_assert_not_reached();
}

static void test_killed(struct fixture *fixture, gconstpointer unused) {
    static const char *const stages[] = {"cluster", "refine", "weights"};
    struct lpca_options options = {.work.n_threads = 1};
    if (g_test_subprocess()) {
        work_and_die(fixture);
        return;
    }
    struct lpca *whole = weighed(fixture->btf, &options, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(stages); i++) {
        g_setenv("MESORIG_TEST_PATH", fixture->path, TRUE);
        g_setenv("MESORIG_TEST_STAGE", stages[i], TRUE);
        g_test_trap_subprocess(NULL, 60 * G_USEC_PER_SEC, G_TEST_SUBPROCESS_DEFAULT);
        g_assert_false(g_test_trap_has_passed());
        g_autoptr(Checkpoint) checkpoint = checkpoint_new(fixture->path);
        options.checkpoint = checkpoint;
        struct lpca *rest = weighed(fixture->btf, &options, NULL);
        g_assert_nonnull(strstr(checkpoint_note(checkpoint), "going on"));
        assert_same_result(rest, whole);
        checkpoint_remove(checkpoint);
    }
    lpca_free(whole);
}

int main(int argc, char **argv) {
    static const struct {
        const char *name;
        void (*func)(struct fixture *fixture, gconstpointer unused);
    } tests[] = {
        {"/checkpoint/file", test_file},       {"/checkpoint/discarded", test_discarded},
        {"/checkpoint/refused", test_refused}, {"/checkpoint/cancelled", test_cancelled},
        {"/checkpoint/stages", test_stages},   {"/checkpoint/middle", test_middle},
        {"/checkpoint/killed", test_killed},
    };
    g_test_init(&argc, &argv, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(tests); i++)
        g_test_add(tests[i].name, struct fixture, NULL, set_up, tests[i].func, tear_down);
    return g_test_run();
}
