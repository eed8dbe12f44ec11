/* Text tables as spreadsheets write them, and the errors for mistakes in them. */
#include "base/config.h"
#include "base/data_error.h"
#include "base/input_file.h"
#include "base/text_table.h"
#include "btf/btf_directions.h"

#include "lib/ok.h"
#include "lib/process.h"
#include "lib/session_fixture.h"
#include "lib/test.h"

static TextTable *read_bytes(const char *bytes, gsize length, GError **error) {
    g_autofree char *path = g_build_filename(session_fixture_folder, "table.csv", NULL);
    g_assert_true(g_file_set_contents(path, bytes, (gssize)length, NULL));
    return text_table_read(path, error);
}

/* The same table in the forms that programs save it in. */
TEST(forms) {
    static const char *const forms[] = {
        "file,exposure_ms,camera\na.png,0.25,cam\nb.png,1.5,cam\n",
        "\xef\xbb\xbf"
        "file,exposure_ms,camera\r\na.png,0.25,cam\r\nb.png,1.5,cam\r\n",
        "file;exposure_ms;camera\na.png;0,25;cam\nb.png;1.5;cam\n",
        "file\texposure_ms\tcamera\na.png\t0,25\tcam\nb.png\t1,5\tcam\n",
        "file,exposure_ms,camera\ra.png,0.25,cam\rb.png,1.5,cam\r",
        "file;exposure_ms;camera;;\na.png;0,25;cam;;\n;;;;\nb.png;1,5;cam;;\n;;;;\n",
        "\"file\",\"exposure_ms\",\"camera\"\n# a row\na.png,\"0.25\",cam\nb.png,1.5,cam",
        "file,\texposure_ms,\tcamera\na.png,\t0.25,\tcam\nb.png,\t1.5,\tcam\n",
    };
    for (gsize i = 0; i < G_N_ELEMENTS(forms); i++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(TextTable) table = read_bytes(forms[i], strlen(forms[i]), &error);
        double first = 0, second = 0;
        g_assert_no_error(error);
        g_assert_cmpint(text_table_rows(table), ==, 2);
        g_assert_cmpint(text_table_column(table, "file"), ==, 0);
        const int column = text_table_column(table, "exposure_ms");
        g_assert_true(text_table_number(table, 0, column, 7, &first, &error));
        g_assert_true(text_table_number(table, 1, column, 7, &second, &error));
        g_assert_cmpfloat(first, ==, 0.25);
        g_assert_cmpfloat(second, ==, 1.5);
        g_assert_cmpstr(text_table_text(table, 1, text_table_column(table, "camera")), ==, "cam");
    }
    /* A cell at the right that is empty is a cell. */
    g_autoptr(TextTable) table = read_bytes("a\tb\n1\t\n", 6, NULL);
    g_assert_cmpstr(text_table_text(table, 0, 1), ==, "");
}

static void refused(const char *bytes, gsize length, const char *what) {
    g_autoptr(GError) error = NULL;
    g_autoptr(TextTable) table = read_bytes(bytes, length, &error);
    double value;
    if (table)
        text_table_number(table, 0, 1, 0, &value, &error);
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    assert_has(error->message, what);
}

TEST(refused) {
    static const char *const bad[][2] = {
        {"a,b\nx,0,25\n",
         "table.csv:2: this line has 3 fields, but the header line has 2; if its numbers "
         "have decimal commas, separate fields by semicolons or tabs"},
        {"a,b\nx,\"0,25\"\n", "“0,25” in column b is not a number; write a decimal point"},
        {"a;b\nx;1.234,5\n", "“1.234,5” in column b is not a number"},
        {"a,,b\nx,y,z\n", "table.csv:1: column 2 has no name"},
        {"a,a\nx,y\n", "table.csv:1: there are two columns “a”; rename or remove one of them"},
        {"a,b\n\"x,y\n", "table.csv:2: a field begins with a double quote, but none ends it"},
        {"a,b\n,\n", "the table has no rows below its header line"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++)
        refused(bad[i][0], strlen(bad[i][0]), bad[i][1]);
    refused("\xff\xfe"
            "a\0,\0b\0",
            8, "it is a text in UTF-16; save it as UTF-8");
    refused("\xfe\xff\0a\0,\0b", 8, "it is a text in UTF-16; save it as UTF-8");
    refused("a\0,\0b\0\n\0", 8, "it is a text in UTF-16; save it as UTF-8");
    refused("a,b\n1\0,2\n", 9, "it is not a text file");
}

TEST(columns) {
    static const char *const known[] = {"file", "exposure_ms", "black_level", NULL};
    static const char *const bad[][2] = {
        {"exposure",
         "table.csv:1: the column “exposure” is not known; did you mean “exposure_ms”?"},
        {"Exposure_ms", "did you mean “exposure_ms”?"},
        {"blacklevel", "did you mean “black_level”?"},
        {"operator",
         "the column “operator” is not known; remove it. The columns are file, exposure_ms, "
         "black_level"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *text = g_strdup_printf("file,%s\na.png,1\n", bad[i][0]);
        g_autoptr(TextTable) table = read_bytes(text, strlen(text), &error);
        g_assert_no_error(error);
        g_assert_false(text_table_check_columns(table, known, &error));
        assert_has(error->message, bad[i][1]);
    }
}

TEST(directions) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = g_build_filename(session_fixture_folder, "directions.csv", NULL);
    static const char good[] = "\xef\xbb\xbf"
                               "of;theta_deg;phi_deg\r\nboth;12,5;0\r\n";
    g_assert_true(g_file_set_contents(path, good, -1, NULL));
    struct btf_directions *read = ok(btf_directions_read(path, ERR));
    g_assert_cmpfloat((double)read->views.theta_deg[0], ==, 12.5);
    btf_directions_free(read);
    g_assert_true(g_file_set_contents(path, "of,theta_deg,phi\nboth,0,0\n", -1, NULL));
    g_assert_null(btf_directions_read(path, &error));
    assert_has(error->message, "the column “phi” is not known");
}

/* Configuration files say it in the same words. */
TEST(config) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = g_build_filename(session_fixture_folder, "rig.conf", NULL);
    g_assert_true(g_file_set_contents(path, "\xff\xfe[\0r\0]\0", 8, NULL));
    g_assert_null(config_load(path, &error));
    assert_has(error->message, "rig.conf:1: it is a text in UTF-16; save it as UTF-8");
    g_clear_error(&error);
    g_assert_true(g_file_set_contents(path, INPUT_FILE_MARK "[rig]\nid = a\n", -1, NULL));
    g_autoptr(Config) config = config_load(path, &error);
    g_assert_no_error(error);
    g_autofree char *text = input_file_read_text(path, 1000, &error);
    g_assert_cmpstr(text, ==, "[rig]\nid = a\n");
}

TESTS_RUN_BY(session_fixture_run);
