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
    g_free(maps->view_theta_deg);
    g_free(maps->view_phi_deg);
    g_free(maps->light_theta_deg);
    g_free(maps->light_phi_deg);
    g_free(maps->weights);
    g_free(maps->maps);
    g_free(maps);
}

static gsize plane_size(const struct eigenmaps *maps) {
    return (gsize)maps->width * (gsize)maps->height;
}

static gsize column_size(const struct eigenmaps *maps) {
    return plane_size(maps) * COLOURS * (gsize)maps->n_lights;
}

static struct exr_part *eigenmaps_directions_part(const char *name, const float *theta_deg,
                                                  const float *phi_deg, int n) {
    static const char *const channels[] = {"phi_deg", "theta_deg", NULL};
    struct exr_part *part = exr_part_new(name, n, 1, channels, EXR_FLOAT);
    memcpy(part->planes[0], phi_deg, (gsize)n * sizeof(float));
    memcpy(part->planes[1], theta_deg, (gsize)n * sizeof(float));
    return part;
}

static struct exr_part *map_part(const struct eigenmaps *maps, int term, int light) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    g_autofree char *name = g_strdup_printf("E%03d_light_%04d", term, light);
    struct exr_part *part = exr_part_new(name, maps->width, maps->height, channels, EXR_HALF);
    gsize n = plane_size(maps);
    const float *rgb = maps->maps + n * COLOURS * (gsize)(term * maps->n_lights + light);
    for (gsize i = 0; i < n; i++)
        for (int c = 0; c < COLOURS; c++)
            part->planes[COLOURS - 1 - c][i] = rgb[COLOURS * i + (gsize)c];
    return part;
}

gboolean eigenmaps_write(const char *path, const struct eigenmaps *maps, GError **error) {
    static const char *const channels[] = {"W", NULL};
    struct exr_part *weights =
        exr_part_new("weights", maps->n_views, maps->n_terms, channels, EXR_FLOAT);
    memcpy(weights->planes[0], maps->weights,
           (gsize)maps->n_views * (gsize)maps->n_terms * sizeof(float));
    exr_set_string(weights, "mesorig.kind", "eigenmaps");
    exr_set_double(weights, "texel_mm", maps->texel_mm);
    exr_set_double(weights, "reference_mm", maps->reference_mm);
    exr_set_string(weights, "mesorig.name", maps->name ? maps->name : "");
    struct exr_file *file = exr_file_new();
    exr_file_add(file, weights);
    exr_file_add(file, eigenmaps_directions_part("views", maps->view_theta_deg, maps->view_phi_deg,
                                                 maps->n_views));
    exr_file_add(file, eigenmaps_directions_part("lights", maps->light_theta_deg,
                                                 maps->light_phi_deg, maps->n_lights));
    for (int term = 0; term < maps->n_terms; term++)
        for (int light = 0; light < maps->n_lights; light++)
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

static gboolean eigenmaps_read_directions(const struct exr_file *file, const char *name,
                                          const char *path, float **ret_theta_deg,
                                          float **ret_phi_deg, int *ret_n, GError **error) {
    const struct exr_part *part = exr_file_part(file, name);
    const float *theta = part ? exr_part_plane(part, "theta_deg") : NULL;
    const float *phi = part ? exr_part_plane(part, "phi_deg") : NULL;
    if (!theta || !phi || part->height != 1 || !exr_all_finite(theta, (gsize)part->width) ||
        !exr_all_finite(phi, (gsize)part->width)) {
        g_autofree char *what = g_strdup_printf("part %s is missing or damaged", name);
        return eigenmaps_format_error(path, error, what);
    }
    *ret_n = part->width;
    *ret_theta_deg = g_memdup2(theta, (gsize)part->width * sizeof(float));
    *ret_phi_deg = g_memdup2(phi, (gsize)part->width * sizeof(float));
    return TRUE;
}

static gboolean eigenmaps_read_head(struct eigenmaps *maps, const struct exr_file *file,
                                    const char *path, GError **error) {
    const struct exr_part *weights = exr_file_part(file, "weights");
    const float *plane = weights ? exr_part_plane(weights, "W") : NULL;
    const char *kind = NULL, *name = NULL;
    if (!plane || !exr_get_string(weights, "mesorig.kind", &kind, NULL) ||
        strcmp(kind, "eigenmaps") != 0)
        return eigenmaps_format_error(path, error, "there is no part \"weights\" of that kind");
    if (!exr_get_double(weights, "texel_mm", &maps->texel_mm, error) ||
        !exr_get_double(weights, "reference_mm", &maps->reference_mm, error) ||
        !exr_get_string(weights, "mesorig.name", &name, error) ||
        !eigenmaps_read_directions(file, "views", path, &maps->view_theta_deg, &maps->view_phi_deg,
                                   &maps->n_views, error) ||
        !eigenmaps_read_directions(file, "lights", path, &maps->light_theta_deg,
                                   &maps->light_phi_deg, &maps->n_lights, error))
        return FALSE;
    maps->name = g_strdup(name);
    maps->n_terms = weights->height;
    if (!(maps->texel_mm > 0) || !isfinite(maps->texel_mm) || !isfinite(maps->reference_mm))
        return eigenmaps_format_error(path, error, "texel_mm or reference_mm makes no sense");
    if (weights->width != maps->n_views || maps->n_terms > MAX_MAPS ||
        !exr_all_finite(plane, (gsize)maps->n_views * (gsize)maps->n_terms))
        return eigenmaps_format_error(path, error, "the weights do not fit the views");
    maps->weights = g_memdup2(plane, (gsize)maps->n_views * (gsize)maps->n_terms * sizeof(float));
    return TRUE;
}

static gboolean read_map(struct eigenmaps *maps, const struct exr_file *file, int term, int light,
                         const char *path, GError **error) {
    static const char *const channels[] = {"R", "G", "B"};
    g_autofree char *name = g_strdup_printf("E%03d_light_%04d", term, light);
    const struct exr_part *part = exr_file_part(file, name);
    if (!part || part->width != maps->width || part->height != maps->height)
        return eigenmaps_format_error(path, error, name);
    gsize n = plane_size(maps);
    float *rgb = maps->maps + n * COLOURS * (gsize)(term * maps->n_lights + light);
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
    if (!first || (gint64)maps->n_terms * maps->n_lights > (gint64)file->parts->len)
        return eigenmaps_format_error(path, error, "maps are missing");
    maps->width = first->width;
    maps->height = first->height;
    maps->maps = g_try_new(float, column_size(maps) * (gsize)maps->n_terms);
    if (!maps->maps)
        return eigenmaps_format_error(path, error, "they are larger than memory");
    for (int term = 0; term < maps->n_terms; term++)
        for (int light = 0; light < maps->n_lights; light++)
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
