/* “mesorig conformance”: the examples of contrib/ pass. helper.py breaks one promise at a time, and
 * exactly the check of this promise must fail. */
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"

#include <json-glib/json-glib.h>
#include <string.h>

#include "lib/remove_tree.h"

#define HELPER   SOURCE_DIR "/tests/cli/programs/helper.py"
#define EXAMPLES SOURCE_DIR "/contrib/programs/"
#define AT_ONCE  8 /* number of programs that are tested at the same time */

static const struct fault {
    const char *class_name, *fault;
    const char *fails; /* the checks that fail, in their order */
} faults[] = {
    {"lamps", "", ""},
    {"axis", "", ""},
    {"camera", "", ""},
    {"lamps", "version-2", "hello"},
    {"axis", "other-class", "hello"},
    {"camera", "capabilities-as-text", "hello"},
    {"lamps", "serial-as-number", "hello"},
    {"lamps", "counts-itself", "hello"},
    {"lamps", "floods", "hello"},
    {"lamps", "closes-output", "hello"},
    {"lamps", "no-number-of-lamps", "open"},
    {"camera", "new-filter", "open"},
    {"lamps", "late-ping", "ping"},
    {"camera", "reads-one-line", "two-lines"},
    {"lamps", "strict", "further-parameter"},
    {"lamps", "knows-everything", "unknown-method"},
    {"axis", "dies-of-method", "unknown-method"},
    {"camera", "dies-of-line", "malformed-line"},
    {"lamps", "silent-about-line", "malformed-line"},
    {"lamps", "short-get", "get"},
    {"lamps", "lights-at-open", "left-alone"},
    {"axis", "moves-at-open", "left-alone"},
    {"lamps", "switches-neighbour", "set"},
    {"lamps", "switches-all", "set"},
    {"lamps", "ignores-off", "set"},
    {"lamps", "stops-one", "stop"},
    {"lamps", "stops-first", "stop-overtakes"},
    {"lamps", "switches-later", "stop-overtakes"},
    {"axis", "text", "get"},
    {"axis", "no-reference", "home"},
    {"axis", "misses", "move"},
    {"axis", "moving-late", "move"},
    {"axis", "waits-for-the-end", "move"},
    {"axis", "moving-for-ever", "same-place"},
    {"axis", "moves-on", "stop"},
    {"axis", "stops-first", "stop-overtakes"},
    {"camera", "no-file", "trigger"},
    {"camera", "path", "trigger"},
    {"camera", "wider", "trigger"},
    {"camera", "too-bright", "trigger"},
    {"camera", "cut-off", "trigger"},
    {"camera", "answers-early", "trigger"},
    {"camera", "time-of-day", "trigger"},
    {"camera", "old-time", "trigger"},
    {"camera", "no-second-picture", "pictures"},
    {"camera", "repeats-picture", "pictures"},
    {"camera", "repeats-number", "pictures"},
    {"camera", "exposes-half", "exposures"},
    {"camera", "no-gain", "gain"},
    {"camera", "no-answer-to-stop", "stop"},
    {"camera", "picture-of-stop", "stop"},
    {"camera", "no-picture-after-stop", "stop"},
    {"lamps", "stays-at-close", "close"},
    {"lamps", "unsafe-at-close", "close"},
    {"axis", "unsafe-at-close", "close"},
    {"camera", "stays-at-close", "close"},
    {"camera", "stays-at-end", "end-of-input"},
    {"lamps", "unsafe-at-end", "end-of-input"},
    {"axis", "unsafe-at-end", "end-of-input"},
    {"lamps", "starts-once", "restart"},
    {"camera", "exposed-early", "events"},
    {"camera", "exposed-twice", "events"},
    {"axis", "reports-loss", "events"},
    {"lamps", "chatters", "output"},
    {"lamps", "answers-twice", "output"},
    {"camera", "no-jsonrpc", "output"},
    /* The check “silence” takes 12 s, and is run only for these. */
    {"lamps", "deaf-to-silence", "silence"},
    {"axis", "impatient", "silence"},
    {"lamps", "unsafe-in-silence", "silence"},
};

static JsonObject *read_report(const char *text) {
    g_autoptr(GError) error = NULL;
    g_autoptr(JsonNode) root = json_from_string(text, &error);
    if (!root || !JSON_NODE_HOLDS_OBJECT(root) ||
        !json_object_has_member(json_node_get_object(root), "checks"))
        g_error("no report: %s", text);
    return json_object_ref(json_node_get_object(root));
}

