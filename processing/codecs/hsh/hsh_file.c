#include "hsh.h"

#include <math.h>
#include <string.h>

#include "exr/exr.h"

#define COLOURS 3

static const char *const hsh_colours[COLOURS] = {"R", "G", "B"};

static char *hsh_term_name(int term) {
    return g_strdup_printf("term%d", term);
}

static gsize hsh_pixels(const struct hsh *hsh) {
    return hsh->layout.views.n * btf_layout_texels(&hsh->layout);
}

static struct exr_part *hsh_term_part(const struct hsh *hsh, int term) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    g_autofree char *name = hsh_term_name(term);
    struct exr_part *part = exr_part_new(
        name, hsh->layout.width, hsh->layout.views.n * hsh->layout.height, channels, EXR_HALF);
    for (int c = 0; c < COLOURS; c++) {
        float *plane = exr_part_plane(part, hsh_colours[c]);
        for (gsize i = 0; i < hsh_pixels(hsh); i++)
            plane[i] = hsh->values[(i * (gsize)hsh->n_terms + (gsize)term) * COLOURS + (gsize)c];
    }
    return part;
}

static void hsh_set_head(struct exr_part *part, const struct hsh *hsh) {
    exr_set_string(part, "mesorig.kind", "hsh");
    exr_set_string(part, "mesorig.name", hsh->name ? hsh->name : "");
    exr_set_int(part, "mesorig.terms", hsh->n_terms);
    exr_set_int(part, "mesorig.views", hsh->layout.views.n);
    exr_set_int(part, "mesorig.width", hsh->layout.width);
    exr_set_int(part, "mesorig.height", hsh->layout.height);
    exr_set_double(part, "mesorig.error", hsh->error);
    exr_set_double(part, "mesorig.exact_error", hsh->exact_error);
    exr_set_double(part, "mesorig.luminance_error", hsh->luminance_error);
    btf_layout_write_sizes(&hsh->layout, part);
}

gboolean hsh_write(const char *path, const struct hsh *hsh, GError **error) {
    struct exr_file *file = exr_file_new();
    for (int term = 0; term < hsh->n_terms; term++)
        exr_file_add(file, hsh_term_part(hsh, term));
    hsh_set_head(g_ptr_array_index(file->parts, 0), hsh);
    btf_layout_write_directions(&hsh->layout, file);
    const gboolean ok = exr_write(path, file, EXR_PIZ, TRUE, error);
    exr_file_free(file);
    return ok;
}

static gboolean hsh_format_error(const char *path, GError **error, const char *what) {
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: these are not whole hemispherical harmonics: %s; compress again", path, what);
    return FALSE;
}

static gboolean hsh_is_error(double value) {
    return value >= 0 && isfinite(value);
}

static gboolean hsh_read_head(struct hsh *hsh, const struct exr_file *file, const char *path,
                              GError **error) {
    const struct exr_part *part = file->parts->len ? g_ptr_array_index(file->parts, 0) : NULL;
    struct btf_layout *layout = &hsh->layout;
    const char *kind = NULL, *name = NULL;
    int n_views, width, height;
    if (!part || !exr_get_string(part, "mesorig.kind", &kind, NULL) || strcmp(kind, "hsh") != 0)
        return hsh_format_error(path, error, "mesorig.kind of its first part is not hsh");
    if (!exr_get_string(part, "mesorig.name", &name, error) ||
        !exr_get_int(part, "mesorig.terms", &hsh->n_terms, error) ||
        !exr_get_int(part, "mesorig.views", &n_views, error) ||
        !exr_get_int(part, "mesorig.width", &width, error) ||
        !exr_get_int(part, "mesorig.height", &height, error) ||
        !exr_get_double(part, "mesorig.error", &hsh->error, error) ||
        !exr_get_double(part, "mesorig.exact_error", &hsh->exact_error, error) ||
        !exr_get_double(part, "mesorig.luminance_error", &hsh->luminance_error, error))
        return FALSE;
    hsh->name = g_strdup(name);
    const char *what = btf_layout_read(file, part, layout);
    layout->width = (gsize)width;
    layout->height = (gsize)height;
    if (what)
        return hsh_format_error(path, error, what);
    if (hsh->n_terms != 4 && hsh->n_terms != 9 && hsh->n_terms != 16)
        return hsh_format_error(path, error, "mesorig.terms is not 4, 9 or 16");
    if (n_views < 1 || (gsize)n_views != layout->views.n)
        return hsh_format_error(path, error, "mesorig.views is not the number of its views");
    if (width != part->width || height < 1 || (gint64)height * n_views != part->height)
        return hsh_format_error(path, error,
                                "mesorig.width or mesorig.height does not fit its parts");
    if (!hsh_is_error(hsh->error) || !hsh_is_error(hsh->exact_error) ||
        !hsh_is_error(hsh->luminance_error))
        return hsh_format_error(path, error, "one of its errors is negative or not finite");
    return TRUE;
}

static gboolean hsh_read_term(struct hsh *hsh, const struct exr_file *file, int term) {
    g_autofree char *name = hsh_term_name(term);
    const struct exr_part *part = exr_file_part(file, name);
    for (int c = 0; c < COLOURS; c++) {
        const float *plane = part ? exr_part_plane(part, hsh_colours[c]) : NULL;
        if (!plane || (gsize)part->width != hsh->layout.width ||
            (gsize)part->height != hsh->layout.views.n * hsh->layout.height ||
            !exr_all_finite(plane, hsh_pixels(hsh)))
            return FALSE;
        for (gsize i = 0; i < hsh_pixels(hsh); i++)
            hsh->values[(i * (gsize)hsh->n_terms + (gsize)term) * COLOURS + (gsize)c] = plane[i];
    }
    return TRUE;
}

static gboolean hsh_read_values(struct hsh *hsh, const struct exr_file *file, const char *path,
                                GError **error) {
    hsh->values = g_try_new(float, hsh_pixels(hsh) * (gsize)hsh->n_terms * COLOURS);
    if (!hsh->values)
        return hsh_format_error(path, error, "its values are larger than memory");
    for (int term = 0; term < hsh->n_terms; term++)
        if (!hsh_read_term(hsh, file, term)) {
            g_autofree char *what = g_strdup_printf(
                "part term%d is missing, has another size, or has values that are not finite",
                term);
            return hsh_format_error(path, error, what);
        }
    return TRUE;
}

struct hsh *hsh_read(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    struct hsh *hsh = g_new0(struct hsh, 1);
    if (!file || !hsh_read_head(hsh, file, path, error) || !hsh_read_values(hsh, file, path, error))
        g_clear_pointer(&hsh, hsh_free);
    exr_file_free(file);
    return hsh;
}
