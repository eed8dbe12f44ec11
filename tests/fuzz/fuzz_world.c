/* World files. A valid one builds its sample. */
#include "fuzz.h"

#include "world/world.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    GError *error = NULL;
    g_autoptr(World) world = world_get(fuzz_file(data, size), &error);
    fuzz_check(world != NULL, &error);
    return 0;
}
