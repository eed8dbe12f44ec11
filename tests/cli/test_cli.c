/* mesorig as a shell sees it: what it prints, and its exit codes. */
#include "base/json.h"
#include "codecs/codecs.h"
#include "exr/exr.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "mdf_codecs/mdf_codec.h"
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
static void run_n_steps(const char *folder, struct output *output, const struct step *steps,
                        gsize n) {
    for (gsize i = 0; i < n; i++) {
        const struct step *step = &steps[i];
        g_auto(GStrv) words = g_strsplit(step->line, " ", -1);
        g_test_message("%s", step->line);
        runs_in(folder, step->code, output, (const char *const *)words);
        if (step->has)
            assert_has(step->code == 0 ? output->out : output->err, step->has);
        if (*output->out && g_strv_contains((const char *const *)words, "--json"))
            assert_json_lines(output->out);
    }
}

#define run_steps(folder, output, steps) run_n_steps(folder, output, steps, G_N_ELEMENTS(steps))

static void assert_exists(const char *folder, const char *name) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_assert_true(g_file_test(path, G_FILE_TEST_EXISTS));
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

TEST(usage) {
    static const char *const commands[] = {"plan",  "capture", "resume",   "status",   "watch",
                                           "pause", "abort",   "safe",     "continue", "process",
                                           "info",  "drivers", "compress", "verify"};
    static const struct step steps[] = {
        {0, "--version", "mesorig " MESORIG_VERSION},
        {2, "develop", "develop"},
        {2, "captur " RIG, "no command “captur”: did you mean “capture”?"},
        {2, "proces S", "did you mean “process”?"},
        {2, "sing S", "no command “sing”; “mesorig --help” lists them"},
        {2, "check S --strct", "Unknown option --strct; did you mean --strict?"},
        {2, "check S --strct=yes", "did you mean --strict?"},
        {2, "compress S -s 4500B", "Unknown option -s; did you mean --size?"},
        {2, "compress S -c 4", "Unknown option -c; did you mean --components or --colours?"},
        {2, "compress S -x", "Unknown option -x\n"},
        {2, "calibrate camras", "there is no “calibrate camras”; did you mean “cameras”?"},
        {2, "plan " RIG " " SESSION " --adress=x", "did you mean --address?"},
        {2, "move arc -15", "as in “mesorig move -- … -15”: Unknown option -15"},
        {0, "capture --help", "  mesorig capture rig.conf session.conf -o weave.session\n"},
        {0, "snap --help", "Examples:\n  mesorig snap cam45 --lamp lamp30\n"},
        {2, "plan " RIG},
        {2, "capture " RIG " " SESSION, "-o"},
        {2, "status --bus=coach"},
        {2, "status --bus=system --address=unix:path=/x"},
    };
    struct output output = {0};
    runs(2, &output, NULL);
    assert_has(output.out, "\nCapture a session:\n");
    run_steps(NULL, &output, steps);
    for (gsize i = 0; i < G_N_ELEMENTS(commands); i++) {
        runs(0, &output, "--help");
        assert_has(output.out, commands[i]);
        runs(0, &output, commands[i], "--help");
        assert_has(output.out, "--json");
        runs(2, &output, commands[i], "--nonsense");
        assert_has(output.err, "--nonsense");
        runs(2, &output, commands[i], "a", "b", "c", "d");
    }
    clear(&output);
}

static void assert_method(const char *page, const char *name, const struct option *options,
                          gboolean bounded) {
    g_autoptr(GString) row = g_string_new(NULL);
    g_string_printf(row, "\n.It Cm %s\n", name);
    for (int i = 0; options[i].name; i++)
        g_string_append_printf(row, "%s-%s", i ? " , " : ".Fl ", options[i].name);
    if (bounded)
        g_string_append_printf(row, "%s-memory", options[0].name ? " , " : ".Fl ");
    if (bounded || options[0].name)
        g_string_append_c(row, '\n');
    if (!strstr(page, row->str))
        g_error("etc/man/mesorig.1 lacks the row of options of a method:%s", row->str);
}

/* The manual page has a row for each method of compress, with the options of its table, and names
 * every option of every command. */
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

