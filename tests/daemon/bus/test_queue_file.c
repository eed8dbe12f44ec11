/* The list of the queue and its file: what is stored, what is refused, and which files are not
 * read. */
#include "bus/queue.h"
#include "lib/ok.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "lib/remove_tree.h"

struct fixture {
    char *folder, *path, *damaged;
    Queue *queue;
};

static Queue *open_again(struct fixture *fixture) {
    queue_free(fixture->queue);
    fixture->queue = ok(queue_open(fixture->path, ERR));
    return fixture->queue;
}

static void set_up(struct fixture *fixture, gconstpointer data) {
    fixture->folder = g_dir_make_tmp("mesorig-queue-XXXXXX", NULL);
    fixture->path = g_build_filename(fixture->folder, "queue", NULL);
    fixture->damaged = g_build_filename(fixture->folder, "queue.damaged", NULL);
    open_again(fixture);
}

static void tear_down(struct fixture *fixture, gconstpointer data) {
    queue_free(fixture->queue);
    remove_tree(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->path);
    g_free(fixture->damaged);
}

static void set_text(char **field, const char *text) {
    g_free(*field);
    *field = g_strdup(text);
}

static struct queue_item *new_item(const char *name) {
    struct queue_item *item = queue_item_new();
    const guint32 groups[] = {0, 4294967294U, 27};
    g_autofree char *directory = g_strdup_printf("/data/%s.session", name);
    set_text(&item->name, name);
    set_text(&item->session_path, "/home/anna/weave.conf");
    set_text(&item->session_text, "[session]\nname = a\tb\\n; # \"x\"\n\n  µ\n");
    set_text(&item->directory, directory);
    set_text(&item->rig, "/etc/mesorig/rig.conf");
    set_text(&item->prompt, "lay the felt on the turntable");
    item->predicted_s = 1234.0625;
    item->bytes = G_GUINT64_CONSTANT(123456789012);
    item->yes = TRUE;
    item->has_caller = TRUE;
    item->uid = 4294967293U;
    g_array_append_vals(item->groups, groups, G_N_ELEMENTS(groups));
    return item;
}

static guint add(struct fixture *fixture, const char *name) {
    struct queue_item *item = new_item(name);
    ok(queue_add(fixture->queue, item, ERR));
    return item->id;
}

/* The names in order, "a b c". g_free(). */
static char *names(const struct fixture *fixture) {
    const GPtrArray *items = queue_items(fixture->queue);
    g_autoptr(GPtrArray) all = g_ptr_array_new();
    for (guint i = 0; i < items->len; i++)
        g_ptr_array_add(all, ((const struct queue_item *)items->pdata[i])->name);
    g_ptr_array_add(all, NULL);
    return g_strjoinv(" ", (char **)all->pdata);
}

static void assert_names(const struct fixture *fixture, const char *wanted) {
    g_autofree char *is = names(fixture);
    g_assert_cmpstr(is, ==, wanted);
}

static void test_kept(struct fixture *fixture, gconstpointer data) {
    const guint id = add(fixture, "a");
    g_autofree char *text = NULL;
    struct stat info;
    g_assert_true(queue_pause(fixture->queue, "paused\nby hand", NULL));
    g_assert_cmpint(stat(fixture->path, &info), ==, 0);
    g_assert_cmpuint(info.st_mode & 0777, ==, 0600);
    open_again(fixture);
    g_assert_cmpstr(queue_paused(fixture->queue), ==, "paused\nby hand");
    const struct queue_item *item = queue_find(fixture->queue, id, NULL);
    g_autoptr(QueueItem) same = new_item("a");
    g_assert_nonnull(item);
    g_assert_cmpstr(item->session_text, ==, same->session_text);
    g_assert_cmpstr(item->session_path, ==, same->session_path);
    g_assert_cmpstr(item->directory, ==, same->directory);
    g_assert_cmpstr(item->rig, ==, same->rig);
    g_assert_cmpstr(item->prompt, ==, same->prompt);
    g_assert_cmpstr(item->calibration_text, ==, "");
    g_assert_cmpfloat(item->predicted_s, ==, same->predicted_s);
    g_assert_cmpuint(item->bytes, ==, same->bytes);
    g_assert_true(item->yes && item->has_caller && !item->process);
    g_assert_cmpuint(item->uid, ==, same->uid);
    g_assert_cmpmem(item->groups->data, item->groups->len * sizeof(guint32), same->groups->data,
                    same->groups->len * sizeof(guint32));
    /* What had begun waits again, what had ended has ended, and numbers are not given twice. */
    struct queue_item *own = queue_find(fixture->queue, id, NULL);
    own->starts = 2;
    own->begun_at_s = 1700000000;
    g_assert_true(queue_set(fixture->queue, own, QUEUE_BEGUN, NULL, NULL));
    open_again(fixture);
    own = queue_find(fixture->queue, id, NULL);
    g_assert_cmpint(own->state, ==, QUEUE_WAITING);
    g_assert_cmpint(own->starts, ==, 2);
    g_assert_cmpint(own->begun_at_s, ==, 1700000000);
    g_assert_true(queue_set(fixture->queue, own, QUEUE_STOPPED, "why", NULL));
    g_assert_true(queue_remove(fixture->queue, id, NULL));
    open_again(fixture);
    g_assert_cmpuint(add(fixture, "b"), >, id);
}

