/* Text tables (CSV): a header line that names the columns, then one line for each row. Fields are
 * separated by commas or semicolons; a field that contains one stands in double quotes; # begins a
 * comment. Any thread. */
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

/* Returns the text of a field; "" if column is −1. */
const char *text_table_text(const TextTable *table, int row, int column);

/* otherwise: the value if the field is empty or there is no such column. FALSE: the field is not a
 * number. */
gboolean text_table_number(const TextTable *table, int row, int column, double otherwise,
                           double *ret, GError **error);
