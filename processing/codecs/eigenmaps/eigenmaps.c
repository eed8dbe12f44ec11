#include "eigenmaps_private.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "exr/exr.h"
#include "exr/exr_half.h"

#define MAX_MAPS 1024
#define COLOURS  3

void eigenmaps_free(struct eigenmaps *maps) {
    if (!maps)
        return;
    g_free(maps->name);
    btf_layout_clear(&maps->layout);
    g_free(maps->weights);
    g_free(maps->maps);
    scratch_file_free(maps->file);
    g_free(maps);
}

static char *map_name(int term, gsize light) {
    return g_strdup_printf("E%03d_light_%04zu", term, light);
}

/* Returns a map: height × width × 3 (R, G, B). */
static float *map(const struct eigenmaps *maps, int term, gsize light) {
    const gsize n = btf_layout_texels(&maps->layout) * COLOURS;
    return maps->maps + n * ((gsize)term * maps->layout.lights.n + light);
}

/* Returns a map. If the maps are in the file, reads the map to buffer and returns buffer. Returns
 * NULL with an error on failure. */
static const float *read_values(const struct eigenmaps *maps, int term, gsize light, float *buffer,
                                GError **error) {
    const gsize n = btf_layout_texels(&maps->layout) * COLOURS;
    if (!maps->file)
        return map(maps, term, light);
    const gsize at = n * ((gsize)term * maps->layout.lights.n + light);
    return scratch_file_read(maps->file, at * sizeof *buffer, buffer, n * sizeof *buffer, error)
               ? buffer
               : NULL;
}

/* Creates all parts of a file. The parts of the maps have no pixels yet. of_views are the weights,
 * n_terms × n_views. */
static struct exr_file *new_file(const struct eigenmaps *maps, int n_terms, const float *of_views) {
    static const char *const channels[] = {"W", NULL}, *const bgr[] = {"B", "G", "R", NULL};
    const int width = (int)maps->layout.width, height = (int)maps->layout.height;
    const gsize n_views = maps->layout.views.n;
    struct exr_part *weights = exr_part_new("weights", (int)n_views, n_terms, channels, EXR_FLOAT);
    memcpy(weights->planes[0], of_views, n_views * (gsize)n_terms * sizeof(float));
    exr_set_string(weights, "mesorig.kind", "eigenmaps");
    btf_layout_write_sizes(&maps->layout, weights);
    exr_set_string(weights, "mesorig.name", maps->name ? maps->name : "");
    struct exr_file *file = exr_file_new();
    exr_file_add(file, weights);
    btf_layout_write_directions(&maps->layout, file);
    for (int term = 0; term < n_terms; term++)
        for (gsize light = 0; light < maps->layout.lights.n; light++) {
            g_autofree char *name = map_name(term, light);
            struct exr_part *part = exr_part_new(name, width, height, bgr, EXR_HALF);
            exr_part_drop_planes(part);
            exr_file_add(file, part);
        }
    return file;
}

static gboolean eigenmaps_fill(struct exr_part *part, gpointer data, GError **error) {
    const struct eigenmaps *maps = data;
    const gsize texels = btf_layout_texels(&maps->layout);
    int term = 0;
    gsize light = 0;
    sscanf(part->name, "E%d_light_%zu", &term, &light);
    g_autofree float *buffer = maps->file ? g_new(float, texels *COLOURS) : NULL;
    const float *rgb = read_values(maps, term, light, buffer, error);
    for (gsize i = 0; rgb && i < texels * COLOURS; i++)
        part->planes[COLOURS - 1 - i % COLOURS][i / COLOURS] = rgb[i];
    return rgb != NULL;
}

/* The W_i are orthonormal, and the part of A that the maps lack is orthogonal to them. The squares
 * of the two errors therefore add. ‖A‖² = Σ ‖E_i‖² / (1 − e²), where e is `error`. */
double eigenmaps_rounded_error(const struct eigenmaps *maps, double error) {
    const gsize n = btf_layout_texels(&maps->layout) * COLOURS;
    g_autofree guint16 *halves = g_new(guint16, n);
    g_autofree float *rounded = g_new(float, n), *buffer = maps->file ? g_new(float, n) : NULL;
    double added = 0, all = 0;
    for (int term = 0; term < maps->n_terms; term++)
        for (gsize light = 0; light < maps->layout.lights.n; light++) {
            const float *rgb = read_values(maps, term, light, buffer, NULL);
            if (!rgb)
                return NAN;
            exr_half_from_floats(halves, rgb, n);
            exr_half_to_floats(rounded, halves, n);
            for (gsize i = 0; i < n; i++) {
                const double value = (double)rgb[i], off = (double)rounded[i] - value;
                added += off * off;
                all += value * value;
            }
        }
    return all > 0 ? sqrt(error * error + added / all * (1 - error * error)) : error;
}