/* Returns the names of the checks with a result, separated by blanks; g_free(). */
static char *checks_that(JsonObject *report, const char *result) {
    g_autoptr(GPtrArray) names = g_ptr_array_new();
    JsonArray *checks = json_object_get_array_member(report, "checks");
    for (guint i = 0; i < json_array_get_length(checks); i++) {
        JsonObject *check = json_array_get_object_element(checks, i);
        if (g_str_equal(json_object_get_string_member(check, "result"), result))
            g_ptr_array_add(names, (gpointer)json_object_get_string_member(check, "check"));
    }
    g_ptr_array_add(names, NULL);
    return g_strjoinv(" ", (char **)names->pdata);
}

/* Returns the names of all checks of a class, which are asked for once. */
static const GPtrArray *names_of(const char *class_name) {
    static GHashTable *known;
    known = known ? known : g_hash_table_new(g_str_hash, g_str_equal);
    GPtrArray *names = g_hash_table_lookup(known, class_name);
    if (names)
        return names;
    g_autofree char *text = process_mesorig(0, "conformance --list --class %s --json", class_name);
    g_autoptr(JsonObject) report = read_report(text);
    JsonArray *checks = json_object_get_array_member(report, "checks");
    names = g_ptr_array_new();
    for (guint i = 0; i < json_array_get_length(checks); i++)
        g_ptr_array_add(names, g_strdup(json_object_get_string_member(
                                   json_array_get_object_element(checks, i), "check")));
    g_assert_cmpuint(names->len, >, 15);
    g_hash_table_insert(known, (gpointer)class_name, names);
    return names;
}

/* Appends the options that choose all checks but “silence”, or this check alone. */
static void choose(const struct fault *fault, GPtrArray *argv) {
    const GPtrArray *names = names_of(fault->class_name);
    const gboolean silence = g_str_equal(fault->fails, "silence");
    for (guint i = 0; i < names->len; i++) {
        if (g_str_equal(names->pdata[i], "silence") != silence)
            continue;
        g_ptr_array_add(argv, (gpointer) "--only");
        g_ptr_array_add(argv, names->pdata[i]);
    }
}

static GSubprocess *start(const struct fault *fault, const char *folder) {
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_autoptr(GError) error = NULL;
    const char *const first[] = {BUILD_DIR "/bin/mesorig", "conformance",        "--json",
                                 "--start-s=10",           "--min-deg=0",        "--max-deg=60",
                                 "--speed-deg-s=30",       "--accel-deg-s2=1000"};
    const char *const last[] = {"--", HELPER, fault->class_name, folder, fault->fault, NULL};
    for (gsize i = 0; i < G_N_ELEMENTS(first); i++)
        g_ptr_array_add(argv, (gpointer)first[i]);
    if (g_str_equal(fault->fault, "waits-for-the-end")) /* longer than an answer may take */
        g_ptr_array_add(argv, (gpointer) "--speed-deg-s=10");
    if (*fault->fault) { /* a good program says its class */
        g_ptr_array_add(argv, (gpointer) "--class");
        g_ptr_array_add(argv, (gpointer)fault->class_name);
    }
    choose(fault, argv);
    for (gsize i = 0; i < G_N_ELEMENTS(last); i++)
        g_ptr_array_add(argv, (gpointer)last[i]);
    GSubprocess *process = g_subprocess_newv(
        (const char *const *)argv->pdata,
        G_SUBPROCESS_FLAGS_STDOUT_PIPE | G_SUBPROCESS_FLAGS_STDERR_SILENCE, &error);
    g_assert_no_error(error);
    return process;
}

static void finish(const struct fault *fault, GSubprocess *process) {
    g_autofree char *out = NULL;
    g_assert_true(g_subprocess_communicate_utf8(process, NULL, NULL, &out, NULL, NULL));
    g_autoptr(JsonObject) report = read_report(out);
    g_autofree char *failed = checks_that(report, "failed");
    g_assert_cmpstr(json_object_get_string_member(report, "class"), ==, fault->class_name);
    if (!g_str_equal(failed, fault->fails)) {
        g_test_message("%s %s: “%s” fails instead of “%s”: %s", fault->class_name, fault->fault,
                       failed, fault->fails, out);
        g_test_fail();
    }
    g_assert_cmpint(g_subprocess_get_exit_status(process), ==, *failed ? 1 : 0);
    g_object_unref(process);
}

