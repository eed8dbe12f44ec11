/* Files of a session that another program changes or removes: every command that would use such a
 * file refuses it, verify names it, and the command that the message gives makes it again, byte for
 * byte. */
#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file_lock.h"
#include "exr/exr.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/test.h"
#include "session/session.h"

#define ALL     96 /* damages in all; MESORIG_DAMAGES in the environment: more, in larger rounds */
#define DAMAGES 12 /* of a round */
#define SEED    20261122

/* One byte becomes another one; size and times stay. */
static void flip(const char *path, GRand *random) {
    struct stat status;
    const int fd = open(path, O_RDWR | O_CLOEXEC);
    guint8 byte;
    g_assert_cmpint(fd, >=, 0);
    g_assert_cmpint(fstat(fd, &status), ==, 0);
    const off_t at = (off_t)(g_rand_double(random) * (double)status.st_size);
    g_assert_cmpint(pread(fd, &byte, 1, at), ==, 1);
    byte ^= (guint8)(1 << g_rand_int_range(random, 0, 8));
    g_assert_cmpint(pwrite(fd, &byte, 1, at), ==, 1);
    const struct timespec times[] = {status.st_atim, status.st_mtim};
    g_assert_cmpint(futimens(fd, times), ==, 0);
    close(fd);
}

static void flip_in(const struct operation *run, const char *relative) {
    g_autofree char *path = g_build_filename(run->session, relative, NULL);
    g_autoptr(GRand) random = g_rand_new_with_seed(SEED);
    flip(path, random);
}

static struct operation *processed(void) {
    struct operation *run = operator_new(NULL);
    operator_captures(run, 0);
    operator_does(run, 0, "process", run->session, NULL);
    operator_does(run, 0, "compress", run->session, "-k", "2", "--components", "2", NULL);
    return run;
}

/* Every frame, sweep and product. */
static GPtrArray *files_of(const struct operation *run) {
    static const char *const folders[] = {"frames", "laser", "products", "products/btf"};
    GPtrArray *files = g_ptr_array_new_with_free_func(g_free);
    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++) {
        g_autofree char *folder = g_build_filename(run->session, folders[i], NULL);
        g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
        for (const char *name; (name = g_dir_read_name(dir));)
            if (g_str_has_suffix(name, ".exr"))
                g_ptr_array_add(files, g_build_filename(folders[i], name, NULL));
    }
    return files;
}

/* Runs what verify says repairs, in its order. */
static void repair(struct operation *run) {
    g_auto(GStrv) lines = g_strsplit(run->out, "\n", -1);
    int n = 0;
    for (char **line = lines; *line; line++) {
        g_auto(GStrv) argv = NULL;
        g_autoptr(GError) error = NULL;
        if (!g_str_has_prefix(*line, "to repair "))
            continue;
        g_assert_true(g_shell_parse_argv(*line + strlen("to repair "), NULL, &argv, &error));
        const guint count = g_strv_length(argv);
        g_assert_cmpstr(argv[0], ==, "mesorig");
        g_assert_cmpuint(count, <=, 6);
        operator_does(run, 0, argv[1], argv[2], count > 3 ? argv[3] : NULL,
                      count > 4 ? argv[4] : NULL, count > 5 ? argv[5] : NULL, NULL);
        n++;
    }
    g_assert_cmpint(n, >, 0);
}

static void check_whole(struct operation *run, const char *products) {
    operator_does(run, 0, "verify", run->session, NULL);
    assert_has(run->out, "files of frames: 26, of products: ");
    assert_has(run->out, "0 are damaged or missing, 0 other files are unknown");
    g_autofree char *are = operator_products(run->session);
    g_assert_cmpstr(are, ==, products);
}

