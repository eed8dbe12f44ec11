/* Pictures that the program of a camera writes. The first three bytes are the size that is
 * expected. */
#include "fuzz.h"
#include "program/pgm.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 3)
        return 0;
    const int width = 1 + data[0] % 64, height = 1 + data[1] % 64, bits = 1 + data[2] % 16;
    g_autofree guint16 *pixels =
        g_new(guint16, width * height); /* of this size, for the sanitizer */
    gboolean complete = 2;
    GError *error = NULL;
    const gboolean ok =
        pgm_parse(data + 3, size - 3, width, height, bits, pixels, &complete, &error);
    fuzz_check(ok, &error);
    for (int i = 0; ok && i < width * height; i++)
        g_assert_cmpint(pixels[i], <, 1 << bits);
    g_assert_true(!ok || complete == TRUE || complete == FALSE);
    return 0;
}
