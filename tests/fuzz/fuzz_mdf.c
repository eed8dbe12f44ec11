/* Distances: as measured or packed, as blocks, as few maps. */
#include "fuzz.h"

#include "codecs/mdf_codecs/mdf_blocks.h"
#include "codecs/mdf_codecs/mdf_factors.h"
#include "codecs/mdf_codecs/mdf_packed.h"
#include "mdf/mdf_views.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file(data, size);
    struct mdf_views_sums sums;
    GError *error = NULL;
    mdf_kind(path);
    struct mdf_table *table = mdf_table_read(path, &error);
    fuzz_check(table != NULL, &error);
    mdf_table_free(table);
    struct mdf_blocks *blocks = mdf_blocks_read(path, &error);
    fuzz_check(blocks != NULL, &error);
    mdf_blocks_free(blocks);
    struct mdf_factors *factors = mdf_factors_read(path, &error);
    fuzz_check(factors != NULL, &error);
    mdf_factors_free(factors);
    fuzz_check(mdf_views_check(path, &sums, &error), &error);
    return 0;
}
