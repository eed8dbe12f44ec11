/* mesorig as a shell sees it: what it prints, and its exit codes, where a transcript
 * (tests/transcripts) is not enough. */
#include "base/json.h"
#include "codecs/codecs.h"
#include "codecs/mdf_codecs/mdf_codec.h"
#include "exr/exr.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "rig/devices.h"
#include "session/session.h"

#include <gio/gio.h>
#include <gio/gunixsocketaddress.h>
#include <glib/gstdio.h>
#include <math.h>
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "lib/long_session.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/wait.h"

#define RIG     SOURCE_DIR "/tests/small/rig.conf"
#define SESSION SOURCE_DIR "/tests/small/session.conf"
#define MESORIG BUILD_DIR "/bin/mesorig"

/* Whether each line is JSON (RFC 8259), as Python reads it. */
static gboolean is_json(const char *text) {
    static const char script[] =
        "import json, os, sys\n"
        "def refuse(word): raise ValueError(word)\n"
        "for line in os.fsencode(sys.argv[1]).decode('utf-8').split('\\n'):\n"
        "    if line: json.loads(line, parse_constant=refuse)\n";
    g_autofree char *problem = NULL;
    const char *const argv[] = {"python3", "-c", script, text, NULL};
    return process_run(argv, NULL, &problem) == 0;
}

static void assert_json_lines(const char *text) {
    g_assert_nonnull(strchr(text, '\n'));
    if (!is_json(text))
        g_error("not JSON: %s", text);
}

struct output {
    char *out, *err;
};

static void clear(struct output *output) {
    g_clear_pointer(&output->out, g_free);
    g_clear_pointer(&output->err, g_free);
}

/* Runs mesorig in a folder with arguments up to NULL. */
static void runs_in(const char *folder, int code, struct output *output,
                    const char *const *arguments) {
    g_autofree const char **argv = process_argv(MESORIG, arguments);
    clear(output);
    const int is = process_run_in(folder, argv, &output->out, &output->err);
    if (is != code)
        g_error("mesorig %s %s: exit code %d, not %d\n%s%s", argv[1],
                argv[1] && argv[2] ? argv[2] : "", is, code, output->out, output->err);
}

#define runs(code, output, ...)                                                                    \
    runs_in(NULL, code, output, (const char *const[]){__VA_ARGS__, NULL})

/* A call that exits with this code and tells this on stdout, or on stderr if it fails. */
struct step {
    int code;
    const char *line; /* arguments with spaces between them */
    const char *has;  /* NULL: whatever it tells */
};

/* What is printed with --json is JSON. output: of the last step. */
static void run_steps(const char *folder, struct output *output, const struct step *steps,
                      gsize n) {
    for (const struct step *step = steps; step < steps + n; step++) {
        g_auto(GStrv) words = g_strsplit(step->line, " ", -1);
        g_test_message("%s", step->line);
        runs_in(folder, step->code, output, (const char *const *)words);
        if (step->has)
            assert_has(step->code == 0 ? output->out : output->err, step->has);
        if (*output->out && g_strv_contains((const char *const *)words, "--json"))
            assert_json_lines(output->out);
    }
}

static char *write_file(const char *folder, const char *name, const char *text) {
    char *path = g_build_filename(folder, name, NULL);
    ok(g_file_set_contents(path, text, -1, ERR));
    return path;
}

