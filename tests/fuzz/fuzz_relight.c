/* info.json of Relight, with planes of 4 × 3 pixels next to it. */
#include "fuzz.h"

#include "base/png_bytes.h"
#include "formats/import.h"
#include "lib/remove_tree.h"

#include <glib/gstdio.h>

#define WIDTH  4
#define HEIGHT 3
#define PLANES 3

static void write_planes(const char *folder) {
    guint8 rgb[WIDTH * HEIGHT * 3];
    for (int i = 0; i < (int)sizeof rgb; i++)
        rgb[i] = (guint8)(i * 37);
    for (int k = 0; k < PLANES; k++) {
        g_autofree char *name = g_strdup_printf("%s/plane_%d.png", folder, k);
        g_autoptr(GBytes) png = png_bytes(rgb, WIDTH, HEIGHT, NULL);
        g_assert_true(g_file_set_contents(name, g_bytes_get_data(png, NULL),
                                          (gssize)g_bytes_get_size(png), NULL));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static gboolean written;
    const char *path = fuzz_file_in_folder("info.json", data, size);
    g_autofree char *folder = g_path_get_dirname(path);
    g_autofree char *session = g_strconcat(folder, ".session", NULL);
    const struct import_wish wish = {0};
    struct import_result result;
    GError *error = NULL;
    if (!written)
        write_planes(folder);
    written = TRUE;
    const gboolean ok = import_relight(session, path, &wish, NULL, &result, &error);
    fuzz_check(ok, &error);
    if (ok)
        remove_tree(session);
    return 0;
}
