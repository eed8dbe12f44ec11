/* conformance: tests a program of the user that operates a device
 * (docs/build-a-rig/programs.md). */
#include "checks.h"
#include "programs.h"

#include "base/nearest.h"
#include "common/progress.h"
#include "drivers/lock.h"

#include <math.h>
#include <string.h>

#define MAX_ARGUMENTS 64

static char *class_name;
static char **only;
static gboolean list;
static struct bench_motion motion = {NAN, NAN, 20, 100, 0.05};
static double start_s = 5;

static const GOptionEntry entries[] = {
    {"class", 0, 0, G_OPTION_ARG_STRING, &class_name,
     "Class of the device; default: the class in the answer to “hello”", "lamps|axis|camera"},
    {"only", 0, 0, G_OPTION_ARG_STRING_ARRAY, &only,
     "Run only this check; may be given several times", "CHECK"},
    {"list", 0, 0, G_OPTION_ARG_NONE, &list, "List the checks", NULL},
    {"min-deg", 0, 0, G_OPTION_ARG_DOUBLE, &motion.min_deg,
     "Axis: lower end of the range that the checks may use", "DEG"},
    {"max-deg", 0, 0, G_OPTION_ARG_DOUBLE, &motion.max_deg,
     "Axis: upper end of the range that the checks may use", "DEG"},
    {"speed-deg-s", 0, 0, G_OPTION_ARG_DOUBLE, &motion.speed_deg_s, "Axis: speed (20)", "DEG/S"},
    {"accel-deg-s2", 0, 0, G_OPTION_ARG_DOUBLE, &motion.accel_deg_s2, "Axis: acceleration (100)",
     "DEG/S²"},
    {"tolerance-deg", 0, 0, G_OPTION_ARG_DOUBLE, &motion.tolerance_deg,
     "Axis: largest error at the end of a move (0.05)", "DEG"},
    {"start-s", 0, 0, G_OPTION_ARG_DOUBLE, &start_s,
     "Time that the program may take to start and to open its device (5)", "S"},
    {NULL},
};

enum result { PASSED, FAILED, SKIPPED };
static const char *const words[] = {"passed", "failed", "skipped"};
static const char *const marks[] = {"ok", "FAIL", "skip"};

static gboolean is_class(const char *name) {
    static const char *const classes[] = {"lamps", "axis", "camera", NULL};
    return g_strv_contains(classes, name);
}

/* Checks the names of --only. Returns FALSE if a check does not exist, which has then been
 * reported. */
static gboolean check_only(const struct command *command) {
    for (char **name = only; name && *name; name++) {
        struct nearest nearest = nearest_new(*name);
        gboolean found = FALSE;
        for (const struct check *check = checks_all(); check->name; check++) {
            found |= g_str_equal(check->name, *name);
            nearest_consider(&nearest, check->name);
        }
        if (found)
            continue;
        if (nearest.name)
            cli_usage(command, "there is no check “%s”; did you mean “%s”?", *name, nearest.name);
        else
            cli_usage(command, "there is no check “%s”; “mesorig conformance --list” lists them",
                      *name);
        return FALSE;
    }
    return TRUE;
}

static void list_checks(Record *to) {
    record_begin_list(to, "checks");
    for (const struct check *check = checks_all(); check->name; check++) {
        if (class_name && !checks_has(check, class_name))
            continue;
        record_begin(to, NULL);
        record_say(to, "%-18s{check} %-7s{class} %s{promise}\n", check->name,
                   check->class_name ? check->class_name : "all", check->promise);
        record_end(to);
    }
    record_end(to);
}

static void tell(Record *to, const struct check *check, enum result result,
                 const struct bench_verdict *verdict) {
    record_begin(to, NULL);
    record_say(to, "%-4s %-18s{check} %s{promise}\n", marks[result], check->name, check->promise);
    record_string(to, "result", words[result]);
    if (result == SKIPPED)
        record_say(to, "       skipped:  %s{why}\n", verdict->skipped);
    if (result == FAILED)
        record_say(to,
                   "       expected: %s{expected}\n       came:     %s{came}\n"
                   "       to do:    %s{advice}\n",
                   verdict->expected, verdict->came, verdict->advice);
    record_end(to);
}

/* Runs a check. Skips it if a check on which it depends has not passed. */
static enum result run_check(struct bench *bench, const struct check *check, GHashTable *results) {
    gpointer before;
    if (check->after && g_hash_table_lookup_extended(results, check->after, NULL, &before) &&
        GPOINTER_TO_INT(before) != PASSED) {
        bench_skip(bench, "the check “%s” has not passed", check->after);
        return SKIPPED;
    }
    bench->check = check->name;
    const gboolean passed = check->run(bench);
    bench_end(bench);
    return passed ? PASSED : bench->verdict.skipped ? SKIPPED : FAILED;
}

static gboolean is_chosen(const struct check *check, const char *of_class) {
    return checks_has(check, of_class) &&
           (!only || g_strv_contains((const char *const *)only, check->name));
}

static gboolean has_failed(GHashTable *results, const char *check) {
    return GPOINTER_TO_INT(g_hash_table_lookup(results, check)) == FAILED;
}