TEST(json) {
    static const struct {
        const char *value, *text;
    } cases[] = {
        {"{'a': <1>, 'b': <'x'>}", "{\"a\": 1, \"b\": \"x\"}"},
        {"@a{sv} {}", "{}"},
        {"[1.5, 0.1, -0.0, 1e300]", "[1.5, 0.1, -0, 1e+300]"},
        {"(true, byte 7, int64 -9007199254740993)", "[true, 7, -9007199254740993]"},
        {"'\"\\\\\\n\\t\\u0001é'", "\"\\\"\\\\\\n\\u0009\\u0001é\""},
        {"@ms nothing", "null"},
        {"<uint64 18446744073709551615>", "18446744073709551615"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(GVariant) value = g_variant_parse(NULL, cases[i].value, NULL, NULL, &error);
        g_assert_no_error(error);
        g_autofree char *text = json_text(value);
        g_assert_cmpstr(text, ==, cases[i].text);
        g_assert_true(is_json(text));
    }
    g_autofree char *nan_text = json_text(g_variant_new_double(NAN));
    g_assert_cmpstr(nan_text, ==, "null");
    g_autofree char *inf_text = json_text(g_variant_new_double(-INFINITY));
    g_assert_cmpstr(inf_text, ==, "null");
    g_autoptr(GString) broken = g_string_new(NULL);
    json_append_string(broken, "a\xff"
                               "b");
    g_assert_true(is_json(broken->str));
}

static void assert_method(const char *page, const char *name, const struct option *options,
                          gboolean bounded) {
    g_autoptr(GString) row = g_string_new(NULL);
    g_string_printf(row, "\n.It Cm %s\n", name);
    for (int i = 0; options[i].name; i++)
        g_string_append_printf(row, "%s-%s", i ? " , " : ".Fl ", options[i].name);
    if (bounded)
        g_string_append_printf(row, "%s-memory", options[0].name ? " , " : ".Fl ");
    if (!bounded && !options[0].name)
        g_string_append(row, "no options");
    g_string_append_c(row, '\n');
    if (!strstr(page, row->str))
        g_error("etc/man/mesorig.1 lacks the row of options of a method:%s", row->str);
}

static void assert_written(const char *name, const char *help) {
    if (strstr(help, "TODO"))
        g_error("%s: its help is not written yet: %s", name, help);
}

/* A driver or codec that a script of contrib/ has made has its own help. */
TEST(no_todo) {
    const struct driver_info *driver;
    for (gsize i = 0; codecs[i]; i++)
        assert_written(codecs[i]->name, codecs[i]->help);
    for (gsize i = 0; (driver = devices_driver(i)); i++) {
        assert_written(driver->name, driver->help);
        for (const struct option *option = driver->options; option->name; option++)
            assert_written(driver->name, option->help);
    }
}

/* The page names the command and each option that its --help lists. */
static void assert_in_man_page(const char *page, const char *command, const char *help) {
    g_autoptr(GRegex) option =
        g_regex_new("^  (?:-(\\w), |)--([\\w-]+)", G_REGEX_MULTILINE, 0, NULL);
    g_autoptr(GMatchInfo) match = NULL;
    g_autofree char *row =
        g_strdup_printf("^\\.(It |)Cm (.* Cm |calibrate |queue |)%s\\b", command);
    if (!g_regex_match_simple(row, page, G_REGEX_MULTILINE, 0))
        g_error("etc/man/mesorig.1 does not name the command %s", command);
    g_regex_match(option, help, 0, &match);
    for (; g_match_info_matches(match); g_match_info_next(match, NULL)) {
        g_autofree char *letter = g_match_info_fetch(match, 1);
        g_autofree char *name = g_match_info_fetch(match, 2);
        g_autofree char *pattern =
            g_strdup_printf("\\.?(Fl|,) (-%s%s%s)\\b", name, *letter ? "|" : "", letter);
        if (!g_regex_match_simple(pattern, page, 0, 0))
            g_error("etc/man/mesorig.1 does not name --%s of %s", name, command);
    }
}

/* For every command that mesorig --help lists, and every target of mesorig calibrate. */
TEST(man_page) {
    static const char *const targets[] = {"cameras", "lights", "laser", "radiometry",
                                          "colour",  "show",   "report"};
    static const char *const queue[] = {"add", "list", "remove", "move", "pause", "resume"};
    g_autofree char *page = NULL;
    g_assert_true(g_file_get_contents(SOURCE_DIR "/etc/man/mesorig.1", &page, NULL, NULL));
    for (gsize i = 0; codecs[i]; i++)
        assert_method(page, codecs[i]->name, codecs[i]->options, codecs[i]->bounded);
    for (gsize i = 0; mdf_codecs[i]; i++)
        assert_method(page, mdf_codecs[i]->name, mdf_codecs[i]->options, FALSE);
    struct output output = {0}, all = {0};
    runs(0, &all, "--help");
    g_autoptr(GRegex) command = g_regex_new("^  (\\w+) ", G_REGEX_MULTILINE, 0, NULL);
    g_autoptr(GMatchInfo) match = NULL;
    g_regex_match(command, all.out, 0, &match);
    g_assert_true(g_match_info_matches(match));
    for (; g_match_info_matches(match); g_match_info_next(match, NULL)) {
        g_autofree char *name = g_match_info_fetch(match, 1);
        runs(0, &output, name, "--help");
        const gboolean parent = strcmp(name, "calibrate") == 0 || strcmp(name, "queue") == 0;
        assert_in_man_page(page, name, parent ? "" : output.out);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(targets); i++) {
        runs(0, &output, "calibrate", targets[i], "--help");
        assert_in_man_page(page, targets[i], output.out);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(queue); i++) {
        runs(0, &output, "queue", queue[i], "--help");
        assert_in_man_page(page, queue[i], output.out);
    }
    clear(&output);
    clear(&all);
}

TEST(info) {
    static const struct step steps[] = {
        {0, "info two.exr", "first"},
        {0, "info two.exr", "5 × 3, half, B G R"},
        {0, "info two.exr", "12.5"},
        {0, "info --json two.exr", "\"view.theta_deg\": 12.5"},
        {1, "info broken.exr", "/broken.exr"},
    };
    static const char *const channels[] = {"B", "G", "R", NULL};
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "two.exr", NULL);
    g_autoptr(GError) error = NULL;
    struct output output = {0};
    struct exr_file *file = exr_file_new();
    struct exr_part *part = exr_part_new("first", 5, 3, channels, EXR_HALF);
    g_free(write_file(folder, "broken.exr", "v/1\1\2"));
    exr_set_double(part, "view.theta_deg", 12.5);
    exr_set_string(part, "note", "a \"quote\"");
    exr_file_add(file, part);
    exr_file_add(file, exr_part_new("second", 2, 2, channels, EXR_FLOAT));
    g_assert_true(exr_write(path, file, EXR_ZIP, FALSE, &error));
    exr_file_free(file);
    run_steps(folder, &output, steps, G_N_ELEMENTS(steps));
    clear(&output);
}

