/* Photographs: JPEG, PNG, TIFF, BMP and portable anymaps. */
#include "fuzz.h"

#include "pictures/picture_read.h"
#include "pictures/vision.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file(data, size);
    GError *error = NULL;
    g_auto(PictureCodes) codes = {0};
    g_autoptr(Picture) picture = picture_read(path, &error);
    fuzz_check(picture != NULL, &error);
    const gboolean ok = picture_read_codes(path, &codes, &error);
    fuzz_check(ok, &error);
    if (ok) {
        g_assert_cmpint(codes.width, >, 0);
        g_assert_cmpint(codes.height, >, 0);
        g_autofree char *described =
            picture_tone_describe(&codes.says.tone, codes.bits, PICTURE_TONES_UNSAID);
        /* A picture whose tone curve is not known is no grey picture. */
        if (codes.says.tone.tones != PICTURE_TONES_OTHER) {
            g_assert_true(picture != NULL);
            g_assert_cmpint(codes.width * codes.height, ==, picture->width * picture->height);
        }
    }
    return 0;
}