TEST(drivers) {
    static const struct step steps[] = {
        {0, "drivers", "sim-axis"},
        {0, "drivers", "sim-camera"},
        {0, "drivers sim-axis", "speed_deg_s"},
        {0, "drivers --json"},
        {0, "drivers", "“mesorig drivers NAME” lists the options"},
        {1, "drivers steam", "there is no driver “steam”; “mesorig drivers” lists them"},
        {1, "drivers modbus-axs", "did you mean “modbus-axis”?"},
        {1, "drivers steam --json"},
    };
    struct output output = {0};
    run_steps(NULL, &output, steps);
    assert_has(output.out, "\"error\"");
    clear(&output);
}

TEST(plan) {
    static const struct step steps[] = {
        {0, "plan " RIG " " SESSION, "4 views, 4 lights, 2 laser positions"},
        {0, "plan " RIG " " SESSION, "lower bound"},
        {0, "plan --json " RIG " " SESSION, "\"predicted_s\""},
        {1, "plan bad_rig.conf " SESSION, "/bad_rig.conf:3"},
        {1, "plan " RIG " bad_session.conf", "/bad_session.conf:"},
        {1, "plan binary.conf " SESSION, "/binary.conf"},
        {1, "plan " RIG " binary.conf --json"},
        {1, "plan /no/such/rig.conf " SESSION, "/no/such/rig.conf"},
        {1, "plan " RIG " ."},
        {1, "capture bad_rig.conf " SESSION " -o x", "/bad_rig.conf:3"},
    };
    g_autofree char *folder = g_dir_make_tmp("mesorig-cli-XXXXXX", NULL);
    struct output output = {0};
    g_free(write_file(folder, "bad_rig.conf",
                      "[rig]\nid = x\narc_radius_mm = NaN\narc_width_mm = 30\n"));
    g_free(
        write_file(folder, "bad_session.conf", "[session]\nname = x\n\n[views]\nrings = 99:x\n"));
    g_free(write_file(folder, "binary.conf", "\x01\x02\xff\xfe[[["));
    run_steps(folder, &output, steps);
    clear(&output);
    remove_tree(folder);
}

TEST(info) {
    static const struct step steps[] = {
        {0, "info two.exr", "first"},
        {0, "info two.exr", "5 × 3, half, B G R"},
        {0, "info two.exr", "12.5"},
        {0, "info --json two.exr", "\"view.theta_deg\": 12.5"},
        {1, "info broken.exr", "/broken.exr"},
        {1, "info ."},
        {1, "info /no/such"},
        {1, "process ."},
        {1, "resume ."},
        {1, "status --address=unix:path=/no/such"},
        {1, "pause ."},
    };
    static const char *const channels[] = {"B", "G", "R", NULL};
    g_autofree char *folder = g_dir_make_tmp("mesorig-cli-XXXXXX", NULL);
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
    run_steps(folder, &output, steps);
    clear(&output);
    remove_tree(folder);
}

