/* mesorig report: independent parsers read the page and the metadata of a session. Faults of a
 * session must be in them. */
#include "calibration/calibration.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "rig/devices.h"
#include "session/made_with.h"

#include <glib/gstdio.h>
#include <json-glib/json-glib.h>
#include <string.h>

static char *in_folder(const struct operation *run, const char *name) {
    g_autofree char *folder = g_path_get_dirname(run->session);
    return g_build_filename(folder, name, NULL);
}

/* The verdict of a check in what --json printed; said: what one of that name must say, or NULL. */
static const char *verdict_of(JsonObject *result, const char *name, const char *said) {
    JsonArray *checks = json_object_get_array_member(result, "checks");
    for (guint i = 0; i < json_array_get_length(checks); i++) {
        JsonObject *check = json_array_get_object_element(checks, i);
        if (strcmp(json_object_get_string_member(check, "name"), name) == 0 &&
            (!said || strstr(json_object_get_string_member(check, "said"), said)))
            return json_object_get_string_member(check, "verdict");
    }
    return "none";
}

/* The object that the last line of a --json call is. */
static JsonParser *parse(const char *text) {
    JsonParser *parser = json_parser_new();
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    const char *last = NULL;
    for (char **line = lines; *line; line++)
        if (g_str_has_prefix(*line, "{\"session\""))
            last = *line;
    g_assert_nonnull(last);
    ok(json_parser_load_from_data(parser, last, -1, ERR));
    return parser;
}

static struct operation *processed(void) {
    static const struct change described[] = {
        {"[session]", "sample = wool <b>& silk</b>"},
        {"[session]", "operator = Ö. \"Perator\""},
        {"[session]", "license = https://creativecommons.org/licenses/by/4.0/"},
        {0}};
    struct operation *run = operator_new(NULL);
    small_rig_write(run->directory, "session.conf", described);
    operator_captures(run, 0);
    operator_does(run, 0, "process", run->session, NULL);
    return run;
}

static void counted(GMarkupParseContext *context, const char *name, const char **names,
                    const char **values, gpointer data, GError **error) {
    int *images = data;
    for (int i = 0; names[i]; i++)
        if (strcmp(name, "img") == 0 && strcmp(names[i], "src") == 0) {
            gsize length;
            g_assert_true(g_str_has_prefix(values[i], "data:image/png;base64,"));
            g_autofree guchar *png = g_base64_decode(strchr(values[i], ',') + 1, &length);
            g_assert_cmpmem(png, 8, "\x89PNG\r\n\x1a\n", 8);
            (*images)++;
        } else {
            /* Nothing comes from elsewhere. */
            g_assert_false(strcmp(names[i], "src") == 0 || strcmp(names[i], "href") == 0);
        }
}

TEST(page) {
    struct operation *run = processed();
    g_autofree char *file = in_folder(run, "report.html");
    operator_does(run, 0, "report", run->session, "-o", file, NULL);
    g_autofree char *text = text_file_read(file);
    assert_has(text, "wool &lt;b&gt;&amp; silk&lt;/b&gt;");
    assert_has(text, "Ö. &quot;Perator&quot;");
    assert_has(text, "<svg");
    g_assert_null(strstr(text, "<b>"));
    /* GMarkup knows neither doctypes nor tags without an end: the table and the figures only. */
    const GMarkupParser parser = {.start_element = counted};
    int images = 0;
    for (char *at = text; (at = strstr(at, "<figure>"));) {
        char *end = strstr(at, "<figcaption>");
        g_assert_nonnull(end);
        g_autofree char *image = g_strndup(at + strlen("<figure>"), (gsize)(end - at) - 8);
        g_autofree char *closed = g_strconcat(image, "</img>", NULL);
        GMarkupParseContext *context = g_markup_parse_context_new(&parser, 0, &images, NULL);
        ok(g_markup_parse_context_parse(context, closed, -1, ERR));
        g_markup_parse_context_free(context);
        at = end;
    }
    /* Two cameras, several pairs of directions, the surface. */
    g_assert_cmpint(images, >=, 2 + 2 + 1);
    operator_free(run);
}

