/* Tables of text: a head that names the columns, then a line a row; fields separated by commas or
 * semicolons, those with such in them in double quotes; # begins a comment. Any thread. */
#pragma once

#include <gio/gio.h>

typedef struct ImportTable ImportTable;

/* IMPORT_ERROR_DATA with file and line: no head, a column twice, a row of another length. */
ImportTable *import_table_read(const char *path, GError **error);
void import_table_free(ImportTable *table); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ImportTable, import_table_free)

const char *import_table_path(const ImportTable *table);
int import_table_rows(const ImportTable *table);
int import_table_line(const ImportTable *table, int row);            /* of the file, from 1 */
int import_table_column(const ImportTable *table, const char *name); /* −1: there is none */

/* "" where there is no such column (−1). */
const char *import_table_text(const ImportTable *table, int row, int column);

/* otherwise: where the field is empty or there is no such column. FALSE: it is no number. */
gboolean import_table_number(const ImportTable *table, int row, int column, double otherwise,
                             double *ret, GError **error);
