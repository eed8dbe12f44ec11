#include "text_table.h"

#include <math.h>
#include <string.h>

#include "data_error.h"
#include "input_file.h"
#include "nearest.h"

#define MAX_BYTES (64 << 20)

struct TextTable {
    char *path;
    char separator;
    int head_line;
    GPtrArray *names; /* elements: char * */
    GPtrArray *rows;  /* elements: GPtrArray of char * */
    GArray *lines;    /* elements: int */
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

char **text_table_lines(const char *text) {
    g_autofree char *copy = g_strdup(text);
    char *to = copy;
    for (const char *from = copy; *from; from++)
        if (*from != '\r')
            *to++ = *from;
        else if (from[1] != '\n')
            *to++ = '\n';
    *to = '\0';
    return g_strsplit(copy, "\n", -1);
}

/* Returns the separator of a header line: the semicolon, comma or tab that occurs most often. If
 * two occur equally often, the semicolon is preferred to the comma, and the comma to the tab.
 * Returns a comma if there is none. */
static char find_separator(const char *text) {
    /* of two that occur equally often, the first is used */
    static const char separators[] = ";,\t";
    int n[3] = {0}, best = 0;
    gboolean quoted = FALSE;
    for (const char *at = text; *at; at++) {
        const char *found = strchr(separators, *at);
        quoted ^= *at == '"';
        if (found && !quoted)
            n[found - separators]++;
    }
    for (int i = 1; i < 3; i++)
        best = n[i] > n[best] ? i : best;
    return n[best] > 0 ? separators[best] : ',';
}

/* Splits a line into trimmed fields. Returns NULL if a quote is not closed. */
static GPtrArray *split(const char *text, char separator) {
    g_autoptr(GPtrArray) fields = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GString) field = g_string_new(NULL);
    gboolean quoted = FALSE;
    for (const char *at = text;; at++) {
        if (*at == '"' && quoted && at[1] == '"')
            g_string_append_c(field, *at++);
        else if (*at == '"')
            quoted = !quoted;
        else if (*at && (quoted || *at != separator))
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

static gboolean take_head(TextTable *table, GPtrArray *fields, int line, GError **error) {
    guint at;
    while (fields->len > 0 && !*(char *)fields->pdata[fields->len - 1])
        g_ptr_array_set_size(fields, (gint)fields->len - 1);
    for (guint i = 0; i < fields->len; i++) {
        if (!*(char *)fields->pdata[i])
            return data_error_fail(table->path, line, error,
                                   "column %u has no name; name it, or remove it", i + 1);
        if (g_ptr_array_find_with_equal_func(fields, fields->pdata[i], g_str_equal, &at) && at < i)
            return data_error_fail(table->path, line, error,
                                   "there are two columns “%s”; rename or remove one of them",
                                   (char *)fields->pdata[i]);
    }
    table->names = g_ptr_array_ref(fields);
    table->head_line = line;
    return TRUE;
}

static gboolean take_row(TextTable *table, GPtrArray *fields, int line, GError **error) {
    gboolean empty = TRUE;
    for (guint i = 0; i < fields->len; i++)
        empty &= !*(char *)fields->pdata[i];
    if (empty)
        return TRUE;
    while (fields->len > table->names->len && !*(char *)fields->pdata[fields->len - 1])
        g_ptr_array_set_size(fields, (gint)fields->len - 1);
    if (fields->len != table->names->len)
        return data_error_fail(table->path, line, error,
                               "this line has %u fields, but the header line has %u%s", fields->len,
                               table->names->len,
                               table->separator == ',' && fields->len > table->names->len
                                   ? "; if its numbers have decimal commas, separate fields by "
                                     "semicolons or tabs"
                                   : "; correct the line");
    g_ptr_array_add(table->rows, g_ptr_array_ref(fields));
    g_array_append_val(table->lines, line);
    return TRUE;
}

static gboolean take_line(TextTable *table, const char *text, int line, GError **error) {
    const char *begin = text + strspn(text, " \t");
    if (!*begin || *begin == '#')
        return TRUE;
    if (!table->names)
        table->separator = find_separator(text);
    g_autoptr(GPtrArray) fields = split(text, table->separator);
    if (!fields)
        return data_error_fail(
            table->path, line, error,
            "a field begins with a double quote, but none ends it; add the second quote");
    return table->names ? take_row(table, fields, line, error)
                        : take_head(table, fields, line, error);
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
    gboolean ok =
        g_utf8_validate(text, -1, NULL) ||
        data_error_fail(path, 0, error, "the table is not a text in UTF-8; save it as UTF-8");
    g_auto(GStrv) lines = text_table_lines(text);
    for (int i = 0; ok && lines[i]; i++)
        ok = take_line(table, lines[i], i + 1, error);
    if (ok && !table->names)
        ok = data_error_fail(path, 0, error,
                             "the table is empty; its first line must name the columns");
    else if (ok && table->rows->len == 0)
        ok = data_error_fail(path, 0, error,
                             "the table has no rows below its header line; add them");
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

gboolean text_table_check_columns(const TextTable *table, const char *const *known,
                                  GError **error) {
    for (guint i = 0; i < table->names->len; i++) {
        const char *name = table->names->pdata[i];
        if (g_strv_contains(known, name))
            continue;
        struct nearest nearest = nearest_new(name);
        for (const char *const *other = known; *other; other++)
            nearest_consider(&nearest, *other);
        if (nearest.name)
            return data_error_fail(table->path, table->head_line, error,
                                   "the column “%s” is not known; did you mean “%s”?", name,
                                   nearest.name);
        g_autofree char *all = g_strjoinv(", ", (char **)known);
        return data_error_fail(table->path, table->head_line, error,
                               "the column “%s” is not known; remove it. The columns are %s", name,
                               all);
    }
    return TRUE;
}

gboolean text_table_parse(const char *text, gboolean decimal_comma, double *ret) {
    char *end;
    const char *comma = decimal_comma ? strchr(text, ',') : NULL;
    g_autofree char *point = comma && !strchr(text, '.') ? g_strdup(text) : NULL;
    if (point)
        point[comma - text] = '.';
    const char *number = point ? point : text;
    *ret = g_ascii_strtod(number, &end);
    return end != number && !*end && isfinite(*ret);
}

gboolean text_table_number(const TextTable *table, int row, int column, double otherwise,
                           double *ret, GError **error) {
    const char *text = text_table_text(table, row, column);
    *ret = otherwise;
    return !*text || text_table_parse(text, table->separator != ',', ret) ||
           data_error_fail(table->path, text_table_line(table, row), error,
                           "“%s” in column %s is not a number%s", text,
                           (char *)table->names->pdata[column],
                           strchr(text, ',') ? "; write a decimal point" : "; correct it");
}