/* Every way to compress what was processed; the errors are compared in test_lpca. */
static const struct step compress_steps[] = {
    {0, "compress S -k 3 --components 2", "3 clusters of 2 components"},
    {0, "info S/products/lpca.exr", "clusters × components 3 × 2 in half, of "},
    {0, "compress --json S/products/btf -k 2 --error 50% -q 8bit -o other.exr --force",
     "\"clusters\": 2"},
    {0, "info other.exr"},
    {0, "compress S -m eigenmaps --components 1 -o other.exr --force", "1 eigen-maps"},
    {0, "compress S -m eigenmaps -o matrix.exr"},
    /* A view takes 3 kB as floats. */
    {0, "compress S -m eigenmaps --memory 7kB --components 1 -o other.exr --force", "1 eigen-maps"},
    {1, "compress S -m eigenmaps --memory 5kB --components 1 -o other.exr --force", "allow more"},
    {0, "compress S -m eigenmaps --error 99% -o other.exr --force", "1 eigen-maps"},
    {1, "compress S -m eigenmaps --error 0.0001% --components 1 -o other.exr --force",
     "is not reached with 1 eigen-maps"},
    {2, "compress S -m ptm --memory 7kB"},
    {1, "compress S -k 1 --components 1 --error 0.0001%", "is not reached"},
    {1, "compress S -o /no/such/folder/x.exr"},
    {1, "compress ."},
    {0, "compress S --method fields --components 1", "fields of 1 lobe, luminance off by"},
    {0, "info S/products/fields.exr", "fields of 1 lobe: 8 × 8 texels, of 4 views × 4 lights"},
    {0, "compress --json S -m ashikhmin", "\"method\": \"ashikhmin\""},
    {0, "compress S -m ptm --mips -o other.exr --force", "ptm, 4 mip levels, luminance off by"},
    {2, "compress S -m eigenmaps --mips -o other.exr"},
    {1, "compress S -m ptm --error 0.0001%"},
    {1, "compress S -m fields --components 4"},
    {2, "compress S -m ward -k 2"},
    {0, "compress S --grid 5 -k 1 --components 1 -o other.exr --force",
     "1 cluster of 1 component on a grid of 5"},
    {0, "compress --json S --size 20kB -o other.exr --force"},
    {1, "compress S --size 10B -o other.exr --force"},
    {0, "compress S -q packed --error 40% -o other.exr --force", "on disk, 1:"},
    {0, "compare S other.exr"},
    {0, "compress S -q packed --size 4500B -o packed.exr"},
    {2, "compress S --memory little"},
    {2, "compress S --colours xyz"},
    {2, "compress S --colours log --grid 8"},
    {2, "compress S --memory 60MB --mips"},
    {2, "compress S --size large"},
    {2, "compress S --size 20kB -k 2"},
    {2, "compress S --grid 1000"},
    {2, "compress S --grid 8 -m ptm"},
    {2, "compress S -m wavelets"},
    {2, "compress S -m eigenmaps"},
    {2, "compress S --error many"},
    {2, "compress S -q 4bit"},
    {2, "compress S -k 0"},
    {0, "compare S S/products/fields.exr --plot plot.png", "of R, G, B relative to A"},
    {0, "compare --json S S/products/lpca.exr"},
    {2, "compress S -q packed -o other.exr"},
    {2, "compress S -q packed --error 40% --mips -o other.exr"},
    {0, "compress S --mips -k 2 --components 1 -o other.exr --force",
     "2 clusters of 1 component, 4 mip levels"},
    {0,
     "compress S --memory 60MB --colours log -k 1 --components 1 -q 8bit-weights -o other.exr "
     "--force",
     "1 cluster of 1 component"},
    {1, "compress S --memory 1kB -k 1 --components 1 -o other.exr --force", "of memory, not"},
};

/* With packed.exr cut short. */
static const struct step cut_steps[] = {
    {1, "info packed.exr", "not a valid EXR file"},
    {1, "compare S packed.exr"},
    {0, "compare --json S --curve curve.svg", "\"series\": \"local PCA, packed\", \"label\": \""},
    {1, "compare S S/products/fields.exr --plot /no/such/folder/x.png"},
    {1, "compare S S/products/fields.exr --plot plot.jpg"},
    {1, "compare S/products/fields.exr --curve curve.svg"},
    {2, "compare S"},
    {2, "compare S S/products/fields.exr --curve curve.svg"},
    {0, "compare S --curve curve.svg", "reflectance fields"},
};

static void test_compress(const char *folder) {
    g_autofree char *maps = g_build_filename(folder, "S", "products", "eigenmaps.exr", NULL);
    g_autofree char *matrix = g_build_filename(folder, "matrix.exr", NULL);
    g_autofree char *file = g_build_filename(folder, "packed.exr", NULL);
    g_autofree char *from_views = NULL, *from_matrix = NULL, *packed = NULL;
    gsize n_views = 0, n_matrix = 0, n_packed = 0;
    struct output output = {0};
    run_steps(folder, &output, compress_steps);
    /* What is told is enough. */
    g_autoptr(GRegex) pattern = g_regex_new("take ([0-9.]+)\\s([kM]B)", 0, 0, NULL);
    g_autoptr(GMatchInfo) match = NULL;
    g_assert_true(g_regex_match(pattern, output.err, 0, &match));
    g_autofree char *enough = g_match_info_expand_references(
        match, "compress S --memory \\1\\2 -k 1 --components 1 -o other.exr", NULL);
    g_match_info_free(g_steal_pointer(&match));
    run_n_steps(folder, &output, &(const struct step){0, enough}, 1);
    /* The same from the matrix as from the views one by one. */
    g_assert_true(g_file_get_contents(maps, &from_views, &n_views, NULL));
    g_assert_true(g_file_get_contents(matrix, &from_matrix, &n_matrix, NULL));
    g_assert_cmpmem(from_matrix, n_matrix, from_views, n_views);
    g_assert_true(g_file_get_contents(file, &packed, &n_packed, NULL));
    g_assert_cmpuint(n_packed, <=, 4500);
    g_assert_true(g_file_set_contents(file, packed, (gssize)n_packed - 10, NULL));
    run_steps(folder, &output, cut_steps);
    assert_has(output.out, "local PCA, 8 bits");
    assert_has(output.out, "local PCA, packed");
    assert_exists(folder, "S/products/lpca.exr");
    assert_exists(folder, "plot.png");
    assert_exists(folder, "curve.svg");
    clear(&output);
}

