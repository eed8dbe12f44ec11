#include "poses_table.h"

#include "base/data_error.h"

static const char *const poses_columns[] = {
    "file",      "camera",      "lamp", "laser",    "turntable_deg", "arc_deg",    "exposure_ms",
    "sweep_deg", "black_level", "bits", "transfer", "flat_field",    "dark_frame", NULL};

static gboolean has(const TextTable *table, const char *column) {
    return text_table_column(table, column) >= 0;
}

TextTable *poses_table_read(const char *path, GError **error) {
    g_autoptr(TextTable) table = text_table_read(path, error);
    if (!table || !text_table_check_columns(table, poses_columns, error))
        return NULL;
    const char *lacks = !has(table, "file")                           ? "file"
                        : !has(table, "camera")                       ? "camera"
                        : !has(table, "lamp") && !has(table, "laser") ? "lamp or laser"
                                                                      : NULL;
    if (!lacks)
        return g_steal_pointer(&table);
    data_error_set(path, 0, error,
                   "the header line lacks the column %s; the columns file, camera, and lamp or "
                   "laser are needed",
                   lacks);
    return NULL;
}