/* No process of the helper is left behind, also of one that does not want to end. */
static void expect_no_process(const char *folder) {
    g_autoptr(GArray) found = process_find("cmdline", folder);
    g_assert_cmpuint(found->len, ==, 0);
}

TEST(faults) {
    for (gsize i = 0; i < G_N_ELEMENTS(faults); i += AT_ONCE) {
        char *folders[AT_ONCE] = {NULL};
        GSubprocess *processes[AT_ONCE] = {NULL};
        const gsize n = MIN(AT_ONCE, G_N_ELEMENTS(faults) - i);
        for (gsize k = 0; k < n; k++) {
            folders[k] = g_dir_make_tmp("mesorig-helper-XXXXXX", NULL);
            processes[k] = start(&faults[i + k], folders[k]);
        }
        for (gsize k = 0; k < n; k++) {
            finish(&faults[i + k], processes[k]);
            expect_no_process(folders[k]);
            remove_tree(folders[k]);
            g_free(folders[k]);
        }
    }
}

/* Each check of each class is failed by a fault. */
TEST(all_checks) {
    static const char *const classes[] = {"lamps", "axis", "camera"};
    g_autoptr(GHashTable) failed = g_hash_table_new(g_str_hash, g_str_equal);
    for (gsize i = 0; i < G_N_ELEMENTS(faults); i++)
        g_hash_table_add(failed, (gpointer)faults[i].fails);
    for (gsize c = 0; c < G_N_ELEMENTS(classes); c++) {
        const GPtrArray *names = names_of(classes[c]);
        for (guint i = 0; i < names->len; i++)
            if (!g_hash_table_contains(failed, names->pdata[i]))
                g_error("no fault for the check %s", (const char *)names->pdata[i]);
    }
}

static void expect_passed(const char *text, int n) {
    g_autoptr(JsonObject) report = read_report(text);
    g_autofree char *failed = checks_that(report, "failed");
    g_assert_cmpstr(failed, ==, "");
    g_assert_cmpint(json_object_get_int_member(report, "passed"), ==, n);
}

TEST(lamp_examples) {
    static const char *const programs[] = {"gpio-lamp.py", "gpio-lamp.sh"};
    for (gsize i = 0; i < G_N_ELEMENTS(programs); i++) {
        TEMPORARY_FOLDER(folder);
        g_autofree char *pin = g_build_filename(folder, "pin", NULL), *state = NULL;
        g_assert_true(g_file_set_contents(pin, "0", -1, NULL));
        g_autofree char *text = process_mesorig(
            0, "conformance --json --start-s=10 " EXAMPLES "%s %s", programs[i], pin);
        expect_passed(text, 17);
        g_assert_true(g_file_get_contents(pin, &state, NULL, NULL));
        g_assert_cmpint(*state, ==, '0');
    }
}

/* With programs that write files as rpicam-still and dcraw do. */
static void write_program(const char *folder, const char *name, const char *text) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_assert_true(g_file_set_contents_full(path, text, -1, G_FILE_SET_CONTENTS_NONE, 0755, NULL));
}

TEST(camera_example) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *before = g_strdup(g_getenv("PATH"));
    g_autofree char *path = g_strconcat(folder, ":", before, NULL);
    write_program(folder, "rpicam-still",
                  "#!/usr/bin/python3\nimport sys, time\n"
                  "time.sleep(int(sys.argv[sys.argv.index('--shutter') + 1]) / 1e6)\n"
                  "open('a.dng', 'w').close()\n");
    write_program(
        folder, "dcraw",
        "#!/usr/bin/python3\nimport random, struct, sys\n"
        "values = [random.randrange(4096) for i in range(8)]\n"
        "sys.stdout.buffer.write(b'P5\\n4 2\\n65535\\n' + struct.pack('>8H', *values))\n");
    g_setenv("PATH", path, TRUE);
    g_autofree char *text =
        process_mesorig(0, "conformance --json --start-s=10 " EXAMPLES "rpicam.py 4 2 bggr 12 256");
    g_setenv("PATH", before, TRUE);
    expect_passed(text, 15);
}
