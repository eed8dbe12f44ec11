/* The text that says which part of the world a relay or a motor of a virtual rig moves. */
#include "fuzz.h"

#include "virtual/world_link.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static World *world;
    g_autofree char *name = fuzz_text(data, size);
    struct world_part part = {0};
    GError *error = NULL;
    if (!world)
        world = world_get(FUZZ_WORLD, &error);
    g_assert_no_error(error);
    const gboolean ok = world_part_find(world, name, &part, &error);
    fuzz_check(ok, &error);
    g_assert_true(ok == (part.world != NULL));
    world_part_turn(&part, (double)size, size % 3, (gint64)size);
    world_part_switch(&part, size % 2 == 0, (gint64)size);
    world_part_clear(&part);
    return 0;
}