/* The history is a PNG of the size it should have, of a session that has one, and of nothing else.
 */
TEST(history) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *session = g_build_filename(folder, "small.session", NULL);
    g_autofree char *png = g_build_filename(folder, "history.png", NULL);
    g_autofree char *nowhere = g_build_filename(folder, "no", "history.png", NULL);
    g_autofree guint8 *bytes = NULL;
    static const guint8 head[24] = "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x05\0\0\0\x03\x20";
    gsize length;
    struct output output = {0};
    runs(0, &output, "capture", RIG, SESSION, "-o", session);
    runs(0, &output, "info", "--history", png, session);
    g_assert_true(g_file_get_contents(png, (char **)&bytes, &length, NULL));
    g_assert_cmpmem(bytes, MIN(length, sizeof head), head, sizeof head);
    runs(1, &output, "info", "--history", nowhere, session);
    assert_has(output.err, nowhere);
    runs(2, &output, "info", "--history", png, png);
    clear(&output);
}

/* Nothing that a session or a file holds makes a terminal do anything. */
TEST(controls) {
    static const char hostile[] = "a\033[2Jb\rc\x07"
                                  "d\xc2\x9b"
                                  "31me\u202ef";
    static const char *const channels[] = {"Y", NULL};
    TEMPORARY_FOLDER(folder);
    g_autofree char *session = g_build_filename(folder, "small.session", NULL);
    g_autofree char *exr = g_build_filename(folder, "a.exr", NULL);
    struct output output = {0};
    runs(0, &output, "capture", RIG, SESSION, "-o", session);
    Session *open = session_open(session, SESSION_PRODUCTS, NULL);
    g_assert_true(session_set_value(open, "imported", hostile, NULL));
    session_close(open);
    struct exr_file *file = exr_file_new();
    exr_file_add(file, exr_part_new(hostile, 2, 2, channels, EXR_HALF));
    g_assert_true(exr_write(exr, file, EXR_ZIP, FALSE, NULL));
    exr_file_free(file);
    const char *const paths[] = {session, exr};
    for (int i = 0; i < 2; i++) {
        runs(0, &output, "info", paths[i]);
        assert_has(output.out, "a\uFFFD[2Jb\uFFFDc\uFFFDd\uFFFD31me\uFFFDf");
        runs(0, &output, "info", "--json", paths[i]);
        assert_has(output.out, "a\\u001b[2Jb\\u000dc\\u0007d\\u009b31m");
        g_assert_true(is_json(output.out));
    }
    runs(1, &output, "info", hostile);
    assert_has(output.err, "a\uFFFD[2Jb\uFFFDc");
    clear(&output);
}

