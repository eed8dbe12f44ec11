/*
 * Text tables (CSV): a header line that names the columns, then one line for each row. Fields are
 * separated by commas, semicolons or tabs; the separator is the one that occurs most often in the
 * header line. A field that contains the separator is enclosed in double quotes. # begins a
 * comment. Only a whole line can be a comment. Lines end with LF, CRLF or CR. Empty columns at the
 * right and empty rows, which spreadsheets write, are ignored.
 *
 * If semicolons or tabs separate fields, a number may have a decimal comma. Any thread may call
 * these functions.
 */
#pragma once

#include <glib.h>

typedef struct TextTable TextTable;

/* Reads a table. Returns NULL with DATA_ERROR_INVALID in these cases:
 * - the file cannot be read, has more than 64 MiB, or is not UTF-8;
 * - the header line is missing, or there are no rows;
 * - a column has no name, or a name occurs twice;
 * - a quoted field does not end;
 * - a row and the header have different numbers of fields.
 * The error names the file, and the line if the mistake is in one line. */
TextTable *text_table_read(const char *path, GError **error);
void text_table_free(TextTable *table); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TextTable, text_table_free)

const char *text_table_path(const TextTable *table);
int text_table_rows(const TextTable *table);
/* line of the row in the file, counted from 1 */
int text_table_line(const TextTable *table, int row);
int text_table_column(const TextTable *table, const char *name); /* −1 if there is no such column */

/* Returns FALSE with an error if a column has a name that is not in `known`, a list that ends with
 * NULL. The error says which name in `known` is spelt most like that column, or lists them all. */
gboolean text_table_check_columns(const TextTable *table, const char *const *known, GError **error);

/* Returns the text of a field, or "" if column is −1. The table owns the text. */
const char *text_table_text(const TextTable *table, int row, int column);

/* Splits a text into lines at LF, CRLF and CR, for lists that are not tables. Free the result
 * with g_strfreev(). */
char **text_table_lines(const char *text);
/* Reads a text that is a number and nothing else; a blank after the number is a mistake. If
 * decimal_comma is TRUE, a number such as “0,25” is also accepted. Returns FALSE if the text is not
 * a finite number. */
gboolean text_table_parse(const char *text, gboolean decimal_comma, double *ret);

/* Reads a number from a field. *ret is set to `otherwise` if the field is empty or column is −1.
 * Returns FALSE with an error if the field is not a number. */
gboolean text_table_number(const TextTable *table, int row, int column, double otherwise,
                           double *ret, GError **error);
