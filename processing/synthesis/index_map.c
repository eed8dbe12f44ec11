#include "index_map.h"

#include <math.h>
#include <string.h>

#include "exr/exr.h"
#include "exr/mip_parts.h"

#define KIND "index"

int index_map_size(int size, int level) {
    return (size + (1 << level) - 1) >> level;
}

struct index_map *index_map_new(int width, int height, int sample_width, int sample_height,
                                double texel_mm, const char *method) {
    struct index_map *map = g_new0(struct index_map, 1);
    *map = (struct index_map){
        width, height, sample_width, sample_height, texel_mm, g_strdup(method), 1, {NULL}};
    map->levels[0] = g_new0(guint16, 2 * (gsize)width * (gsize)height);
    return map;
}

void index_map_free(struct index_map *map) {
    if (!map)
        return;
    for (int k = 0; k < INDEX_MAP_LEVELS; k++)
        g_free(map->levels[k]);
    g_free(map->method);
    g_free(map);
}

struct index_map *index_map_copy(const struct index_map *from) {
    struct index_map *map = g_memdup2(from, sizeof *from);
    map->method = g_strdup(from->method);
    for (int k = 0; k < from->n_levels; k++)
        map->levels[k] =
            g_memdup2(from->levels[k], 2 * sizeof(guint16) * (gsize)index_map_size(from->width, k) *
                                           (gsize)index_map_size(from->height, k));
    return map;
}

gint64 index_map_bytes(const struct index_map *map) {
    gint64 texels = 0;
    for (int k = 0; k < map->n_levels; k++)
        texels += (gint64)index_map_size(map->width, k) * index_map_size(map->height, k);
    return 4 * texels;
}

gboolean index_map_write(const char *path, const struct index_map *map, GError **error) {
    static const char *const channels[] = {"X", "Y", NULL};
    g_autoptr(ExrFile) file = exr_file_new();
    for (int k = 0; k < map->n_levels; k++) {
        const int width = index_map_size(map->width, k), height = index_map_size(map->height, k);
        struct exr_part *part = exr_part_new(KIND, width, height, channels, EXR_FLOAT);
        for (gsize i = 0; i < 2 * (gsize)width * (gsize)height; i++)
            part->planes[i % 2][i / 2] = map->levels[k][i];
        exr_set_string(part, "mesorig.kind", KIND);
        exr_set_string(part, "mesorig.method", map->method);
        exr_set_int(part, "sample_width", map->sample_width);
        exr_set_int(part, "sample_height", map->sample_height);
        exr_set_double(part, "texel_mm", map->texel_mm);
        struct exr_file *level = exr_file_new();
        exr_file_add(level, part);
        mip_parts_add(file, level, k);
    }
    return exr_write(path, file, EXR_ZIP, TRUE, error);
}

G_GNUC_PRINTF(3, 4)
static gboolean fail(const char *path, GError **error, const char *format, ...) {
    va_list list;
    va_start(list, format);
    g_autofree char *what = g_strdup_vprintf(format, list);
    va_end(list);
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: this is not a valid index map: %s; synthesize the map again", path, what);
    return FALSE;
}

/* Reads a level from its part. Checks the size of the part and all texels. */
static gboolean take(struct index_map *map, const struct exr_part *part, int level,
                     const char *path, GError **error) {
    const int most[] = {map->sample_width, map->sample_height};
    const float *planes[] = {exr_part_plane(part, "X"), exr_part_plane(part, "Y")};
    const gsize n = (gsize)part->width * (gsize)part->height;
    const int width = index_map_size(map->width, level);
    const int height = index_map_size(map->height, level);
    if (!planes[0] || !planes[1])
        return fail(path, error, "part \"%s\" lacks channel %s", part->name, planes[0] ? "Y" : "X");
    if (part->width != width || part->height != height)
        return fail(path, error, "part \"%s\" has %d × %d texels, but must have %d × %d",
                    part->name, part->width, part->height, width, height);
    if (level > 0)
        map->levels[level] = g_new0(guint16, 2 * n);
    for (gsize i = 0; i < 2 * n; i++) {
        const float at = planes[i % 2][i / 2];
        if (!(at >= 0) || at >= (float)most[i % 2] || at != floorf(at))
            return fail(path, error,
                        "part \"%s\" refers to %s %g, but the sample has the %s 0 to %d",
                        part->name, i % 2 ? "row" : "column", (double)at,
                        i % 2 ? "rows" : "columns", most[i % 2] - 1);
        map->levels[level][i] = (guint16)at;
    }
    return TRUE;
}

static struct index_map *of_head(const struct exr_part *part, const char *path, GError **error) {
    const char *kind = NULL, *method = NULL;
    int width = 0, height = 0;
    double texel_mm = 0;
    gboolean ok = FALSE;
    if (!part)
        fail(path, error, "part \"index\" is missing");
    else if (!exr_get_string(part, "mesorig.kind", &kind, NULL) || strcmp(kind, KIND) != 0)
        fail(path, error, "mesorig.kind is not \"index\"");
    else if (!exr_get_string(part, "mesorig.method", &method, NULL))
        fail(path, error, "mesorig.method is missing");
    else if (!exr_get_int(part, "sample_width", &width, NULL) ||
             !exr_get_int(part, "sample_height", &height, NULL) || width < 1 || height < 1 ||
             width > INDEX_MAP_SAMPLE || height > INDEX_MAP_SAMPLE)
        fail(path, error, "sample_width and sample_height are not two numbers of 1 to %d",
             INDEX_MAP_SAMPLE);
    else if (!exr_get_double(part, "texel_mm", &texel_mm, NULL) || !(texel_mm > 0) ||
             !isfinite(texel_mm))
        fail(path, error, "texel_mm is missing or not above 0");
    else
        ok = (part->width <= INDEX_MAP_MAX && part->height <= INDEX_MAP_MAX) ||
             fail(path, error,
                  "the map has %d × %d texels, but may have at most %d in each dimension",
                  part->width, part->height, INDEX_MAP_MAX);
    return ok ? index_map_new(part->width, part->height, width, height, texel_mm, method) : NULL;
}

struct index_map *index_map_read(const char *path, GError **error) {
    g_autoptr(ExrFile) file = exr_read(path, error);
    if (!file)
        return NULL;
    g_autoptr(IndexMap) map = of_head(exr_file_part(file, KIND), path, error);
    if (!map)
        return NULL;
    const int n_levels = mip_parts_count(file, KIND, path, error);
    if (n_levels == 0)
        return NULL;
    if (n_levels > INDEX_MAP_LEVELS) {
        fail(path, error, "the map has %d levels, but may have at most %d", n_levels,
             INDEX_MAP_LEVELS);
        return NULL;
    }
    for (int k = 0; k < n_levels; k++) {
        g_autofree char *name = k > 0 ? g_strdup_printf("mip%d." KIND, k) : g_strdup(KIND);
        if (!take(map, exr_file_part(file, name), k, path, error))
            return NULL;
    }
    map->n_levels = n_levels;
    return g_steal_pointer(&map);
}