TEST(any) {
    const char *asked = g_getenv("MESORIG_DAMAGES");
    const int all = asked ? atoi(asked) : ALL;
    struct operation *run = processed();
    g_autofree char *products = operator_products(run->session);
    g_autoptr(GRand) random = g_rand_new_with_seed(SEED);
    int flips = 0, deletions = 0, rounds = 0;
    check_whole(run, products);
    for (; flips + deletions < all; rounds++) {
        g_autoptr(GPtrArray) files = files_of(run);
        g_autoptr(GHashTable) damaged = g_hash_table_new(g_str_hash, g_str_equal);
        /* From a single one to most of the session. */
        const int damages = asked ? g_rand_int_range(random, 1, 2 * (gint32)files->len) : DAMAGES;
        for (int i = 0; i < damages && flips + deletions < all; i++) {
            const char *file = files->pdata[g_rand_int_range(random, 0, (gint32)files->len)];
            g_autofree char *path = g_build_filename(run->session, file, NULL);
            if (!g_hash_table_add(damaged, (gpointer)file))
                continue;
            if (g_rand_int_range(random, 0, 4) > 0) {
                flip(path, random);
                flips++;
            } else {
                g_assert_cmpint(g_unlink(path), ==, 0);
                deletions++;
            }
        }
        operator_does(run, 1, "verify", run->session, NULL);
        GHashTableIter iter;
        gpointer file;
        g_hash_table_iter_init(&iter, damaged);
        while (g_hash_table_iter_next(&iter, &file, NULL)) {
            g_autofree char *told = g_strdup_printf(" %s: it", (const char *)file);
            assert_has(run->out, told);
        }
        g_autofree char *sum =
            g_strdup_printf(" %u are damaged or missing", g_hash_table_size(damaged));
        assert_has(run->out, sum);
        repair(run);
        check_whole(run, products);
    }
    g_test_message("%d flips and %d deletions in %d rounds: all told, all repaired", flips,
                   deletions, rounds);
    operator_free(run);
}

/* What process says of a frame is true. */
TEST(frame) {
    static const char *const folders[] = {"frames/", "laser/"};
    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++) {
        struct operation *run = operator_new(NULL);
        operator_captures(run, 0);
        g_autoptr(GPtrArray) files = files_of(run);
        int n = 0;
        for (guint k = 0; k < files->len; k++)
            if (g_str_has_prefix(files->pdata[k], folders[i]) && n++ % 3 == 2)
                flip_in(run, files->pdata[k]);
        g_assert_cmpint(n, >, 3);
        operator_does(run, 1, "process", run->session, NULL);
        assert_has(run->err, "its SHA-256 is ");
        assert_has(run->err, ", but the session has ");
        assert_has(run->err, "`mesorig resume` takes the frame again");
        operator_does(run, 0, "resume", run->session, NULL);
        operator_check_products(run);
        operator_free(run);
    }
}

/* Dark frames are not processed, but later frames are computed with them. */
TEST(dark) {
    struct operation *run = operator_new(NULL);
    operator_captures(run, 0);
    g_autofree char *frames = operator_frames(run->session);
    flip_in(run, "frames/000001_cam30.exr");
    operator_does(run, 0, "resume", run->session, NULL);
    operator_does(run, 0, "verify", run->session, NULL);
    operator_check_products(run);
    operator_free(run);
}

/* third and fourth: arguments after the session, or NULL. */
static void refuses(struct operation *run, const char *product, const char *command,
                    const char *third, const char *fourth) {
    g_autofree char *path = g_build_filename(run->session, product, NULL);
    operator_does(run, 1, command, run->session, third, fourth, NULL);
    assert_has(run->err, path);
    assert_has(run->err, "damaged: its SHA-256 is ");
    assert_has(run->err, ", but the session has ");
}

TEST(products) {
    struct operation *run = processed();
    g_autofree char *products = operator_products(run->session);
    g_autofree char *out = g_build_filename(run->directory, "out", NULL);
    g_autofree char *output = g_strdup_printf("--output=%s", out);
    g_autofree char *bonn = g_strconcat(output, ".btf", NULL);
    g_autofree char *points = g_strconcat(output, ".ply", NULL);
    g_autofree char *lpca = g_build_filename(run->session, "products/lpca.exr", NULL);
    static const char view[] = "products/btf/view_0002.exr", mdf[] = "products/mdf.exr";
    flip_in(run, view);
    refuses(run, view, "check", NULL, NULL);
    refuses(run, view, "compress", output, NULL);
    refuses(run, view, "compare", lpca, NULL);
    refuses(run, view, "resample", output, NULL);
    operator_does(run, 1, "export", "btf", run->session, bonn, NULL);
    assert_has(run->err, "`mesorig process ");
    operator_does(run, 0, "process", run->session, NULL);
    assert_has(run->out, "1 product was damaged or gone, and has been made again");
    check_whole(run, products);
    flip_in(run, mdf);
    refuses(run, mdf, "check", NULL, NULL);
    refuses(run, mdf, "compress", "--method=mdf", output);
    operator_does(run, 1, "export", "points", run->session, points, NULL);
    assert_has(run->err, "`mesorig process ");
    operator_does(run, 0, "process", run->session, NULL);
    check_whole(run, products);
    flip_in(run, "products/eigenmaps.exr");
    operator_does(run, 0, "process", run->session, NULL);
    check_whole(run, products);
    flip_in(run, "products/lpca.exr");
    operator_does(run, 1, "compare", run->session, lpca, NULL);
    assert_has(run->err, "`mesorig compress --clusters=2 --components=2 ");
    operator_does(run, 1, "verify", run->session, NULL);
    repair(run);
    check_whole(run, products);
    g_assert_false(g_file_test(out, G_FILE_TEST_EXISTS));
    operator_free(run);
}

