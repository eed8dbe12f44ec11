/* Index maps of synthesized materials. What is read refers to texels of the sample only, at every
 * level, and is the same when it is written and read again. */
#include "fuzz.h"

#include "synthesis/index_map.h"

#include <math.h>
#include <string.h>

#define MAX_TEXELS (1 << 16) /* larger ones are not written again: they would be slow */

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    GError *error = NULL;
    g_autoptr(IndexMap) map = index_map_read(fuzz_file(data, size), &error);
    fuzz_check(map != NULL, &error);
    if (!map)
        return 0;
    g_assert_cmpint(map->n_levels, >=, 1);
    g_assert_cmpint(map->n_levels, <=, INDEX_MAP_LEVELS);
    g_assert_true(isfinite(map->texel_mm) && map->texel_mm > 0);
    g_assert_nonnull(map->method);
    for (int level = 0; level < map->n_levels; level++) {
        const gsize n =
            (gsize)index_map_size(map->width, level) * (gsize)index_map_size(map->height, level);
        for (gsize i = 0; i < n; i++) {
            g_assert_cmpint(map->levels[level][2 * i], <, map->sample_width);
            g_assert_cmpint(map->levels[level][2 * i + 1], <, map->sample_height);
        }
    }
    if ((gint64)map->width * map->height > MAX_TEXELS)
        return 0;
    const char *path = fuzz_file_in_folder("index.exr", data, 0);
    const gboolean ok = index_map_write(path, map, &error);
    fuzz_check(ok, &error);
    g_autoptr(IndexMap) again = ok ? index_map_read(path, &error) : NULL;
    if (!again)
        g_error("an index map that was read cannot be written and read again: %s",
                error ? error->message : "no reason");
    g_assert_cmpint(again->n_levels, ==, map->n_levels);
    g_assert_cmpmem(again->levels[0], 4 * (gsize)again->width * (gsize)again->height,
                    map->levels[0], 4 * (gsize)map->width * (gsize)map->height);
    return 0;
}
