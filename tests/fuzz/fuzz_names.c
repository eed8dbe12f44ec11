/* Names of pictures, as in Bonn's UBO2003 folders. The pictures are empty. */
#include "fuzz.h"

#include "formats/import.h"

#include <glib/gstdio.h>
#include <string.h>

#define LONGEST 200

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    g_autofree char *name = g_strndup((const char *)data, MIN(size, LONGEST));
    if (*name == '\0' || strchr(name, '/') || strcmp(name, ".") == 0 || strcmp(name, "..") == 0)
        return 0;
    const char *path = fuzz_file_in_folder(name, data, 0);
    if (!path)
        return 0;
    g_autofree char *folder = g_path_get_dirname(path);
    g_autofree char *session = g_strconcat(folder, ".session", NULL);
    const struct import_wish wish = {0};
    struct import_result result;
    GError *error = NULL;
    const gboolean ok = import_pictures(session, folder, &wish, NULL, &result, &error);
    g_assert_false(ok);
    fuzz_check(ok, &error);
    g_unlink(path);
    return 0;
}
