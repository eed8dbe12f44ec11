/* Programs that write the same file at the same time, and symbolic links in the places of output
 * files: in the end the file is complete, a program that could not write it says so, and nothing
 * outside is changed. */
#include <glib/gstdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file_lock.h"
#include "base/new_file.h"
#include "exr/exr.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/test.h"

#define MESORIG BUILD_DIR "/bin/mesorig"
#define PAIRS   20 /* MESORIG_PAIRS in the environment: more */
#define SEED    20261122

static int pairs(void) {
    const char *asked = g_getenv("MESORIG_PAIRS");
    return asked ? atoi(asked) : PAIRS;
}

static struct operation *captured(void) {
    struct operation *run = operator_new(NULL);
    operator_captures(run, 0);
    return run;
}

static char *sum(const char *path) {
    char *sha256 = ok(exr_sha256(path, NULL, ERR));
    return sha256;
}

static GSubprocess *spawn(const char *const *argv) {
    GSubprocess *child = ok(g_subprocess_newv(
        argv, G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_PIPE, ERR));
    return child;
}

/* Its exit code: 0, or 1 if it names the process that was first. */
static int end(GSubprocess *child, const char *other) {
    g_autoptr(GError) error = NULL;
    g_autofree char *said = NULL;
    g_assert_true(g_subprocess_communicate_utf8(child, NULL, NULL, NULL, &said, &error));
    g_assert_true(g_subprocess_get_if_exited(child));
    const int code = g_subprocess_get_exit_status(child);
    if (code == 0)
        return 0;
    g_autofree char *holder = g_strdup_printf(": process %s is writing ", other);
    assert_has(said, holder);
    g_assert_cmpint(code, ==, 1);
    return 1;
}

/* Two at the same time, the second a little later; how many said that they were done. */
static int run_pair(const char *const *first, const char *const *second, gulong later_us,
                    int codes[2]) {
    g_autoptr(GSubprocess) a = spawn(first);
    g_usleep(later_us);
    g_autoptr(GSubprocess) b = spawn(second);
    g_autofree char *id_a = g_strdup(g_subprocess_get_identifier(a));
    g_autofree char *id_b = g_strdup(g_subprocess_get_identifier(b));
    codes[0] = end(a, id_b);
    codes[1] = end(b, id_a);
    return (codes[0] == 0) + (codes[1] == 0);
}

TEST(compress) {
    struct operation *run = captured();
    g_autofree char *file = g_build_filename(run->session, "products", "same.exr", NULL);
    const char *const a[] = {MESORIG, "compress", run->session,   "-o", file,
                             "-k",    "2",        "--components", "2",  NULL};
    const char *const b[] = {MESORIG, "compress", run->session,   "-o", file,
                             "-k",    "3",        "--components", "4",  NULL};
    g_autoptr(GRand) random = g_rand_new_with_seed(SEED);
    int codes[2], refused = 0;
    operator_does(run, 0, "process", run->session, NULL);
    operator_does(run, 0, "compress", run->session, "-o", file, "-k", "2", "--components", "2",
                  NULL);
    g_autofree char *sum_a = sum(file);
    operator_does(run, 0, "compress", run->session, "-o", file, "-k", "3", "--components", "4",
                  NULL);
    g_autofree char *sum_b = sum(file);
    g_assert_cmpstr(sum_a, !=, sum_b);
    for (int i = 0; i < pairs(); i++) {
        g_unlink(file);
        const int done = run_pair(a, b, (gulong)g_rand_int_range(random, 0, 20000), codes);
        g_assert_cmpint(done, >=, 1);
        refused += 2 - done;
        g_autofree char *is = sum(file);
        if (done == 2)
            g_assert_true(g_str_equal(is, sum_a) || g_str_equal(is, sum_b));
        else
            g_assert_cmpstr(is, ==, codes[0] == 0 ? sum_a : sum_b);
        operator_does(run, 0, "verify", run->session, NULL);
    }
    g_test_message("%d pairs of compress, %d refused", pairs(), refused);
    g_assert_cmpint(refused, >, 0);
    operator_free(run);
}