/* What a BTF and an MDF say of themselves; the figures are compared in test_energy. */
static void test_check(const char *folder) {
    static const struct step steps[] = {
        {0, "check S --plot energy.svg", "of a light's energy is reflected"},
        {0, "check S --plot energy.svg", "is confirmed by others"},
        {0, "check --json S", "\"largest_albedo\""},
        {0, "check --json S", "\"mdf_confirmed\""},
        {1, "check S --plot plot.jpg"},
        {1, "check .", "mesorig process"},
        {2, "check"},
    };
    struct output output = {0};
    run_steps(folder, &output, steps);
    assert_exists(folder, "energy.svg");
    clear(&output);
}

TEST(capture) {
    static const struct step steps[] = {
        {0, "capture " RIG " " SESSION " -o S", "done: "},
        {0, "info S", "state      done"},
        {0, "info --json S"},
        {0, "process S", "done in"},
        {0, "process --json S"},
    };
    g_autofree char *folder = g_dir_make_tmp("mesorig-cli-XXXXXX", NULL);
    g_autofree char *session = g_build_filename(folder, "S", NULL);
    g_autofree char *control = g_build_filename(session, "control", NULL);
    struct output output = {0};
    run_n_steps(folder, &output, steps, 1);
    assert_has(output.out, "done: ");
    g_assert_null(strstr(output.out, " %, ")); /* progress is no result */
    g_assert_false(g_file_test(control, G_FILE_TEST_EXISTS));
    runs(1, &output, "capture", RIG, SESSION, "-o", session);
    assert_has(output.err, session);
    run_n_steps(folder, &output, steps + 1, G_N_ELEMENTS(steps) - 1);
    test_compress(folder);
    test_check(folder);

    /* A stale control file, as a killed daemon leaves it. */
    g_autofree char *stale = write_file(session, "control", "unix:path=/no/such/socket\n");
    runs(0, &output, "status", session);
    assert_has(output.out, "state      done");
    runs(1, &output, "pause", session);
    assert_has(output.err, "resume");
    clear(&output);
    remove_tree(folder);
}

/* The history is a PNG of the size it should have, of a session that has one, and of nothing else.
 */
TEST(history) {
    g_autofree char *folder = g_dir_make_tmp("mesorig-cli-XXXXXX", NULL);
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
    remove_tree(folder);
}

/* Nothing that a session or a file holds makes a terminal do anything. */
TEST(controls) {
    static const char hostile[] = "a\033[2Jb\rc\x07"
                                  "d\xc2\x9b"
                                  "31me\u202ef";
    static const char *const channels[] = {"Y", NULL};
    g_autofree char *folder = g_dir_make_tmp("mesorig-cli-XXXXXX", NULL);
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
    remove_tree(folder);
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
    const gint64 until = g_get_monotonic_time() + 30 * G_USEC_PER_SEC;
    while (g_subprocess_get_identifier(process)) {
        if (g_get_monotonic_time() > until) {
            g_subprocess_force_exit(process);
            g_error("mesorig pause %s hangs", folder);
        }
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
    g_autofree char *folder = g_dir_make_tmp("mesorig-cli-XXXXXX", NULL);
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
    remove_tree(folder);
}

/* What could not be written is told, whoever wrote it: a command, its JSON, its help. */
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

/* In a locale without its letters, what is said stays readable, and JSON stays UTF-8. */
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
    g_autofree char *folder = g_dir_make_tmp("mesorig-cli-XXXXXX", NULL);
    g_autofree char *session = g_build_filename(folder, "small.session", NULL);
    g_autofree char *conf = long_session_write(folder, LONG_RINGS);
    g_autoptr(GError) error = NULL;
    g_autoptr(GSubprocess) process =
        g_subprocess_new(G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_PIPE, &error,
                         MESORIG, "capture", RIG, SESSION, "-o", session, NULL);
    g_assert_no_error(error);
    const gint64 until = g_get_monotonic_time() + 60 * G_USEC_PER_SEC;
    while (!begun(session)) {
        g_assert_cmpint(g_get_monotonic_time(), <, until);
        g_usleep(100);
    }
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
    remove_tree(folder);
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
