/*
 * Runs the fuzz targets without libFuzzer, as part of the test run: every file of a target's
 * corpus, and then mutations of them for some seconds. A seed determines the mutations. They do not
 * depend on the code that they reach, unlike those of libFuzzer (tests/fuzz/run).
 *
 *   fuzz_replay TARGET CORPUS[:CORPUS …] FOUND [SECONDS [SEED]]
 *
 * A child runs the inputs. An input that ends the child, or that takes LIMIT_S, is written into the
 * folder FOUND.
 */
#include "fuzz.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#define MAX_BYTES   16384
#define MAX_CHANGES 6
#define LIMIT_S     60

typedef int (*FuzzFunc)(const uint8_t *data, size_t size);

#define TARGET(name) int fuzz_one_##name(const uint8_t *data, size_t size);
#include "fuzz_targets.h"
#undef TARGET

#define TARGET(name) {#name, fuzz_one_##name},
static const struct {
    const char *name;
    FuzzFunc func;
} targets[] = {
#include "fuzz_targets.h"
};
#undef TARGET

/* In memory that outlives the child. */
struct shared {
    gsize size;
    guint64 runs;
    guint8 bytes[MAX_BYTES];
};

static void run(FuzzFunc func, struct shared *shared) {
    g_autofree guint8 *exact = g_memdup2(shared->bytes, shared->size);
    static const guint8 none;
    alarm(LIMIT_S);
    func(exact ? exact : &none, shared->size);
    shared->runs++;
}

static void load(struct shared *shared, GBytes *bytes) {
    shared->size = MIN(g_bytes_get_size(bytes), MAX_BYTES);
    if (shared->size > 0)
        memcpy(shared->bytes, g_bytes_get_data(bytes, NULL), shared->size);
}

static gsize below(GRand *random, gsize n) {
    return n > 1 ? (gsize)g_rand_int_range(random, 0, (gint32)n) : 0;
}

/* Makes room for n bytes at a place, or takes them away. */
static void move(struct shared *shared, gsize at, gsize n, gboolean insert) {
    n = insert ? MIN(n, MAX_BYTES - shared->size) : MIN(n, shared->size - at);
    if (insert)
        memmove(shared->bytes + at + n, shared->bytes + at, shared->size - at);
    else
        memmove(shared->bytes + at, shared->bytes + at + n, shared->size - at - n);
    shared->size = insert ? shared->size + n : shared->size - n;
}

static void mutate(struct shared *shared, GPtrArray *corpus, GRand *random) {
    static const guint32 telling[] = {0,      1,      0x7f,       0x80,       0xff,      0x7fff,
                                      0x8000, 0xffff, 0x7fffffff, 0x80000000, 0xffffffff};
    static const char *const words[] = {"0", "-1",  "1e308", "nan", "inf", "99999999999999999999",
                                        "=", "\n[", "\"",    "%s",  "../"};
    const gsize at = below(random, shared->size), n = 1 + below(random, 16);
    const gsize rest = shared->size - at;
    guint8 *to = shared->bytes + at;
    GBytes *other = corpus->pdata[below(random, corpus->len)];
    const char *word = words[below(random, G_N_ELEMENTS(words))];
    const gsize length = below(random, 4);
    guint32 value = telling[below(random, G_N_ELEMENTS(telling))];
    switch (below(random, 8)) {
    case 0:
        if (rest > 0)
            *to ^= (guint8)(1u << below(random, 8));
        break;
    case 1:
        if (rest > 0)
            *to = (guint8)g_rand_int(random);
        break;
    case 2: /* a number in either byte order */
        if (below(random, 2))
            value = GUINT32_SWAP_LE_BE(value);
        memcpy(to, &value, MIN(rest, length + 1));
        break;
    case 3:
        move(shared, at, n, FALSE);
        break;
    case 4:
        move(shared, at, n, TRUE);
        for (gsize i = 0; i < n && at + i < shared->size; i++)
            shared->bytes[at + i] = (guint8)g_rand_int(random);
        break;
    case 5:
        move(shared, at, strlen(word), TRUE);
        memcpy(to, word, MIN(strlen(word), shared->size - at));
        break;
    case 6: /* a piece of itself elsewhere */
        memmove(to, shared->bytes + below(random, shared->size - MIN(n, rest) + 1), MIN(n, rest));
        break;
    default: { /* the end of another one */
        const gsize from = below(random, g_bytes_get_size(other));
        const gsize more = MIN(g_bytes_get_size(other) - from, MAX_BYTES - at);
        if (more > 0)
            memcpy(to, (const guint8 *)g_bytes_get_data(other, NULL) + from, more);
        shared->size = at + more;
    }
    }
}

