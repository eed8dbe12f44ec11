#include "text_table.h"

#include <math.h>
#include <string.h>

#include "data_error.h"
#include "input_file.h"

#define MAX_BYTES (64 << 20)

struct TextTable {
    char *path;
    GPtrArray *names; /* of char * */
    GPtrArray *rows;  /* of GPtrArray of char * */
    GArray *lines;    /* of int */
};

void text_table_free(TextTable *table) {
    if (!table)
        return;
    g_free(table->path);
    g_clear_pointer(&table->names, g_ptr_array_unref);
    g_ptr_array_unref(table->rows);
    g_array_unref(table->lines);
    g_free(table);
}

/* Splits a line into trimmed fields. Returns NULL if a quote is not closed. */
static GPtrArray *text_table_split(const char *text) {
    g_autoptr(GPtrArray) fields = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GString) field = g_string_new(NULL);
    gboolean quoted = FALSE;
    for (const char *at = text;; at++) {
        if (*at == '"' && quoted && at[1] == '"')
            g_string_append_c(field, *at++);
        else if (*at == '"')
            quoted = !quoted;
        else if (*at && (quoted || !strchr(",;", *at)))
            g_string_append_c(field, *at);
        else if (!*at && quoted)
            return NULL;
        else {
            g_ptr_array_add(fields, g_strdup(g_strstrip(field->str)));
            g_string_truncate(field, 0);
            if (!*at)
                return g_steal_pointer(&fields);
        }
    }
}

static gboolean take_line(TextTable *table, char *text, int line, GError **error) {
    guint at;
    if (!*g_strstrip(text) || *text == '#')
        return TRUE;
    g_autoptr(GPtrArray) fields = text_table_split(text);
    if (!fields)
        return data_error_fail(table->path, line, error, "a quote is not closed");
    if (!table->names) {
        for (guint i = 0; i < fields->len; i++)
            if (g_ptr_array_find_with_equal_func(fields, fields->pdata[i], g_str_equal, &at) &&
                at < i)
                return data_error_fail(table->path, line, error, "there are two columns “%s”",
                                       (char *)fields->pdata[i]);
        table->names = g_steal_pointer(&fields);
        return TRUE;
    }
    if (fields->len != table->names->len)
        return data_error_fail(table->path, line, error,
                               "it has %u fields, but the header line has %u", fields->len,
                               table->names->len);
    g_ptr_array_add(table->rows, g_steal_pointer(&fields));
    g_array_append_val(table->lines, line);
    return TRUE;
}

TextTable *text_table_read(const char *path, GError **error) {
    GError *found = NULL;
    g_autofree char *text = input_file_read_text(path, MAX_BYTES, &found);
    g_autoptr(TextTable) table = g_new0(TextTable, 1);
    table->path = g_strdup(path);
    table->rows = g_ptr_array_new_with_free_func((GDestroyNotify)g_ptr_array_unref);
    table->lines = g_array_new(FALSE, FALSE, sizeof(int));
    if (!text) {
        input_file_propagate(found, DATA_ERROR, DATA_ERROR_INVALID, DATA_ERROR_INVALID, error);
        return NULL;
    }
    gboolean ok = g_utf8_validate(text, -1, NULL) ||
                  data_error_fail(path, 0, error, "it is not a text table in UTF-8");
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    for (int i = 0; ok && lines[i]; i++)
        ok = take_line(table, lines[i], i + 1, error);
    if (ok && table->rows->len == 0)
        ok = data_error_fail(path, 0, error, "there are no rows in it");
    return ok ? g_steal_pointer(&table) : NULL;
}

const char *text_table_path(const TextTable *table) {
    return table->path;
}

int text_table_rows(const TextTable *table) {
    return (int)table->rows->len;
}

int text_table_line(const TextTable *table, int row) {
    return g_array_index(table->lines, int, row);
}

int text_table_column(const TextTable *table, const char *name) {
    guint at;
    return g_ptr_array_find_with_equal_func(table->names, name, g_str_equal, &at) ? (int)at : -1;
}

const char *text_table_text(const TextTable *table, int row, int column) {
    const GPtrArray *fields = table->rows->pdata[row];
    return column < 0 ? "" : fields->pdata[column];
}

gboolean text_table_number(const TextTable *table, int row, int column, double otherwise,
                           double *ret, GError **error) {
    const char *text = text_table_text(table, row, column);
    char *end;
    *ret = otherwise;
    if (!*text)
        return TRUE;
    *ret = g_ascii_strtod(text, &end);
    return (end != text && !*end && isfinite(*ret)) ||
           data_error_fail(table->path, text_table_line(table, row), error,
                           "“%s” in column %s is not a number", text,
                           (char *)table->names->pdata[column]);
}