TEST(viewed) {
    struct operation *run = processed();
    g_autofree char *lpca = g_build_filename(run->session, "products/lpca.exr", NULL);
    g_autoptr(GError) error = NULL;
    g_assert_true(ok(session_check_product(lpca, ERR)));
    flip_in(run, "products/lpca.exr"); /* times stay: what was known of it is not believed */
    g_assert_false(session_check_product(lpca, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_DAMAGED);
    g_clear_error(&error);
    g_assert_cmpint(g_unlink(lpca), ==, 0);
    g_assert_false(session_check_product(lpca, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_DAMAGED);
    g_clear_error(&error);
    g_assert_true(session_check_product(run->rig, &error)); /* is not a product */
    g_assert_no_error(error);
    operator_free(run);
}

TEST(unknown) {
    struct operation *run = processed();
    g_autofree char *stranger = g_build_filename(run->session, "products/stranger.exr", NULL);
    g_autofree char *link = g_build_filename(run->session, "frames/link", NULL);
    g_autofree char *view = g_build_filename(run->session, "products/btf/view_0001.exr", NULL);
    g_autofree char *moved = g_build_filename(run->directory, "moved.exr", NULL);
    g_assert_true(g_file_set_contents(stranger, "x", 1, NULL));
    g_assert_cmpint(symlink("/etc", link), ==, 0);
    operator_does(run, 1, "verify", run->session, NULL);
    assert_has(run->out, "unknown   frames/link: ");
    assert_has(run->out, "unknown   products/stranger.exr: ");
    assert_has(run->out, "0 are damaged or missing, 2 other files are unknown");
    operator_does(run, 1, "verify", "--json", run->session, NULL);
    assert_has(run->out, "\"unknown\": [\"frames/link\", \"products/stranger.exr\"]");
    g_unlink(stranger);
    g_unlink(link);
    /* A file outside of the session is not part of it, whatever link points to it. */
    g_assert_cmpint(g_rename(view, moved), ==, 0);
    g_assert_cmpint(symlink(moved, view), ==, 0);
    operator_does(run, 1, "verify", run->session, NULL);
    assert_has(run->out, "damaged   products/btf/view_0001.exr: it is a");
    operator_does(run, 0, "process", run->session, NULL);
    operator_does(run, 0, "verify", run->session, NULL);
    operator_free(run);
}

struct maker {
    const char *file, *lock_path;
    int lock;
};

/* Ends 0.5 s later; its file is no product after all. */
static gpointer make(gpointer data) {
    const struct maker *maker = data;
    g_usleep(G_USEC_PER_SEC / 2);
    g_unlink(maker->file);
    file_lock_give(maker->lock, maker->lock_path);
    return NULL;
}

/* While a program makes products, a file without a row is examined again. */
TEST(made_meanwhile) {
    struct operation *run = processed();
    g_autofree char *file = g_build_filename(run->session, "products/new.exr", NULL);
    g_autofree char *lock_path = g_build_filename(run->session, SESSION_PROCESS_LOCK, NULL);
    g_assert_true(g_file_set_contents(file, "x", 1, NULL));
    struct maker maker = {file, lock_path, file_lock_take(lock_path, "products", NULL)};
    g_assert_cmpint(maker.lock, >=, 0);
    GThread *thread = g_thread_new("maker", make, &maker);
    operator_does(run, 0, "verify", run->session, NULL);
    g_thread_join(thread);
    operator_free(run);
}

TESTS_RUN_BY(operator_tests);