static void remove_products(const struct operation *run) {
    static const char *const folders[] = {"products", "products/btf"};
    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++) {
        g_autofree char *folder = g_build_filename(run->session, folders[i], NULL);
        g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
        for (const char *name; (name = g_dir_read_name(dir));) {
            g_autofree char *path = g_build_filename(folder, name, NULL);
            if (g_str_has_suffix(name, ".exr"))
                g_unlink(path);
        }
    }
}

TEST(process) {
    struct operation *run = captured();
    const char *const argv[] = {MESORIG, "process", run->session, NULL};
    g_autoptr(GRand) random = g_rand_new_with_seed(SEED);
    int codes[2], refused = 0;
    for (int i = 0; i < pairs(); i++) {
        remove_products(run);
        const int done = run_pair(argv, argv, (gulong)g_rand_int_range(random, 0, 40000), codes);
        g_assert_cmpint(done, >=, 1);
        refused += 2 - done;
        g_autofree char *products = operator_products(run->session);
        g_assert_cmpstr(products, ==, operator_undisturbed());
        operator_does(run, 0, "verify", run->session, NULL);
    }
    g_test_message("%d pairs of process, %d refused", pairs(), refused);
    g_assert_cmpint(refused, >, 0);
    operator_free(run);
}

/* A file outside that links lead to. */
static char *victim_of(const struct operation *run) {
    char *path = g_build_filename(run->directory, "victim", NULL);
    g_assert_true(g_file_set_contents(path, "precious", -1, NULL));
    return path;
}

static void assert_untouched(const char *victim) {
    g_autofree char *is = NULL;
    g_assert_true(g_file_get_contents(victim, &is, NULL, NULL));
    g_assert_cmpstr(is, ==, "precious");
}

/* Instead of the file, and where it used to be written. */
static void plant(const struct operation *run, const char *relative, const char *victim) {
    g_autofree char *path = g_build_filename(run->session, relative, NULL);
    g_autofree char *part = g_strconcat(path, ".part", NULL);
    g_assert_cmpint(g_unlink(path), ==, 0);
    g_assert_cmpint(symlink(victim, path), ==, 0);
    g_assert_cmpint(symlink(victim, part), ==, 0);
}

static void assert_is_file(const struct operation *run, const char *relative) {
    g_autofree char *path = g_build_filename(run->session, relative, NULL);
    GStatBuf status;
    g_assert_cmpint(g_lstat(path, &status), ==, 0);
    g_assert_true(S_ISREG(status.st_mode));
}

TEST(links) {
    static const char *const made[] = {"products/btf/view_0001.exr", "products/mdf.exr",
                                       "products/eigenmaps.exr", "products/lpca.exr"};
    struct operation *run = captured();
    g_autofree char *victim = victim_of(run);
    g_autoptr(GPtrArray) frames = g_ptr_array_new_with_free_func(g_free);
    g_autofree char *laser = g_build_filename(run->session, "laser", NULL);
    g_autoptr(GDir) dir = g_dir_open(laser, 0, NULL);
    g_ptr_array_add(frames, g_strdup("frames/000001_cam30.exr"));
    g_ptr_array_add(frames, g_strdup("frames/000002_cam30.exr"));
    g_ptr_array_add(frames, g_build_filename("laser", g_dir_read_name(dir), NULL));
    for (guint i = 0; i < frames->len; i++)
        plant(run, frames->pdata[i], victim);
    operator_does(run, 0, "resume", run->session, NULL);
    assert_untouched(victim);
    for (guint i = 0; i < frames->len; i++)
        assert_is_file(run, frames->pdata[i]);
    operator_check_products(run);
    operator_does(run, 0, "compress", run->session, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(made); i++)
        plant(run, made[i], victim);
    operator_does(run, 0, "process", run->session, NULL);
    operator_does(run, 0, "compress", run->session, NULL);
    assert_untouched(victim);
    for (gsize i = 0; i < G_N_ELEMENTS(made); i++)
        assert_is_file(run, made[i]);
    operator_free(run);
}