/* Runs the checks, and reports each of them. Returns whether none has failed. */
static gboolean run_checks(struct bench *bench, Record *to) {
    g_autoptr(GHashTable) results = g_hash_table_new(g_str_hash, g_str_equal);
    Progress *progress = progress_new("Checks");
    int n[G_N_ELEMENTS(words)] = {0}, n_chosen = 0, done = 0;
    for (const struct check *check = checks_all(); check->name; check++)
        n_chosen += is_chosen(check, bench->class_name);
    record_string(to, "program", bench->command->path);
    record_string(to, "class", bench->class_name);
    record_begin_list(to, "checks");
    for (const struct check *check = checks_all(); check->name; check++) {
        if (!is_chosen(check, bench->class_name))
            continue;
        progress_show(progress, (double)done++ / n_chosen, check->name, TRUE);
        const enum result result = run_check(bench, check, results);
        g_hash_table_insert(results, (gpointer)check->name, GINT_TO_POINTER(result));
        tell(to, check, result, &bench->verdict);
        bench_clear_verdict(bench);
        n[result]++;
    }
    record_end(to);
    progress_free(progress);
    /* After a failed check, the device may not be safe. It is made safe by “stop” and “close”. */
    if (n[FAILED] > 0 && !has_failed(results, "hello") && !has_failed(results, "open") &&
        bench_ready(bench))
        bench_do(bench, "close", NULL);
    record_say(to, "%d{passed} passed, %d{failed} failed, %d{skipped} skipped\n", n[PASSED],
               n[FAILED], n[SKIPPED]);
    return n[FAILED] == 0;
}

static int run_bench(const struct call *call, struct bench *bench, GError **error) {
    bench->class_name = class_name ? class_name : checks_find_class(bench);
    bench->motion = motion;
    if (!bench->class_name) {
        g_set_error(
            error, G_IO_ERROR, G_IO_ERROR_FAILED,
            "%s does not say its class in an answer to “hello”: see what it has printed, or "
            "give --class",
            bench->command->path);
        return CLI_FAILED;
    }
    if (g_str_equal(bench->class_name, "axis") && !(motion.min_deg < motion.max_deg))
        return cli_usage(call->command, "the checks move the axis: give --min-deg and --max-deg, "
                                        "the range that they may use");
    if (motion.speed_deg_s <= 0)
        return cli_usage(call->command, "--speed-deg-s must be above 0");
    if (motion.accel_deg_s2 <= 0)
        return cli_usage(call->command, "--accel-deg-s2 must be above 0");
    if (motion.tolerance_deg < 0)
        return cli_usage(call->command, "--tolerance-deg must not be negative");
    return run_checks(bench, call->record) ? CLI_DONE : CLI_FAILED;
}

static int run_conformance(const struct call *call, GError **error) {
    if (class_name && !is_class(class_name))
        return cli_usage(call->command, "there is no class “%s”; choose from: lamps, axis, camera",
                         class_name);
    if (!check_only(call->command))
        return CLI_USAGE;
    if (list) {
        list_checks(call->record);
        return CLI_DONE;
    }
    if (call->n_arguments == 0)
        return cli_usage(call->command,
                         "no program is given: give the path of the program that is the device");
    if (start_s < 0.1 || start_s > 60)
        return cli_usage(call->command, "--start-s=%g: give 0.1 to 60", start_s);
    g_autofree char *path = g_canonicalize_filename(call->arguments[0], NULL);
    if (!g_file_test(path, G_FILE_TEST_IS_EXECUTABLE) || g_file_test(path, G_FILE_TEST_IS_DIR)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                    "%s is not a program that can be run: give its path, and make it executable",
                    path);
        return CLI_FAILED;
    }
    const struct program_command command = {path, (char **)call->arguments + 1, start_s};
    g_autoptr(GPtrArray) needs = g_ptr_array_new_with_free_func(g_free);
    program_need(&command, needs);
    Lock *lock = lock_take(needs->pdata[0], LOCK_ALONE, needs->pdata[0], error);
    struct bench bench;
    if (!lock)
        return CLI_FAILED;
    const int code =
        bench_init(&bench, &command, error) ? run_bench(call, &bench, error) : CLI_FAILED;
    bench_clear(&bench);
    lock_release(lock);
    return code;
}

const struct command programs_conformance = {
    .name = "conformance",
    .arguments = "FILE [ARGUMENT…]",
    .examples = "  mesorig conformance ./my-lamps.py /dev/ttyUSB0\n"
                "  mesorig conformance --min-deg 0 --max-deg 90 ./my-axis.py\n"
                "  mesorig conformance --only trigger --only stop ./my-camera.py\n"
                "  mesorig conformance --list\n",
    .help =
        "Test a program that is a device. Starts the program as mesorigd does, and checks each "
        "promise of docs/build-a-rig/programs.md. Lamps are switched on, an axis is moved, and a "
        "camera takes pictures. Fails if a check fails.",
    .options = entries,
    .max = MAX_ARGUMENTS,
    .run = run_conformance};