TEST(crate) {
    struct operation *run = processed();
    g_autofree char *file = g_build_filename(run->session, "ro-crate-metadata.json", NULL);
    g_autoptr(JsonParser) parser = json_parser_new();
    operator_does(run, 0, "report", run->session, "--crate", NULL);
    ok(json_parser_load_from_file(parser, file, ERR));
    JsonObject *root = json_node_get_object(json_parser_get_root(parser));
    JsonArray *graph = json_object_get_array_member(root, "@graph");
    g_autoptr(GHashTable) entities = g_hash_table_new(g_str_hash, g_str_equal);
    for (guint i = 0; i < json_array_get_length(graph); i++) {
        JsonObject *entity = json_array_get_object_element(graph, i);
        /* Each once. */
        g_assert_true(g_hash_table_insert(
            entities, (gpointer)json_object_get_string_member(entity, "@id"), entity));
    }
    /* What RO-Crate 1.1 asks for: a descriptor about the root, which has a date and its parts, all
     * of which are entities and lie in the folder. */
    JsonObject *descriptor = g_hash_table_lookup(entities, "ro-crate-metadata.json");
    JsonObject *data = g_hash_table_lookup(entities, "./");
    g_assert_nonnull(descriptor);
    g_assert_nonnull(data);
    g_assert_cmpstr(json_object_get_string_member(
                        json_object_get_object_member(descriptor, "conformsTo"), "@id"),
                    ==, "https://w3id.org/ro/crate/1.1");
    g_assert_nonnull(json_object_get_string_member(data, "datePublished"));
    g_assert_cmpstr(
        json_object_get_string_member(json_object_get_object_member(data, "license"), "@id"), ==,
        "https://creativecommons.org/licenses/by/4.0/");
    JsonArray *parts = json_object_get_array_member(data, "hasPart");
    g_assert_cmpuint(json_array_get_length(parts), >=, 6);
    for (guint i = 0; i < json_array_get_length(parts); i++) {
        const char *id =
            json_object_get_string_member(json_array_get_object_element(parts, i), "@id");
        g_autofree char *path = g_build_filename(run->session, id, NULL);
        JsonObject *part = g_hash_table_lookup(entities, id);
        g_assert_nonnull(part);
        g_assert_true(g_file_test(path, G_FILE_TEST_EXISTS));
        if (!json_object_has_member(part, "sha256"))
            continue;
        const char *argv[] = {"sha256sum", path, NULL};
        g_autofree char *sum = process_text(0, argv);
        g_assert_true(g_str_has_prefix(sum, json_object_get_string_member(part, "sha256")));
    }
    /* The file belongs to the session. */
    operator_does(run, 0, "verify", run->session, NULL);
    operator_free(run);
}

TEST(verdicts) {
    struct operation *run = processed();
    g_autofree char *file = in_folder(run, "report.html");
    g_autofree char *eigenmaps = g_build_filename(run->session, "products/eigenmaps.exr", NULL);
    operator_does(run, 0, "report", run->session, "-o", file, "--json", NULL);
    g_assert_true(strchr(run->out, '\n') == run->out + strlen(run->out) - 1); /* one object */
    g_autoptr(JsonParser) whole = parse(run->out);
    JsonObject *result = json_node_get_object(json_parser_get_root(whole));
    g_assert_cmpstr(verdict_of(result, "shots", NULL), ==, "pass");
    g_assert_cmpstr(verdict_of(result, "files", "frames"), ==, "pass");
    g_assert_cmpstr(verdict_of(result, "calibration", "cameras"), ==, "warning");
    g_assert_cmpstr(json_object_get_string_member(result, "verdict"), ==, "warning");

    g_autofree char *text = text_file_read(eigenmaps);
    g_assert_true(g_file_set_contents(eigenmaps, "another", -1, NULL));
    operator_does(run, 0, "report", run->session, "-o", file, "--json", NULL);
    g_autoptr(JsonParser) damaged = parse(run->out);
    result = json_node_get_object(json_parser_get_root(damaged));
    g_assert_cmpstr(verdict_of(result, "files", "products"), ==, "failure");
    g_assert_cmpstr(json_object_get_string_member(result, "verdict"), ==, "failure");

    /* A view that is gone. */
    g_autofree char *view = g_build_filename(run->session, "products/btf/view_0000.exr", NULL);
    g_assert_cmpint(g_unlink(view), ==, 0);
    operator_does(run, 0, "report", run->session, "-o", file, "--no-verify", "--json", NULL);
    g_autoptr(JsonParser) missing = parse(run->out);
    result = json_node_get_object(json_parser_get_root(missing));
    g_assert_cmpstr(verdict_of(result, "BTF", "mesorig process"), ==, "failure");
    operator_free(run);
}

/* A calibration of the small rig with all of its parts; its path. */
static char *calibration_of(const struct operation *run, const char *name) {
    g_autoptr(GError) error = NULL;
    struct rig rig;
    g_assert_true(devices_read_geometry(run->rig, &rig, &error));
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        calibration_set_part(calibration, (enum calibration_kind)i, name, 7, "abc", NULL);
    char *path = in_folder(run, name);
    g_assert_true(calibration_write(calibration, path, &error));
    return path;
}