/* A folder of the session that leads out of it. */
TEST(linked_folders) {
    static const struct {
        const char *folder, *command;
    } cases[] = {{"frames", "resume"},
                 {"laser", "resume"},
                 {"products/btf", "process"},
                 {"products", "process"},
                 {"products", "compress"}};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct operation *run = captured();
        g_autofree char *folder = g_build_filename(run->session, cases[i].folder, NULL);
        g_autofree char *outside = g_build_filename(run->directory, "outside", NULL);
        g_assert_cmpint(g_rename(folder, outside), ==, 0);
        g_assert_cmpint(symlink(outside, folder), ==, 0);
        GStatBuf before, after;
        g_assert_cmpint(g_stat(outside, &before), ==, 0);
        operator_does(run, 1, cases[i].command, run->session, NULL);
        assert_has(run->err, folder);
        assert_has(run->err, "is a symbolic link, and nothing is written through links");
        g_assert_cmpint(g_stat(outside, &after), ==, 0);
        g_assert_cmpint(before.st_mtim.tv_nsec, ==, after.st_mtim.tv_nsec);
        operator_free(run);
    }
}

/* One that is put there while a capture runs. */
TEST(below) {
    g_autofree char *folder = g_build_filename(operator_folder(), "below", NULL);
    g_autofree char *outside = g_build_filename(operator_folder(), "below", "outside", NULL);
    g_autofree char *link = g_build_filename(folder, "frames", NULL);
    struct new_file file;
    g_assert_cmpint(g_mkdir_with_parents(outside, 0777), ==, 0);
    g_assert_cmpint(symlink(outside, link), ==, 0);
    g_assert_false(new_file_begin(&file, folder, "frames/a.exr"));
    g_assert_true(new_file_begin(&file, folder, "outside/a.exr"));
    g_assert_cmpint(write(file.fd, "a", 1), ==, 1);
    g_assert_true(new_file_commit(&file, TRUE));
    g_assert_true(new_file_begin(&file, link, "b.exr")); /* as who runs it says */
    new_file_abandon(&file);
    /* Left by a process that was killed; the names of others stay. */
    g_assert_true(new_file_begin(&file, folder, "outside/b.exr"));
    close(file.fd);
    close(file.folder);
    g_autofree char *left = g_build_filename(outside, file.beside, NULL);
    g_autofree char *others = g_build_filename(outside, "c.exr.part", NULL);
    g_assert_true(g_file_set_contents(others, "c", 1, NULL));
    new_file_remove_left(folder, "outside", "a.exr.");
    g_assert_true(g_file_test(left, G_FILE_TEST_EXISTS));
    new_file_remove_left(folder, "frames", "");
    g_assert_true(g_file_test(left, G_FILE_TEST_EXISTS));
    new_file_remove_left(folder, "outside", "b.exr.");
    g_assert_false(g_file_test(left, G_FILE_TEST_EXISTS));
    g_assert_true(g_file_test(others, G_FILE_TEST_EXISTS));
    g_free(file.name);
    g_free(file.beside);
}

TEST(lock) {
    g_autofree char *path = g_build_filename(operator_folder(), "lock", NULL);
    g_autoptr(GError) error = NULL;
    const int lock = ok(file_lock_take(path, "it", ERR));
    g_assert_true(file_lock_is_held(path));
    g_assert_cmpint(file_lock_take(path, "it", &error), ==, -1);
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_BUSY);
    g_autofree char *own = g_strdup_printf("process %ld is writing it", (long)getpid());
    assert_has(error->message, own);
    g_clear_error(&error);
    file_lock_give(lock, path);
    g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
    g_assert_false(file_lock_is_held(path));
    /* Files that a killed process has left do not prevent other writers; a link is not followed. */
    g_assert_true(g_file_set_contents(path, "1\n", -1, NULL));
    const int again = ok(file_lock_take(path, "it", ERR));
    file_lock_give(again, path);
    g_assert_cmpint(symlink("/nowhere/at-all", path), ==, 0);
    g_assert_cmpint(file_lock_take(path, "it", &error), ==, -1);
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_TOO_MANY_LINKS);
}

TESTS_RUN_BY(operator_tests);