static void fuzz(FuzzFunc func, struct shared *shared, GPtrArray *corpus, double seconds,
                 guint32 seed) {
    g_autoptr(GRand) random = g_rand_new_with_seed(seed);
    const gint64 end_us = g_get_monotonic_time() + (gint64)(seconds * G_USEC_PER_SEC);
    while (g_get_monotonic_time() < end_us) {
        load(shared, corpus->pdata[below(random, corpus->len)]);
        for (gsize i = 0, n = 1 + below(random, MAX_CHANGES); i < n; i++)
            mutate(shared, corpus, random);
        run(func, shared);
    }
}

static gint compare_names(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

/* folders: separated by colons */
static GPtrArray *read_corpus(const char *folders) {
    GPtrArray *corpus = g_ptr_array_new_with_free_func((GDestroyNotify)g_bytes_unref);
    g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
    g_auto(GStrv) all = g_strsplit(folders, ":", -1);
    g_autoptr(GError) error = NULL;
    for (char **folder = all; *folder; folder++) {
        g_autoptr(GDir) dir = g_dir_open(*folder, 0, &error);
        g_assert_no_error(error);
        for (const char *name; (name = g_dir_read_name(dir));)
            g_ptr_array_add(names, g_build_filename(*folder, name, NULL));
    }
    g_ptr_array_sort(names, compare_names);
    for (guint i = 0; i < names->len; i++) {
        char *bytes = NULL;
        gsize n = 0;
        g_file_get_contents(names->pdata[i], &bytes, &n, &error);
        g_assert_no_error(error);
        g_ptr_array_add(corpus, g_bytes_new_take(bytes, n));
    }
    return corpus;
}

static void keep(const char *name, const char *folder, const struct shared *shared, int status) {
    g_autofree char *sum =
        g_compute_checksum_for_data(G_CHECKSUM_SHA256, shared->bytes, shared->size);
    g_autofree char *file = g_strdup_printf("%s-%.16s", name, sum);
    g_autofree char *path = g_build_filename(folder, file, NULL);
    g_mkdir_with_parents(folder, 0777);
    g_file_set_contents(path, (const char *)shared->bytes, (gssize)shared->size, NULL);
    g_printerr("fuzz_replay: %s %s on input %" G_GUINT64_FORMAT ": it is %s\n", name,
               WIFSIGNALED(status) && WTERMSIG(status) == SIGALRM ? "takes too long" : "ended",
               shared->runs + 1, path);
}

int main(int argc, char **argv) {
    FuzzFunc func = NULL;
    int status = 0;
    for (gsize i = 0; argc >= 4 && i < G_N_ELEMENTS(targets); i++)
        if (g_str_equal(argv[1], targets[i].name))
            func = targets[i].func;
    if (!func) {
        g_printerr("usage: fuzz_replay TARGET CORPUS[:CORPUS …] FOUND [SECONDS [SEED]]\n");
        return 2;
    }
    const double seconds = argc > 4 ? g_ascii_strtod(argv[4], NULL) : 0;
    const guint32 seed = argc > 5 ? (guint32)g_ascii_strtoull(argv[5], NULL, 10) : 1;
    struct shared *shared =
        mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    g_assert_true(shared != MAP_FAILED);
    g_autoptr(GPtrArray) corpus = read_corpus(argv[2]);
    g_assert_cmpuint(corpus->len, >, 0);
    const pid_t pid = fork();
    if (pid == 0) {
        for (guint i = 0; i < corpus->len; i++) {
            load(shared, corpus->pdata[i]);
            run(func, shared);
        }
        fuzz(func, shared, corpus, seconds, seed);
        exit(0);
    }
    g_assert_cmpint(pid, >, 0);
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        ;
    if (status != 0)
        keep(argv[1], argv[3], shared, status);
    else
        g_print("%s: %u files, %" G_GUINT64_FORMAT " inputs, seed %u\n", argv[1], corpus->len,
                shared->runs, seed);
    munmap(shared, sizeof *shared);
    return status != 0;
}