static gboolean count_connection(GSocketService *service, GSocketConnection *connection,
                                 GObject *source, gpointer count) {
    (*(int *)count)++;
    return TRUE;
}

/* mesorig pause of a folder whose control file says so. */
static void ask_pause(const char *folder) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GSubprocess) process =
        g_subprocess_new(G_SUBPROCESS_FLAGS_STDERR_PIPE, &error, MESORIG, "pause", folder, NULL);
    g_assert_no_error(error);
    UNTIL (!g_subprocess_get_identifier(process)) {
        g_main_context_iteration(NULL, FALSE);
        g_usleep(1000);
    }
    g_autofree char *told = NULL;
    g_subprocess_communicate_utf8(process, NULL, NULL, NULL, &told, &error);
    g_assert_cmpint(g_subprocess_get_exit_status(process), ==, 1);
    assert_has(told, "no daemon captures into");
}

/* Somebody else's session leads neither to a host nor, by a link, to another file's address. */
TEST(control) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *control = g_build_filename(folder, "control", NULL);
    g_autofree char *path = g_build_filename(folder, "bus", NULL);
    g_autofree char *address = g_strdup_printf("unix:path=%s\n", path);
    g_autofree char *elsewhere = write_file(folder, "elsewhere", address);
    g_autoptr(GSocketService) service = g_socket_service_new();
    g_autoptr(GSocketAddress) local = g_unix_socket_address_new(path);
    int count = 0;
    const guint16 port =
        g_socket_listener_add_any_inet_port(G_SOCKET_LISTENER(service), NULL, NULL);
    g_assert_true(g_socket_listener_add_address(G_SOCKET_LISTENER(service), local,
                                                G_SOCKET_TYPE_STREAM, G_SOCKET_PROTOCOL_DEFAULT,
                                                NULL, NULL, NULL));
    g_signal_connect(service, "incoming", G_CALLBACK(count_connection), &count);
    g_autofree char *tcp =
        g_strdup_printf("nonce-tcp:host=localhost,port=%d,noncefile=%s\n", port, elsewhere);
    g_autofree char *both = g_strdup_printf("unix:path=/no/such;%s", tcp);
    const char *const hostile[] = {tcp, both};
    for (gsize i = 0; i < G_N_ELEMENTS(hostile); i++) {
        g_assert_true(g_file_set_contents(control, hostile[i], -1, NULL));
        ask_pause(folder);
    }
    g_unlink(control);
    g_assert_cmpint(symlink(elsewhere, control), ==, 0);
    ask_pause(folder);
    g_unlink(control);
    g_assert_cmpint(mkfifo(control, 0600), ==, 0);
    ask_pause(folder);
    g_assert_cmpint(count, ==, 0);
    g_unlink(control);
    g_assert_true(g_file_set_contents(control, address, -1, NULL)); /* this one is followed */
    ask_pause(folder);
    g_assert_cmpint(count, >, 0);
}

