#include "eigenmaps.h"

#include <math.h>
#include <string.h>

#include "exr/exr.h"

#define MAX_MAPS 1024
#define COLOURS  3

void eigenmaps_free(struct eigenmaps *maps) {
    if (!maps)
        return;
    g_free(maps->name);
    btf_layout_clear(&maps->layout);
    g_free(maps->weights);
    g_free(maps->maps);
    g_free(maps);
}

static gsize plane_size(const struct eigenmaps *maps) {
    return btf_layout_texels(&maps->layout);
}

static gsize column_size(const struct eigenmaps *maps) {
    return plane_size(maps) * COLOURS * maps->layout.lights.n;
}

static struct exr_part *map_part(const struct eigenmaps *maps, int term, int light) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    g_autofree char *name = g_strdup_printf("E%03d_light_%04d", term, light);
    struct exr_part *part =
        exr_part_new(name, maps->layout.width, maps->layout.height, channels, EXR_HALF);
    gsize n = plane_size(maps);
    const float *rgb = maps->maps + n * COLOURS * (gsize)(term * maps->layout.lights.n + light);
    for (gsize i = 0; i < n; i++)
        for (int c = 0; c < COLOURS; c++)
            part->planes[COLOURS - 1 - c][i] = rgb[COLOURS * i + (gsize)c];
    return part;
}

gboolean eigenmaps_write(const char *path, const struct eigenmaps *maps, GError **error) {
    static const char *const channels[] = {"W", NULL};
    struct exr_part *weights =
        exr_part_new("weights", maps->layout.views.n, maps->n_terms, channels, EXR_FLOAT);
    memcpy(weights->planes[0], maps->weights,
           maps->layout.views.n * (gsize)maps->n_terms * sizeof(float));
    exr_set_string(weights, "mesorig.kind", "eigenmaps");
    btf_layout_write_sizes(&maps->layout, weights);
    exr_set_string(weights, "mesorig.name", maps->name ? maps->name : "");
    struct exr_file *file = exr_file_new();
    exr_file_add(file, weights);
    btf_layout_write_directions(&maps->layout, file);
    for (int term = 0; term < maps->n_terms; term++)
        for (gsize light = 0; light < maps->layout.lights.n; light++)
            exr_file_add(file, map_part(maps, term, light));
    gboolean ok = exr_write(path, file, EXR_PIZ, TRUE, error);
    exr_file_free(file);
    return ok;
}

static gboolean eigenmaps_format_error(const char *path, GError **error, const char *what) {
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT, "%s: these are not whole eigen-maps: %s", path,
                what);
    return FALSE;
}

static gboolean eigenmaps_read_head(struct eigenmaps *maps, const struct exr_file *file,
                                    const char *path, GError **error) {
    const struct exr_part *weights = exr_file_part(file, "weights");
    const float *plane = weights ? exr_part_plane(weights, "W") : NULL;
    const char *kind = NULL, *name = NULL;
    if (!plane || !exr_get_string(weights, "mesorig.kind", &kind, NULL) ||
        strcmp(kind, "eigenmaps") != 0)
        return eigenmaps_format_error(path, error, "there is no part \"weights\" of that kind");
    if (!exr_get_string(weights, "mesorig.name", &name, error))
        return FALSE;
    maps->name = g_strdup(name);
    maps->n_terms = weights->height;
    const char *what = btf_layout_read(file, weights, &maps->layout);
    if (what)
        return eigenmaps_format_error(path, error, what);
    if ((gsize)weights->width != maps->layout.views.n || maps->n_terms > MAX_MAPS ||
        !exr_all_finite(plane, maps->layout.views.n * (gsize)maps->n_terms))
        return eigenmaps_format_error(path, error, "the weights do not fit the views");
    maps->weights = g_memdup2(plane, maps->layout.views.n * (gsize)maps->n_terms * sizeof(float));
    return TRUE;
}

static gboolean read_map(struct eigenmaps *maps, const struct exr_file *file, int term, int light,
                         const char *path, GError **error) {
    static const char *const channels[] = {"R", "G", "B"};
    g_autofree char *name = g_strdup_printf("E%03d_light_%04d", term, light);
    const struct exr_part *part = exr_file_part(file, name);
    if (!part || (gsize)part->width != maps->layout.width ||
        (gsize)part->height != maps->layout.height)
        return eigenmaps_format_error(path, error, name);
    gsize n = plane_size(maps);
    float *rgb = maps->maps + n * COLOURS * (gsize)(term * maps->layout.lights.n + light);
    for (int c = 0; c < COLOURS; c++) {
        const float *plane = exr_part_plane(part, channels[c]);
        if (!plane || !exr_all_finite(plane, n))
            return eigenmaps_format_error(path, error, name);
        for (gsize i = 0; i < n; i++)
            rgb[COLOURS * i + (gsize)c] = plane[i];
    }
    return TRUE;
}

static gboolean eigenmaps_read_maps(struct eigenmaps *maps, const struct exr_file *file,
                                    const char *path, GError **error) {
    const struct exr_part *first = exr_file_part(file, "E000_light_0000");
    if (!first || (gsize)maps->n_terms * maps->layout.lights.n > file->parts->len)
        return eigenmaps_format_error(path, error, "maps are missing");
    maps->layout.width = (gsize)first->width;
    maps->layout.height = (gsize)first->height;
    maps->maps = g_try_new(float, column_size(maps) * (gsize)maps->n_terms);
    if (!maps->maps)
        return eigenmaps_format_error(path, error, "they are larger than memory");
    for (int term = 0; term < maps->n_terms; term++)
        for (gsize light = 0; light < maps->layout.lights.n; light++)
            if (!read_map(maps, file, term, light, path, error))
                return FALSE;
    return TRUE;
}

struct eigenmaps *eigenmaps_read(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    if (!file)
        return NULL;
    struct eigenmaps *maps = g_new0(struct eigenmaps, 1);
    if (!eigenmaps_read_head(maps, file, path, error) ||
        !eigenmaps_read_maps(maps, file, path, error))
        g_clear_pointer(&maps, eigenmaps_free);
    exr_file_free(file);
    return maps;
}
