/* EXR files: frames, and any other. */
#include "fuzz.h"

#include "exr/exr.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file(data, size);
    GError *error = NULL;
    g_autoptr(ExrFile) headers = exr_read_headers(path, &error);
    fuzz_check(headers != NULL, &error);
    g_autoptr(ExrFile) file = exr_read(path, &error);
    fuzz_check(file != NULL, &error);
    return 0;
}