/* An output that could not be written is an error for each kind of output: of a command, its JSON,
 * its help. */
TEST(output_full) {
    static const char *const lines[] = {"drivers", "drivers --json", "--help", "--version",
                                        "drivers --help"};
    for (gsize i = 0; i < G_N_ELEMENTS(lines); i++) {
        g_autofree char *script = g_strdup_printf(MESORIG " %s >/dev/full", lines[i]);
        const char *const argv[] = {"/bin/sh", "-c", script, NULL};
        g_autofree char *told = NULL;
        const int code = process_run(argv, NULL, &told);
        g_test_message("%s: %s", lines[i], told);
        g_assert_cmpint(code, ==, 1);
        assert_has(told, "standard output could not be written");
    }
}

/* In a locale that lacks some letters, messages stay readable and JSON stays UTF-8. */
TEST(plain_letters) {
    struct output output = {0};
    g_setenv("LC_ALL", "C", TRUE);
    runs(0, &output, "plan", RIG, SESSION);
    g_assert_null(strchr(output.out, '?'));
    assert_has(output.out, "lower bound");
    runs(2, &output, "no-such");
    assert_has(output.err, "\"no-such\"");
    g_setenv("LC_ALL", "C.UTF-8", TRUE);
    clear(&output);
}

static gboolean has_frames(const char *session) {
    g_autofree char *path = g_build_filename(session, "frames", NULL);
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    return dir && g_dir_read_name(dir);
}

static gboolean is_there(const char *session) {
    return g_file_test(session, G_FILE_TEST_IS_DIR);
}

/* Ctrl-C when begun() says so: what it says is true. */
static void interrupt(gboolean (*begun)(const char *session)) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *session = g_build_filename(folder, "small.session", NULL);
    g_autofree char *conf = long_session_write(folder, LONG_RINGS);
    g_autoptr(GError) error = NULL;
    g_autoptr(GSubprocess) process =
        g_subprocess_new(G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_PIPE, &error,
                         MESORIG, "capture", RIG, SESSION, "-o", session, NULL);
    g_assert_no_error(error);
    UNTIL (begun(session))
        g_usleep(100);
    struct output output = {0};
    g_subprocess_send_signal(process, SIGINT);
    g_autofree char *told = NULL;
    ok(g_subprocess_communicate_utf8(process, NULL, NULL, NULL, &told, ERR));
    if (g_subprocess_get_exit_status(process) == 1) { /* else it was quicker */
        assert_has(told, "mesorig: paused");
        assert_has(told, "mesorig resume");
        runs(0, &output, "info", session);
        assert_has(output.out, "state      paused");
    }
    runs(0, &output, "resume", "--json", session);
    assert_json_lines(output.out);
    runs(0, &output, "info", session);
    assert_has(output.out, "state      done");
    clear(&output);
}

/* In the middle, and before the client has heard that its capture has begun. */
TEST(interrupt) {
    interrupt(has_frames);
    for (int i = 0; i < 3; i++)
        interrupt(is_there);
}

BEFORE_TESTS {
    g_setenv("LC_ALL", "C.UTF-8", TRUE);
    /* Whatever runs on this machine is none of ours. */
    g_setenv("DBUS_SYSTEM_BUS_ADDRESS", "unix:path=/no/such", TRUE);
    g_setenv("DBUS_SESSION_BUS_ADDRESS", "unix:path=/no/such", TRUE);
}
