/* One description gives the text and the JSON of a result. */
#include "common/record.h"
#include "lib/test.h"

#include <locale.h>
#include <stdio.h>
#include <unistd.h>

/* Prints a record into a file, and returns what it has printed; g_free(). */
static char *printed(Record *record, gboolean json) {
    g_autofree char *path = g_build_filename(g_get_tmp_dir(), "mesorig-record-XXXXXX", NULL);
    char *text = NULL;
    const int out = dup(STDOUT_FILENO), file = g_mkstemp(path);
    g_assert_cmpint(file, >=, 0);
    fflush(stdout);
    dup2(file, STDOUT_FILENO);
    record_print(record, json);
    fflush(stdout);
    dup2(out, STDOUT_FILENO);
    close(out);
    close(file);
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    unlink(path);
    return text;
}

static void fill(Record *to) {
    setlocale(LC_ALL, "C.UTF-8");
    record_say(
        to,
        "%s: %d{views} views of %.1f{width_mm} mm, error %.2f{error:%%}, %%, in %g{real_s:time}\n",
        "weave", 81, 12.25, 0.0123, 65.0);
    record_say_if(to, FALSE, "%" G_GINT64_FORMAT "{holes} holes\n", (gint64)1 << 40);
    record_say_if(to, TRUE, "%li{bytes:size}, %g{:time}, %u{n}\n", 2500000L, 3.0, 7U);
    const char *none = NULL;
    record_add(to, "%s{state} %s{reason}", "done", none);
    record_begin_list(to, "devices");
    record_begin(to, NULL);
    record_say(to, "%-6s{name}|%6s{unit}|%+.3f{at}|\n", "θ", "µm", 1.5);
    record_end(to);
    record_end(to);
    g_autoptr(GPtrArray) notes = g_ptr_array_new();
    g_ptr_array_add(notes, (gpointer) "100 %d{x}");
    record_say_strings(to, "notes", "note ", notes);
    record_strings(to, "quiet", notes);
    record_say(to, "at ");
    record_say_doubles(to, "at_mm", "%+.1f", (double[]){0.25, -1, 30}, 3);
    record_say(to, " mm\n");
}

TEST(text) {
    g_autoptr(Record) record = record_new();
    fill(record);
    g_autofree char *text = printed(record, FALSE);
    g_assert_cmpstr(text, ==,
                    "weave: 81 views of 12.2 mm, error 1.23 %, %, in 1 min 05 s\n"
                    "2.5\302\240MB, 3.0 s, 7\n"
                    "θ     |    µm|+1.500|\n"
                    "note 100 %d{x}\n"
                    "at +0.2 -1.0 +30.0 mm\n");
}

TEST(json) {
    g_autoptr(Record) record = record_new();
    fill(record);
    g_autofree char *text = printed(record, TRUE);
    g_assert_cmpstr(text, ==,
                    "{\"views\": 81, \"width_mm\": 12.25, \"error\": 0.0123, \"real_s\": 65, "
                    "\"holes\": 1099511627776, \"bytes\": 2500000, \"n\": 7, \"state\": \"done\", "
                    "\"reason\": \"\", \"devices\": [{\"name\": \"θ\", \"unit\": \"µm\", \"at\": "
                    "1.5}], \"notes\": [\"100 %d{x}\"], \"quiet\": [\"100 %d{x}\"], "
                    "\"at_mm\": [0.25, -1, 30]}\n");
}

/* A record without values prints no JSON, and one without text nothing for people. */
TEST(empty) {
    g_autoptr(Record) values = record_new(), text = record_new();
    record_add(values, "%d{views}", 1);
    record_say(text, "done\n");
    g_autofree char *of_values = printed(values, FALSE), *of_text = printed(text, TRUE);
    g_assert_cmpstr(of_values, ==, "");
    g_assert_cmpstr(of_text, ==, "");
}
