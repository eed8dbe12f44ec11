/* EXR files: frames, and any other. */
#include "fuzz.h"

#include "exr/exr.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file(data, size);
    GError *error = NULL;
    struct exr_file *headers = exr_read_headers(path, &error);
    fuzz_check(headers != NULL, error);
    exr_file_free(headers);
    error = NULL;
    struct exr_file *file = exr_read(path, &error);
    fuzz_check(file != NULL, error);
    exr_file_free(file);
    return 0;
}
