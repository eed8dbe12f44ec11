/* An index map is a picture of a material that is larger than the sample. Each of its texels has
 * the position of a texel of the sample, which is shown there (the index texture of Meseth et al.
 * 2003 §6, after Tong et al. 2002). The map contains no values. Therefore every codec of the
 * sample, and the sample's MDF, is drawn through the same map.
 *
 * On disk, one EXR:
 *   part "index"          channels "X", "Y", width × height, float: column and row of a texel of
 *                         the sample, whole numbers from 0; top row first
 *   part "mip<n>.index"   the same for level n, ⌈width / 2ⁿ⌉ × ⌈height / 2ⁿ⌉ texels. Texel (i, j)
 *                         stands for a block of 2ⁿ × 2ⁿ texels of the map, whose first texel is
 *                         (2ⁿ i, 2ⁿ j). This block looks like the block of the sample whose first
 *                         texel is (X, Y)
 * The attributes of "index" are mesorig.kind = "index", mesorig.method (string), sample_width,
 * sample_height (int) and texel_mm (double).
 *
 * The map repeats: its first column is to the right of its last one. Plain data; any thread. */
#pragma once

#include <glib.h>

#define INDEX_MAP_LEVELS 12        /* maximum number of levels */
#define INDEX_MAP_MAX    8192      /* maximum number of texels in each dimension */
#define INDEX_MAP_SAMPLE (1 << 14) /* maximum number of texels of the sample in each dimension */

struct index_map {
    int width, height;
    int sample_width, sample_height;
    double texel_mm;
    char *method; /* "textons", "quilting" or "tileable" */
    int n_levels; /* at least 1 */
    /* Each level is height × width × 2 numbers: column and row in the sample. */
    guint16 *levels[INDEX_MAP_LEVELS];
};

/* Makes a map with only level 0, in which all values are 0. */
struct index_map *index_map_new(int width, int height, int sample_width, int sample_height,
                                double texel_mm, const char *method);
struct index_map *index_map_copy(const struct index_map *from);
typedef struct index_map IndexMap;
void index_map_free(struct index_map *map); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(IndexMap, index_map_free)

/* Returns the number of columns or rows of a level, ⌈size / 2^level⌉. size is the number on level
 * 0. */
int index_map_size(int size, int level);

gboolean index_map_write(const char *path, const struct index_map *map, GError **error);
/* Reads a map. The error is in EXR_ERROR if the file is damaged or of another kind, or if it refers
 * to texels outside the sample. */
struct index_map *index_map_read(const char *path, GError **error);

/* Returns the number of bytes that all levels take on a graphics card, four per texel. */
gint64 index_map_bytes(const struct index_map *map);