static void test_order(struct fixture *fixture, gconstpointer data) {
    const guint a = add(fixture, "a"), b = add(fixture, "b"), c = add(fixture, "c");
    g_autoptr(GError) error = NULL;
    g_assert_true(queue_move(fixture->queue, c, 1, NULL));
    assert_names(fixture, "c a b");
    g_assert_true(queue_move(fixture->queue, c, 99, NULL));
    assert_names(fixture, "a b c");
    g_assert_true(queue_move(fixture->queue, a, 2, NULL));
    assert_names(fixture, "b a c");
    open_again(fixture);
    assert_names(fixture, "b a c");
    struct queue_item *item = queue_next(fixture->queue);
    g_assert_cmpuint(item->id, ==, b);
    queue_set(fixture->queue, item, QUEUE_BEGUN, NULL, NULL);
    g_assert_false(queue_move(fixture->queue, b, 2, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_BUSY);
    g_clear_error(&error);
    g_assert_false(queue_remove(fixture->queue, b, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_BUSY);
    g_assert_true(queue_move(fixture->queue, c, 1, NULL)); /* behind what has begun */
    assert_names(fixture, "b c a");
    queue_set(fixture->queue, queue_find(fixture->queue, c, NULL), QUEUE_STOPPED, "why", NULL);
    queue_set(fixture->queue, item, QUEUE_DONE, NULL, NULL);
    assert_names(fixture, "c b a");
    g_assert_cmpuint(queue_next(fixture->queue)->id, ==, a);
    g_clear_error(&error);
    g_assert_false(queue_add(fixture->queue, new_item("a"), &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_EXISTS);
    add(fixture, "b"); /* that one has ended */
}

/* A full disk: the list stays as it was, in memory and on disk. */
static void test_full(struct fixture *fixture, gconstpointer data) {
    const guint a = add(fixture, "a"), b = add(fixture, "b");
    const struct rlimit none = {64, RLIM_INFINITY}, all = {RLIM_INFINITY, RLIM_INFINITY};
    g_autoptr(GError) error = NULL;
    signal(SIGXFSZ, SIG_IGN);
    g_assert_cmpint(setrlimit(RLIMIT_FSIZE, &none), ==, 0);
    g_assert_false(queue_add(fixture->queue, new_item("c"), &error));
    g_assert_nonnull(error);
    g_assert_nonnull(strstr(error->message, fixture->path));
    g_assert_nonnull(strstr(error->message, "the file keeps its old contents"));
    assert_names(fixture, "a b");
    g_assert_false(queue_remove(fixture->queue, a, NULL));
    g_assert_false(queue_move(fixture->queue, b, 1, NULL));
    assert_names(fixture, "a b");
    g_assert_false(queue_pause(fixture->queue, "for now", NULL));
    g_assert_cmpstr(queue_paused(fixture->queue), ==, "for now");
    g_assert_false(queue_pause(fixture->queue, NULL, NULL));
    g_assert_cmpstr(queue_paused(fixture->queue), ==, "for now");
    g_assert_cmpint(setrlimit(RLIMIT_FSIZE, &all), ==, 0);
    open_again(fixture);
    assert_names(fixture, "a b");
    g_assert_null(queue_paused(fixture->queue));
    g_autoptr(GDir) dir = g_dir_open(fixture->folder, 0, NULL);
    for (const char *name; (name = g_dir_read_name(dir));)
        g_assert_false(g_str_has_suffix(name, ".part"));
}

static void test_limits(struct fixture *fixture, gconstpointer data) {
    g_autoptr(GError) error = NULL;
    g_autofree char *large = g_strnfill(1 << 20, 'x');
    struct queue_item *item = NULL;
    for (int i = 0; i < 40 && !error; i++) {
        g_autofree char *name = g_strdup_printf("large%d", i);
        item = new_item(name);
        set_text(&item->session_text, large);
        queue_add(fixture->queue, item, &error);
    }
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_NO_SPACE);
    const guint n = queue_items(fixture->queue)->len;
    g_assert_cmpuint(n, >=, 30);
    open_again(fixture);
    g_assert_cmpuint(queue_items(fixture->queue)->len, ==, n);
}

/* The file is set aside, and the queue is empty and paused. */
static void assert_refused(struct fixture *fixture, const char *words) {
    open_again(fixture);
    g_assert_cmpuint(queue_items(fixture->queue)->len, ==, 0);
    g_assert_nonnull(queue_paused(fixture->queue));
    if (!strstr(queue_paused(fixture->queue), words))
        g_error("no “%s” in: %s", words, queue_paused(fixture->queue));
    g_assert_false(g_file_test(fixture->path, G_FILE_TEST_EXISTS));
    struct stat info;
    g_assert_cmpint(lstat(fixture->damaged, &info), ==, 0);
    remove(fixture->damaged);
}

static void test_hostile(struct fixture *fixture, gconstpointer data) {
    g_autofree char *good = NULL, *outside = g_build_filename(fixture->folder, "outside", NULL);
    add(fixture, "a");
    g_assert_true(g_file_get_contents(fixture->path, &good, NULL, NULL));
    /* Others could have written it. */
    g_assert_cmpint(g_chmod(fixture->path, 0660), ==, 0);
    assert_refused(fixture, "other users could have written this file");
    if (geteuid() == 0) {
        g_assert_true(g_file_set_contents(fixture->path, good, -1, NULL));
        g_assert_cmpint(g_chmod(fixture->path, 0600), ==, 0);
        g_assert_cmpint(chown(fixture->path, 65534, 65534), ==, 0);
        assert_refused(fixture, "it belongs to user 65534");
    }
    /* Not a file of its own. */
    g_assert_true(g_file_set_contents(outside, good, -1, NULL));
    g_assert_cmpint(symlink(outside, fixture->path), ==, 0);
    assert_refused(fixture, "symbolic links");
    g_assert_cmpint(mkfifo(fixture->path, 0600), ==, 0);
    assert_refused(fixture, "a FIFO");
    g_assert_cmpint(g_mkdir(fixture->path, 0700), ==, 0);
    assert_refused(fixture, "a directory");
    /* Damaged in one place after the other. */
    static const struct {
        const char *from, *to, *words;
    } changes[] = {
        {"version=1", "version=2", "another version"},
        {"[session 1]", "[session 5]", "[session 5]"},
        {"[session 1]", "[session x]", "[session x]"},
        {"[session 1]", "[else]", "[else]"},
        {"state=waiting", "state=soon", "there is no state “soon”"},
        {"predicted_s=", "predicted_s=-", "is not at least 0"},
        {"predicted_s=", "predicted_s=x", "predicted_s"},
        {"directory=/", "directory=", "not an absolute path"},
        {"uid=", "uid=9", "] uid: "},
        {"yes=true", "yes=perhaps", "yes"},
        {"\nname=", "\nnome=", "name"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(changes); i++) {
        g_auto(GStrv) parts = g_strsplit(good, changes[i].from, 2);
        g_assert_nonnull(parts[1]);
        g_autofree char *bad = g_strjoinv(changes[i].to, parts);
        g_assert_true(g_file_set_contents(fixture->path, bad, -1, NULL));
        g_assert_cmpint(g_chmod(fixture->path, 0600), ==, 0);
        assert_refused(fixture, changes[i].words);
    }
    /* And anything: never a crash, and never a session that was not there. */
    g_autoptr(GRand) random = g_rand_new_with_seed(31);
    for (int i = 0; i < 2000; i++) {
        g_autofree char *bad = g_strdup(good);
        const gsize n = strlen(bad);
        for (int k = g_rand_int_range(random, 1, 4); k > 0; k--)
            bad[g_rand_int_range(random, 0, (int)n)] = (char)g_rand_int_range(random, 0, 256);
        g_assert_true(g_file_set_contents(
            fixture->path, bad, g_rand_int_range(random, 0, 8) ? (gssize)n : (gssize)n / 2, NULL));
        g_assert_cmpint(g_chmod(fixture->path, 0600), ==, 0);
        open_again(fixture);
        g_assert_cmpuint(queue_items(fixture->queue)->len, <=, 1);
        remove(fixture->path);
        remove(fixture->damaged);
    }
}

static void test_locked(struct fixture *fixture, gconstpointer data) {
    g_autoptr(GError) error = NULL;
    g_assert_null(queue_open(fixture->path, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_BUSY);
    g_autofree char *nowhere = g_build_filename(fixture->folder, "no", "queue", NULL);
    g_clear_error(&error);
    g_assert_null(queue_open(nowhere, &error));
    g_assert_nonnull(strstr(error->message, nowhere));
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
#define ADD(name, func)                                                                            \
    g_test_add("/queue-file/" name, struct fixture, NULL, set_up, func, tear_down)
    ADD("kept", test_kept);
    ADD("order", test_order);
    ADD("full", test_full);
    ADD("limits", test_limits);
    ADD("hostile", test_hostile);
    ADD("locked", test_locked);
    return g_test_run();
}
