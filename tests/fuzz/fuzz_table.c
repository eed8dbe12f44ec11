/* Tables of poses and of directions. */
#include "fuzz.h"

#include "base/text_table.h"
#include "btf/btf_directions.h"
#include "formats/import_poses.h"

static void read_cells(const TextTable *table) {
    const int column = text_table_column(table, "turntable_deg");
    for (int row = 0; row < text_table_rows(table); row++) {
        double value = 0;
        GError *error = NULL;
        fuzz_check(text_table_number(table, row, column, 1, &value, &error), &error);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file_in_folder("poses.csv", data, size);
    GError *error = NULL;
    g_autoptr(TextTable) table = text_table_read(path, &error);
    fuzz_check(table != NULL, &error);
    if (!table)
        return 0;
    read_cells(table);
    struct btf_directions *directions = btf_directions_read(path, &error);
    fuzz_check(directions != NULL, &error);
    btf_directions_free(directions);
    g_autofree char *folder = g_path_get_dirname(path);
    g_autofree char *session = g_strconcat(folder, ".session", NULL);
    const struct import_poses poses = {.table = path,
                                       .calibration = FUZZ_CALIBRATION,
                                       .cfa = "mono",
                                       .grid = {.width = 4,
                                                .height = 4,
                                                .width_mm = 10,
                                                .height_mm = 10,
                                                .reference_mm = 2,
                                                .depth_mm = 2},
                                       .threshold_dn = 40};
    struct import_poses_result result;
    fuzz_check(import_poses(session, &poses, NULL, &result, &error), &error);
    return 0;
}
