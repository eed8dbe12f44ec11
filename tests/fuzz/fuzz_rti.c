/* PTMs and RTIs of harmonics. */
#include "fuzz.h"

#include "formats/rti/rti.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const float basis[RTI_MAX_TERMS] = {1, 0.5F, -0.5F, 0.25F};
    GError *error = NULL;
    g_autoptr(Rti) rti = rti_read(fuzz_file(data, size), &error);
    fuzz_check(rti != NULL, &error);
    if (!rti)
        return 0;
    g_assert_true(rti->width > 0 && rti->height > 0 && rti->n_terms <= RTI_MAX_TERMS);
    const gsize texels = (gsize)rti->width * (gsize)rti->height;
    for (gsize i = 0; i < texels; i++) {
        float rgb[3];
        rti_evaluate(rti, i, basis, rgb);
    }
    return 0;
}