/* A session without lasers says nothing of an MDF; a file that compress replaces is told. */
TEST(without_lasers) {
    static const struct change change[] = {{"[lasers]", NULL}, {0}};
    struct operation *run = operator_new(NULL);
    small_rig_write(run->directory, "session.conf", change);
    operator_captures(run, 0);
    operator_does(run, 0, "process", run->session, NULL);
    assert_has(run->out, ": BTF of 4 views");
    g_assert_null(strstr(run->out, "MDF"));
    operator_does(run, 0, "process", run->session, "--json", NULL);
    assert_has(run->out, "\n{\"calibration\"");
    assert_has(run->out, "{\"stage\"");
    operator_does(run, 0, "compress", run->session, "-m", "ptm", NULL);
    g_assert_null(strstr(run->out, "it replaces"));
    operator_does(run, 0, "compress", run->session, "-m", "ptm", NULL);
    assert_has(run->out, "it replaces the “ptm” that Mesorig had written there");
    operator_free(run);
}

/* What info and report say of the calibration; and the value in the database. */
static void calibrated(struct operation *run, const char *info, const char *verdict,
                       const char *page_says, const char *value) {
    g_autofree char *file = in_folder(run, "report.html");
    operator_does(run, 0, "info", run->session, NULL);
    assert_has(run->out, info);
    operator_does(run, 0, "report", run->session, "-o", file, "--no-verify", "--json", NULL);
    g_autoptr(JsonParser) report = parse(run->out);
    JsonObject *result = json_node_get_object(json_parser_get_root(report));
    g_assert_cmpstr(verdict_of(result, "calibration", "cameras"), ==, verdict);
    g_autofree char *text = text_file_read(file);
    assert_has(text, page_says);
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, NULL);
    g_autofree char *is = session_value(session, "products_calibration");
    g_assert_cmpstr(is, ==, value);
    g_autofree char *captured = session_value(session, "calibration");
    g_assert_cmpstr(captured, ==, "nominal");
}

static int report_count_of(const char *text, const char *what) {
    int n = 0;
    for (const char *at = text; (at = strstr(at, what)); at++)
        n++;
    return n;
}

/* Capture and processing in one command say once that nothing is calibrated. */
TEST(told_once) {
    struct operation *run = operator_new(NULL);
    operator_does(run, 0, "capture", run->rig, run->conf, "-o", run->session, "--process", NULL);
    g_assert_cmpint(report_count_of(run->out, "calibration: none"), ==, 1);
    assert_has(run->out, "MDF of");
    operator_free(run);
}

/* The statement about the products is about what they were made with, not the capture. */
TEST(made_with) {
    struct operation *run = operator_new(NULL);
    g_autofree char *path = calibration_of(run, "lab.calibration");
    g_autofree char *line = g_strdup_printf("%s (cameras, lights, laser, radiometry)", path);
    operator_does(run, 0, "plan", run->rig, run->conf, NULL);
    assert_has(run->out, "calibration     none: geometry and light are nominal");
    operator_captures(run, 0);
    assert_has(run->out, "calibration: none: geometry and light are nominal");
    assert_has(run->out, "-c FILE");
    operator_does(run, 0, "process", run->session, NULL);
    assert_has(run->out, "calibration: none");
    assert_has(run->out, "nominal as in the rig file");
    g_assert_null(strstr(run->out, "by the calibration only"));
    calibrated(run, "calibrated none", "warning", "made with: nominal, as", NULL);
    operator_does(run, 0, "process", run->session, "-c", path, NULL);
    assert_has(run->out, line);
    assert_has(run->out, "laser planes: by the calibration only");
    calibrated(run, line, "pass", "lab.calibration, given to mesorig process -c", path);

    /* Another one, whose processing does not come to its end. */
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(run->session, SESSION_PRODUCTS, &error);
    g_assert_no_error(error);
    g_assert_true(made_with_begin(session, NULL, NULL, &error));
    g_clear_pointer(&session, session_close);
    calibrated(run, "may still have been made with another", "warning",
               "may have been made with another", NULL);
    operator_does(run, 0, "process", run->session, NULL);
    calibrated(run, "calibrated none", "warning", "made with: nominal, as", NULL);
    operator_does(run, 0, "info", run->session, "--json", NULL);
    assert_has(run->out, "\"calibration_mixed\": false");
    operator_free(run);
}

TEST(mistakes) {
    struct operation *run = operator_new(NULL);
    operator_does(run, 2, "report", run->session, NULL);
    operator_does(run, 1, "report", run->session, "-o", "/nowhere/report.html", NULL);
    operator_free(run);
}

TESTS_RUN_BY(operator_tests);
