/* Compressed materials: eigen-maps, local PCA, lobes, hemispherical harmonics. */
#include "fuzz.h"

#include "codecs/eigenmaps/eigenmaps.h"
#include "codecs/hsh/hsh.h"
#include "codecs/lobes/lobes.h"
#include "codecs/lpca/lpca.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file(data, size);
    GError *error = NULL;
    struct eigenmaps *maps = eigenmaps_read(path, &error);
    fuzz_check(maps != NULL, &error);
    eigenmaps_free(maps);
    struct lpca *lpca = lpca_read(path, &error);
    fuzz_check(lpca != NULL, &error);
    lpca_free(lpca);
    struct lobes *lobes = lobes_read(path, &error);
    fuzz_check(lobes != NULL, &error);
    lobes_free(lobes);
    struct hsh *hsh = hsh_read(path, &error);
    fuzz_check(hsh != NULL, &error);
    hsh_free(hsh);
    return 0;
}
