/* Camera raw, which LibRaw reads. */
#include "fuzz.h"

#include "pictures/raw.h"
#include "pictures/vision.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file(data, size);
    char cfa[RAW_CFA];
    GError *error = NULL;
    g_autoptr(Picture) picture = raw_read(path, cfa, &error);
    fuzz_check(picture != NULL, &error);
    g_autoptr(Picture) grey = raw_read_grey(path, &error);
    fuzz_check(grey != NULL, &error);
    g_assert_true((picture != NULL) == (grey != NULL));
    if (grey) {
        static const char *const known[] = {"mono", "rggb", "bggr", "grbg", "gbrg", NULL};
        g_assert_true(g_strv_contains(known, cfa));
        g_assert_cmpint(picture->width, >, 0);
        g_assert_cmpint(picture->height, >, 0);
        g_assert_cmpint(grey->width, ==, picture->width);
        g_assert_cmpint(grey->height, ==, picture->height);
    }
    return 0;
}
