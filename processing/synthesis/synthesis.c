#include "synthesis.h"

#include <float.h>
#include <gio/gio.h>
#include <string.h>

#include "base/data_error.h"
#include "quilting.h"
#include "session/session.h"
#include "textons.h"
#include "tileable.h"

#define MIN_SAMPLE 16 /* minimum number of texels in each dimension */
#define MIN_MAP    16

const char *const synthesis_names[SYNTHESIS_METHODS] = {"auto", "textons", "quilting", "tileable"};

/* Gives the mean of the features of the map's texels in a block of side × side texels of level 0.
 * Texels beyond the edge of the map do not count. */
static void block_mean(const struct texel_features *f, const struct index_map *map, int x, int y,
                       int side, float *ret) {
    int n = 0;
    memset(ret, 0, sizeof(float) * (gsize)f->n);
    for (int j = y; j < MIN(y + side, map->height); j++)
        for (int i = x; i < MIN(x + side, map->width); i++, n++) {
            const guint16 *s = map->levels[0] + 2 * ((gsize)j * (gsize)map->width + (gsize)i);
            const float *value = texel_features_at(f, s[0], s[1]);
            for (int k = 0; k < f->n; k++)
                ret[k] += value[k];
        }
    for (int k = 0; k < f->n; k++)
        ret[k] /= (float)n;
}

static void add_level(const struct texel_features *f, struct index_map *map, int level) {
    const int side = 1 << level, width = index_map_size(map->width, level);
    const int height = index_map_size(map->height, level);
    const int finer_width = index_map_size(map->width, level - 1);
    const int finer_height = index_map_size(map->height, level - 1);
    g_autoptr(TexelFeatures) averaged = texel_features_averaged(f, side);
    g_autofree float *mean = g_new(float, f->n);
    map->levels[level] = g_new0(guint16, 2 * (gsize)width * (gsize)height);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            guint16 *to = map->levels[level] + 2 * ((gsize)y * (gsize)width + (gsize)x);
            float least = FLT_MAX;
            block_mean(f, map, side * x, side * y, side, mean);
            for (int k = 0; k < 4; k++) {
                const int i = 2 * x + k % 2, j = 2 * y + k / 2;
                if (i >= finer_width || j >= finer_height)
                    continue;
                const guint16 *from =
                    map->levels[level - 1] + 2 * ((gsize)j * (gsize)finer_width + (gsize)i);
                const int at[2] = {CLAMP(from[0] - k % 2 * side / 2, 0, f->width - side),
                                   CLAMP(from[1] - k / 2 * side / 2, 0, f->height - side)};
                const float square =
                    texel_features_square(mean, texel_features_at(averaged, at[0], at[1]), f->n);
                if (square < least) {
                    least = square;
                    to[0] = (guint16)at[0];
                    to[1] = (guint16)at[1];
                }
            }
        }
}

void synthesis_add_levels(const struct texel_features *features, struct index_map *map) {
    const int side = MIN(MIN(features->width, features->height) / 4, MIN(map->width, map->height));
    for (int level = 1; level < INDEX_MAP_LEVELS && 1 << level <= side; level++) {
        add_level(features, map, level);
        map->n_levels = level + 1;
    }
}

static struct index_map *synthesis_try(const struct texel_features *features,
                                       enum synthesis_method method,
                                       const struct synthesis_options *options,
                                       const struct work *work, struct synthesis_result *ret,
                                       GError **error) {
    if (method == SYNTHESIS_TILEABLE)
        return tileable_make(features);
    g_autoptr(IndexMap) map =
        index_map_new(options->width, options->height, features->width, features->height,
                      features->texel_mm, synthesis_names[method]);
    const int block = options->block > 0 ? options->block : quilting_block(features);
    if (!(method == SYNTHESIS_TEXTONS
              ? textons_synthesize(features, options->seed, work, map, error)
              : quilting_synthesize(features, block, options->seed, work, map, error)))
        return NULL;
    ret->order[method] = order_difference(features, map);
    return g_steal_pointer(&map);
}

struct index_map *synthesis_of_features(const struct texel_features *features,
                                        const struct synthesis_options *options,
                                        const struct work *work, struct synthesis_result *ret,
                                        GError **error) {
    const gboolean both = options->method == SYNTHESIS_AUTO;
    *ret = (struct synthesis_result){.method = both ? SYNTHESIS_TEXTONS : options->method,
                                     .order = {-1, -1, -1, -1},
                                     .n_features = features->n,
                                     .explained = features->explained,
                                     .relief = features->relief};
    g_autoptr(IndexMap) map = synthesis_try(features, ret->method, options, work, ret, error);
    if (!map)
        return NULL;
    if (both) {
        g_autoptr(IndexMap) other =
            synthesis_try(features, SYNTHESIS_QUILTING, options, work, ret, error);
        if (!other)
            return NULL;
        if (ret->order[SYNTHESIS_QUILTING] < ret->order[SYNTHESIS_TEXTONS] - SYNTHESIS_SPARE) {
            ret->method = SYNTHESIS_QUILTING;
            index_map_free(map);
            map = g_steal_pointer(&other);
        }
    }
    ret->seams = order_seams(features, map);
    synthesis_add_levels(features, map);
    return g_steal_pointer(&map);
}

static gboolean check(const struct synthesis_options *options, const char *path,
                      const struct btf_layout *layout, GError **error) {
    const int sides[] = {options->width, options->height};
    const int least = (int)MIN(layout->width, layout->height);
    if (least < MIN_SAMPLE || MAX(layout->width, layout->height) > INDEX_MAP_SAMPLE)
        return data_error_fail(path, 0, error,
                               "the sample has %zu × %zu texels, but synthesis needs %d to %d in "
                               "each dimension; use another sample or another texel_mm",
                               layout->width, layout->height, MIN_SAMPLE, INDEX_MAP_SAMPLE);
    for (int k = 0; k < 2 && options->method != SYNTHESIS_TILEABLE; k++)
        if (sides[k] < MIN_MAP || sides[k] > INDEX_MAP_MAX)
            return data_error_fail(path, 0, error,
                                   "--size %dx%d: each side must be %d to %d texels",
                                   options->width, options->height, MIN_MAP, INDEX_MAP_MAX);
    if (options->block != 0 && (options->block < 4 || options->block > least))
        return data_error_fail(path, 0, error,
                               "--block %d is out of range: 4 to %d texels for this sample",
                               options->block, least);
    return TRUE;
}

struct index_map *synthesis_of_session(const char *path, gint64 memory,
                                       const struct synthesis_options *options,
                                       const struct work *work, struct synthesis_result *ret,
                                       GError **error) {
    g_autofree char *directory = btf_matrix_session(path);
    g_autofree char *mdf_path = g_build_filename(directory, "products", "mdf.exr", NULL);
    g_autoptr(MdfTable) mdf = NULL;
    if (g_file_test(mdf_path, G_FILE_TEST_EXISTS) &&
        (!session_check_product(mdf_path, error) || !(mdf = mdf_table_read(mdf_path, error))))
        return NULL;
    struct btf_matrix *btf = btf_matrix_read_within(memory, path, work, error);
    if (!btf)
        return NULL;
    g_autoptr(TexelFeatures) features = check(options, path, &btf->layout, error)
                                            ? texel_features_compute(btf, mdf, work, error)
                                            : NULL;
    btf_matrix_free(btf);
    return features ? synthesis_of_features(features, options, work, ret, error) : NULL;
}
