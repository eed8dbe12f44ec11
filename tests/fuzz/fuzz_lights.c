/* Lists of lights (.lp). The pictures that they name do not exist. */
#include "fuzz.h"

#include "formats/import.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file_in_folder("lights.lp", data, size);
    g_autofree char *folder = g_path_get_dirname(path);
    g_autofree char *session = g_strconcat(folder, ".session", NULL);
    const struct import_wish wish = {0};
    struct import_result result;
    GError *error = NULL;
    fuzz_check(import_rti(session, path, &wish, NULL, &result, &error), &error);
    return 0;
}