gboolean eigenmaps_write(const char *path, const struct eigenmaps *maps, GError **error) {
    g_autoptr(ExrFile) file = new_file(maps, maps->n_terms, maps->weights);
    return exr_write_filled(path, file, EXR_PIZ, TRUE, eigenmaps_fill, (gpointer)maps, error);
}

gboolean eigenmaps_write_view(const char *path, const struct eigenmaps *maps, ExrFill fill,
                              gpointer data, GError **error) {
    static const float one = 1;
    g_autoptr(ExrFile) file = new_file(maps, 1, &one);
    g_return_val_if_fail(maps->layout.views.n == 1, FALSE);
    return exr_write_filled(path, file, EXR_PIZ, TRUE, fill, data, error);
}

static gboolean format_error(const char *path, GError **error, const char *what) {
    g_set_error(
        error, EXR_ERROR, EXR_ERROR_FORMAT,
        "%s: this is not a valid file of eigen-maps: %s; compress or process the session again",
        path, what);
    return FALSE;
}

static gboolean read_head(struct eigenmaps *maps, const struct exr_file *file, const char *path,
                          GError **error) {
    const struct exr_part *weights = exr_file_part(file, "weights");
    const float *plane = weights ? exr_part_plane(weights, "W") : NULL;
    const char *kind = NULL, *name = NULL;
    if (!plane)
        return format_error(path, error, "the part “weights” with the channel W is missing");
    if (!exr_get_string(weights, "mesorig.kind", &kind, NULL) || strcmp(kind, "eigenmaps") != 0)
        return format_error(path, error, "mesorig.kind of the part “weights” is not eigenmaps");
    if (!exr_get_string(weights, "mesorig.name", &name, error)) {
        g_prefix_error(error, "%s: ", path);
        return FALSE;
    }
    maps->name = g_strdup(name);
    maps->n_terms = weights->height;
    const char *what = btf_layout_read(file, weights, &maps->layout);
    if (what)
        return format_error(path, error, what);
    if ((gsize)weights->width != maps->layout.views.n)
        return format_error(path, error,
                            "the parts “weights” and “views” have different numbers of views");
    if (maps->n_terms > MAX_MAPS)
        return format_error(path, error,
                            "there are more than " G_STRINGIFY(MAX_MAPS) " terms of weights");
    if (!exr_all_finite(plane, maps->layout.views.n * (gsize)maps->n_terms))
        return format_error(path, error, "a weight is infinite or not a number");
    maps->weights = g_memdup2(plane, maps->layout.views.n * (gsize)maps->n_terms * sizeof(float));
    return TRUE;
}

static gboolean read_map(struct eigenmaps *maps, const struct exr_file *file, int term, gsize light,
                         const char *path, GError **error) {
    static const char *const channels[] = {"R", "G", "B"};
    g_autofree char *name = map_name(term, light);
    const struct exr_part *part = exr_file_part(file, name);
    const gsize n = btf_layout_texels(&maps->layout);
    float *rgb = map(maps, term, light);
    if (!part) {
        g_autofree char *what = g_strdup_printf("the part “%s” is missing", name);
        return format_error(path, error, what);
    }
    if ((gsize)part->width != maps->layout.width || (gsize)part->height != maps->layout.height) {
        g_autofree char *what = g_strdup_printf(
            "the part “%s” has %d × %d texels, but E000_light_0000 has %zu × %zu", name,
            part->width, part->height, maps->layout.width, maps->layout.height);
        return format_error(path, error, what);
    }
    for (int c = 0; c < COLOURS; c++) {
        const float *plane = exr_part_plane(part, channels[c]);
        if (!plane || !exr_all_finite(plane, n)) {
            g_autofree char *what = g_strdup_printf(
                "channel %s of part “%s” is missing or has a value that is not finite", channels[c],
                name);
            return format_error(path, error, what);
        }
        for (gsize i = 0; i < n; i++)
            rgb[COLOURS * i + (gsize)c] = plane[i];
    }
    return TRUE;
}

static gboolean read_maps(struct eigenmaps *maps, const struct exr_file *file, const char *path,
                          GError **error) {
    const struct exr_part *first = exr_file_part(file, "E000_light_0000");
    const gsize n_maps = (gsize)maps->n_terms * maps->layout.lights.n;
    if (!first || n_maps > file->parts->len)
        return format_error(path, error, "the part of at least one term and light is missing");
    maps->layout.width = (gsize)first->width;
    maps->layout.height = (gsize)first->height;
    maps->maps = g_try_new(float, n_maps *btf_layout_texels(&maps->layout) * COLOURS);
    if (!maps->maps) {
        g_set_error(error, EXR_ERROR, EXR_ERROR_TOO_LARGE,
                    "%s: there is no memory for its %zu maps of %zu × %zu texels; open it on a "
                    "computer with more memory",
                    path, n_maps, maps->layout.width, maps->layout.height);
        return FALSE;
    }
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
    if (!read_head(maps, file, path, error) || !read_maps(maps, file, path, error))
        g_clear_pointer(&maps, eigenmaps_free);
    exr_file_free(file);
    return maps;
}
