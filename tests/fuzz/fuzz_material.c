/* Compressed materials of all codecs. */
#include "fuzz.h"

#include "codecs/codecs.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file(data, size);
    GError *error = NULL;
    for (gsize i = 0; codecs[i]; i++) {
        if (i > 0 && codecs[i]->read == codecs[i - 1]->read) /* codecs of one family */
            continue;
        gpointer model = codecs[i]->read(path, &error);
        fuzz_check(model != NULL, &error);
        codecs[i]->free(model);
    }
    return 0;
}
