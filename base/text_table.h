/* Text tables (CSV): a header line that names the columns, then one line for each row. Fields are
 * separated by commas, semicolons or tabs, whichever occurs most in the header line. A field that
 * contains the separator stands in double quotes. # begins a comment. Lines end with LF, CRLF or
 * CR. Empty columns at the right and empty rows, which spreadsheets write, are ignored.
 *
 * Where semicolons or tabs separate fields, a number may have a decimal comma. Any thread. */
#pragma once

#include <gio/gio.h>

typedef struct TextTable TextTable;

/* DATA_ERROR_INVALID with file and line: the header line is missing, a column occurs twice, or a
 * row has another number of fields than the header. */
TextTable *text_table_read(const char *path, GError **error);
void text_table_free(TextTable *table); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TextTable, text_table_free)

const char *text_table_path(const TextTable *table);
int text_table_rows(const TextTable *table);
int text_table_line(const TextTable *table, int row); /* line of the file, counted from 1 */
int text_table_column(const TextTable *table, const char *name); /* −1: there is none */

/* FALSE: a column has a name that is not one of the known ones (ending with NULL). The error says
 * which known name is spelt most like it. */
gboolean text_table_check_columns(const TextTable *table, const char *const *known, GError **error);

/* Returns the text of a field; "" if column is −1. */
const char *text_table_text(const TextTable *table, int row, int column);

/* Splits a text into lines at LF, CRLF and CR, for lists that are no tables. */
char **text_table_lines(const char *text);
/* Reads a number without blanks around it; decimal_comma: “0,25” is read, too. FALSE: it is not a
 * finite number. */
gboolean text_table_parse(const char *text, gboolean decimal_comma, double *ret);

/* otherwise: the value if the field is empty or there is no such column. FALSE: the field is not a
 * number. */
gboolean text_table_number(const TextTable *table, int row, int column, double otherwise,
                           double *ret, GError **error);
