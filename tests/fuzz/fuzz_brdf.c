/* Files of measured BRDFs. What is read evaluates to numbers that are not negative. */
#include "fuzz.h"

#include "formats/brdf/brdf.h"

#include <math.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const float light[3] = {0.6F, 0, 0.8F}, view[3] = {-0.36F, 0.48F, 0.8F};
    const char *path = fuzz_file(data, size);
    for (int kind = 0; kind < BRDF_KINDS; kind++) {
        GError *error = NULL;
        g_autoptr(Brdf) brdf = brdf_open(path, (enum brdf_kind)kind, NULL, &error);
        float rgb[3] = {0};
        fuzz_check(brdf != NULL, &error);
        if (brdf)
            brdf_evaluate(light, view, rgb, brdf);
        for (int c = 0; c < 3; c++)
            g_assert_true(isfinite(rgb[c]) && rgb[c] >= 0);
    }
    return 0;
}
