/*
 * Deterministic simulation of the daemon: seeds, each a run of its own (run_seed.h), in several
 * processes at the same time. docs/develop/reliability.md says what is simulated and which
 * invariants are checked.
 */
#include <errno.h>
#include <glib/gstdio.h>
#include <locale.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/json.h"
#include "disk_model.h"
#include "run_seed.h"
#include "schedule.h"

#define MAX_JOBS 256
#define TELL_US  (5 * G_USEC_PER_SEC) /* between lines of progress that are not on a terminal */

static int n_seeds = 200, from_seed = 1, one_seed = -1, n_jobs, session = -1;
static gboolean verbose, json, twice, until_found;
static char *lives_text;
static enum seed_lives lives = LIVES_BOTH;

static const GOptionEntry entries[] = {
    {"seeds", 0, 0, G_OPTION_ARG_INT, &n_seeds, "Run this many seeds (default: 200)", "N"},
    {"from", 0, 0, G_OPTION_ARG_INT, &from_seed, "The first seed (default: 1)", "SEED"},
    {"jobs", 0, 0, G_OPTION_ARG_INT, &n_jobs, "Run as many at once (default: one a processor)",
     "N"},
    {"seed", 0, 0, G_OPTION_ARG_INT, &one_seed, "Run this seed alone", "SEED"},
    {"session", 0, 0, G_OPTION_ARG_INT, &session,
     "Every seed has this session, from 0 on (default: the seed decides)", "N"},
    {"lives", 0, 0, G_OPTION_ARG_STRING, &lives_text,
     "Which lives a seed has: capture, bus or both (default: both)", "KIND"},
    {"verbose", 0, 0, G_OPTION_ARG_NONE, &verbose, "With --seed: print what happens", NULL},
    {"twice", 0, 0, G_OPTION_ARG_NONE, &twice,
     "Run each seed twice; the second run must not differ from the first", NULL},
    {"until-found", 0, 0, G_OPTION_ARG_NONE, &until_found,
     "End after the first seed that breaks an invariant", NULL},
    {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Print the result as JSON", NULL},
    {NULL},
};

struct tally {
    int n, n_failed, lives, kills, cuts, failed_calls, rotten, misplaced, served, bus_calls;
    GArray *failed; /* of struct seed_result */
    gint64 begun_us, told_us;
};

static void run_one(const Reference *reference, guint32 seed, GString *said,
                    struct seed_result *ret) {
    run_seed(reference, seed, lives, session, said, ret);
    if (!twice || !ret->ok)
        return;
    struct seed_result again;
    run_seed(reference, seed, lives, session, NULL, &again);
    if (again.digest == ret->digest)
        return;
    ret->ok = FALSE;
    g_snprintf(ret->violation, sizeof ret->violation,
               "same seed, same run: the second run differs from the first%s%s",
               again.ok ? "" : ": ", again.violation);
}

/* A process that takes seeds until there are no more. */
static void work(const Reference *reference, gint *next, int to) {
    for (;;) {
        const int i = g_atomic_int_add(next, 1);
        struct seed_result result;
        if (i >= n_seeds)
            _exit(0);
        run_one(reference, (guint32)(from_seed + i), NULL, &result);
        if (until_found && !result.ok)
            g_atomic_int_set(next, n_seeds);
        if (write(to, &result, sizeof result) != (ssize_t)sizeof result)
            _exit(1);
    }
}

static char *life_name(const struct seed_result *result) {
    return result->life > 0 ? g_strdup_printf("life %d", result->life)
                            : g_strdup("life on the bus");
}

static void tell_progress(struct tally *tally, gboolean last) {
    const gint64 now_us = g_get_monotonic_time();
    const gboolean terminal = isatty(STDERR_FILENO);
    if (!last && !terminal && now_us - tally->told_us < TELL_US)
        return;
    tally->told_us = now_us;
    const double each_s = (double)(now_us - tally->begun_us) * 1e-6 / MAX(tally->n, 1);
    g_printerr("%s%d of %d seeds, %d failed, about %.0f s left%s",
               terminal ? "\r" : "simulate: ", tally->n, n_seeds, tally->n_failed,
               each_s * (n_seeds - tally->n), terminal && !last ? "   " : "\n");
}

static void take_result(struct tally *tally, const struct seed_result *result) {
    tally->n++;
    tally->lives += result->lives;
    tally->kills += result->kills;
    tally->cuts += result->cuts;
    tally->failed_calls += result->failed_calls;
    tally->rotten += result->rotten;
    tally->misplaced += result->misplaced;
    tally->served += result->served;
    tally->bus_calls += result->bus_calls;
    if (!result->ok) {
        tally->n_failed++;
        g_array_append_val(tally->failed, *result);
        g_autofree char *where = life_name(result);
        g_printerr("%sseed %u, %s: %s\n", isatty(STDERR_FILENO) ? "\r" : "simulate: ", result->seed,
                   where, result->violation);
    }
    tell_progress(tally, FALSE);
}

/* FALSE: a process has ended otherwise than it should. */
static gboolean run_all(const Reference *reference, struct tally *tally) {
    gint *next =
        mmap(NULL, sizeof *next, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    const int jobs = CLAMP(n_jobs > 0 ? n_jobs : (int)g_get_num_processors(), 1, MAX_JOBS);
    int fds[2];
    gboolean ok = TRUE;
    if (next == MAP_FAILED || pipe(fds) != 0)
        g_error("simulate: %s", g_strerror(errno));
    for (int i = 0; i < jobs; i++) {
        const pid_t pid = fork();
        if (pid < 0)
            g_error("simulate: no process: %s", g_strerror(errno));
        if (pid == 0) {
            close(fds[0]);
            work(reference, next, fds[1]);
        }
    }
    close(fds[1]);
    signal(SIGINT, SIG_IGN); /* ends the others, so that what they have made is removed */
    struct seed_result result;
    while (read(fds[0], &result, sizeof result) == (ssize_t)sizeof result)
        take_result(tally, &result);
    for (int i = 0; i < jobs; i++) {
        int status = 0;
        ok &= wait(&status) > 0 && WIFEXITED(status) && WEXITSTATUS(status) == 0;
    }
    close(fds[0]);
    munmap(next, sizeof *next);
    return ok && (tally->n == n_seeds || (until_found && tally->n_failed > 0));
}

static int compare_results(gconstpointer a, gconstpointer b) {
    const struct seed_result *x = a, *y = b;
    return x->seed < y->seed ? -1 : x->seed > y->seed;
}

static void print_json(const struct tally *tally) {
    g_print("{\"seeds\": %d, \"from\": %d, \"lives\": %d, \"kills\": %d, \"power_cuts\": %d, "
            "\"failed_calls\": %d, \"rotten\": %d, \"misplaced\": %d, "
            "\"served\": %d, "
            "\"bus_calls\": %d, \"failed\": [",
            tally->n, from_seed, tally->lives, tally->kills, tally->cuts, tally->failed_calls,
            tally->rotten, tally->misplaced, tally->served, tally->bus_calls);
    for (guint i = 0; i < tally->failed->len; i++) {
        const struct seed_result *result = &g_array_index(tally->failed, struct seed_result, i);
        g_autoptr(GString) broken = g_string_new(NULL);
        json_append_string(broken, result->violation);
        g_print("%s{\"seed\": %u, \"life\": %d, \"invariant\": %s}", i ? ", " : "", result->seed,
                result->life, broken->str);
    }
    g_print("]}\n");
}

static void print_text(const struct tally *tally, const char *program) {
    for (guint i = 0; i < tally->failed->len; i++) {
        const struct seed_result *result = &g_array_index(tally->failed, struct seed_result, i);
        g_autofree char *with = session >= 0 ? g_strdup_printf(" --session %d", session) : NULL;
        g_autofree char *where = life_name(result);
        g_print("seed %u, %s: %s\n  replay: %s --seed %u%s --verbose\n", result->seed, where,
                result->violation, program, result->seed, with ? with : "");
    }
    g_print("%d seeds, %d failed: %d lives, %d kills, %d power cuts, %d failed calls to the "
            "disk, %d rotten bits, %d misplaced writes; %d lives on the bus with %d calls\n",
            tally->n, tally->n_failed, tally->lives, tally->kills, tally->cuts, tally->failed_calls,
            tally->rotten, tally->misplaced, tally->served, tally->bus_calls);
}

static int simulate(const char *folder, const char *program) {
    g_autofree char *broken = NULL;
    Reference *reference = reference_new(folder, lives, &broken);
    struct tally tally = {.failed = g_array_new(FALSE, FALSE, sizeof(struct seed_result)),
                          .begun_us = g_get_monotonic_time()};
    gboolean ok = TRUE;
    if (broken) {
        g_printerr("simulate: the undisturbed run is broken: %s\n", broken);
        ok = FALSE;
    } else if (one_seed >= 0) {
        g_autoptr(GString) said = g_string_new(NULL);
        struct seed_result result;
        n_seeds = 1;
        from_seed = one_seed;
        run_one(reference, (guint32)one_seed, verbose ? said : NULL, &result);
        g_print("%s", said->str);
        take_result(&tally, &result);
    } else {
        ok = run_all(reference, &tally);
        tell_progress(&tally, TRUE);
        if (!ok)
            g_printerr("simulate: a process has failed; what it said is above\n");
    }
    g_array_sort(tally.failed, compare_results);
    if (!broken)
        (json ? print_json(&tally) : print_text(&tally, program));
    ok &= tally.n_failed == 0;
    g_array_unref(tally.failed);
    reference_free(reference);
    return ok ? 0 : 1;
}

static gboolean parse_lives(void) {
    lives = g_str_equal(lives_text, "capture") ? LIVES_CAPTURE
            : g_str_equal(lives_text, "bus")   ? LIVES_BUS
                                               : LIVES_BOTH;
    return lives != LIVES_BOTH || g_str_equal(lives_text, "both");
}

int main(int argc, char **argv) {
    g_autoptr(GOptionContext) context = g_option_context_new("– simulate the daemon's lives");
    g_autoptr(GError) error = NULL;
    setlocale(LC_ALL, "C.UTF-8");
    g_option_context_add_main_entries(context, entries, NULL);
    if (!g_option_context_parse(context, &argc, &argv, &error) || argc > 1) {
        g_printerr("simulate: %s\n", error ? error->message : "takes options only");
        return 2;
    }
    if (session < -1 || session >= SCHEDULE_SESSIONS) {
        g_printerr("simulate: --session must be 0 to %d\n", SCHEDULE_SESSIONS - 1);
        return 2;
    }
    if (lives_text && !parse_lives()) {
        g_printerr("simulate: --lives must be capture, bus or both\n");
        return 2;
    }
    if (n_seeds < 1 || from_seed < 0 || n_jobs < 0) {
        g_printerr("simulate: --seeds must be 1 or more, --from and --jobs not negative\n");
        return 2;
    }
    /* Memory is enough, and much quicker than a disk that syncs. */
    const gboolean memory = !g_getenv("TMPDIR") && g_access("/dev/shm", W_OK) == 0;
    g_autofree char *made =
        g_build_filename(memory ? "/dev/shm" : g_get_tmp_dir(), "mesorig-simulate-XXXXXX", NULL);
    char *folder = g_mkdtemp(made) ? realpath(made, NULL) : NULL;
    if (!folder) {
        g_printerr("simulate: %s: %s\n", made, g_strerror(errno));
        return 1;
    }
    const int result = simulate(folder, argv[0]);
    disk_remove_tree(folder);
    free(folder);
    return result;
}
