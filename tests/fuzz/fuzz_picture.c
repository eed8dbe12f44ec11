/* Photographs: JPEG, PNG, TIFF, BMP and portable anymaps. */
#include "fuzz.h"

#include "pictures/picture_read.h"
#include "pictures/vision.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file(data, size);
    GError *error = NULL;
    int width, height, bits;
    gboolean grey;
    float *rgb = NULL;
    g_autoptr(Picture) picture = picture_read(path, &error);
    fuzz_check(picture != NULL, &error);
    const gboolean ok = picture_read_codes(path, &width, &height, &grey, &bits, &rgb, &error);
    fuzz_check(ok, &error);
    if (ok) {
        g_assert_cmpint(width, >, 0);
        g_assert_cmpint(height, >, 0);
        g_assert_true(picture != NULL);
        g_assert_cmpint(width * height, ==, picture->width * picture->height);
    }
    g_free(rgb);
    return 0;
}
