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
    return (gsize)hsh->n_views * (gsize)hsh->width * (gsize)hsh->height;
}

static struct exr_part *hsh_term_part(const struct hsh *hsh, int term) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    g_autofree char *name = hsh_term_name(term);
    struct exr_part *part =
        exr_part_new(name, hsh->width, hsh->n_views * hsh->height, channels, EXR_HALF);
    for (int c = 0; c < COLOURS; c++) {
        float *plane = exr_part_plane(part, hsh_colours[c]);
        for (gsize i = 0; i < hsh_pixels(hsh); i++)
            plane[i] = hsh->values[(i * (gsize)hsh->n_terms + (gsize)term) * COLOURS + (gsize)c];
    }
    return part;
}

static struct exr_part *hsh_directions_part(const char *name, const float *theta_deg,
                                            const float *phi_deg, int n) {
    static const char *const channels[] = {"phi_deg", "theta_deg", NULL};
    struct exr_part *part = exr_part_new(name, n, 1, channels, EXR_FLOAT);
    memcpy(part->planes[0], phi_deg, sizeof(float) * (gsize)n);
    memcpy(part->planes[1], theta_deg, sizeof(float) * (gsize)n);
    return part;
}

static void hsh_set_head(struct exr_part *part, const struct hsh *hsh) {
    exr_set_string(part, "mesorig.kind", "hsh");
    exr_set_string(part, "mesorig.name", hsh->name ? hsh->name : "");
    exr_set_int(part, "mesorig.terms", hsh->n_terms);
    exr_set_int(part, "mesorig.views", hsh->n_views);
    exr_set_int(part, "mesorig.width", hsh->width);
    exr_set_int(part, "mesorig.height", hsh->height);
    exr_set_double(part, "mesorig.error", hsh->error);
    exr_set_double(part, "mesorig.exact_error", hsh->exact_error);
    exr_set_double(part, "mesorig.luminance_error", hsh->luminance_error);
    exr_set_double(part, "texel_mm", hsh->texel_mm);
    exr_set_double(part, "reference_mm", hsh->reference_mm);
}

gboolean hsh_write(const char *path, const struct hsh *hsh, GError **error) {
    struct exr_file *file = exr_file_new();
    for (int term = 0; term < hsh->n_terms; term++)
        exr_file_add(file, hsh_term_part(hsh, term));
    hsh_set_head(g_ptr_array_index(file->parts, 0), hsh);
    exr_file_add(
        file, hsh_directions_part("views", hsh->view_theta_deg, hsh->view_phi_deg, hsh->n_views));
    exr_file_add(file, hsh_directions_part("lights", hsh->light_theta_deg, hsh->light_phi_deg,
                                           hsh->n_lights));
    const gboolean ok = exr_write(path, file, EXR_PIZ, TRUE, error);
    exr_file_free(file);
    return ok;
}

static gboolean hsh_format_error(const char *path, GError **error, const char *what) {
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: these are not whole hemispherical harmonics: %s; compress again", path, what);
    return FALSE;
}

static gboolean hsh_read_directions(const struct exr_file *file, const char *name,
                                    float **ret_theta, float **ret_phi, int *ret_n) {
    const struct exr_part *part = exr_file_part(file, name);
    const float *theta = part ? exr_part_plane(part, "theta_deg") : NULL;
    const float *phi = part ? exr_part_plane(part, "phi_deg") : NULL;
    if (!theta || !phi || part->height != 1 || !exr_all_finite(theta, (gsize)part->width) ||
        !exr_all_finite(phi, (gsize)part->width))
        return FALSE;
    *ret_n = part->width;
    *ret_theta = g_memdup2(theta, sizeof(float) * (gsize)part->width);
    *ret_phi = g_memdup2(phi, sizeof(float) * (gsize)part->width);
    return TRUE;
}

static gboolean hsh_read_numbers(struct hsh *hsh, int *ret_views, const struct exr_part *part,
                                 GError **error) {
    const char *name = NULL;
    if (!exr_get_string(part, "mesorig.name", &name, error) ||
        !exr_get_int(part, "mesorig.terms", &hsh->n_terms, error) ||
        !exr_get_int(part, "mesorig.views", ret_views, error) ||
        !exr_get_int(part, "mesorig.width", &hsh->width, error) ||
        !exr_get_int(part, "mesorig.height", &hsh->height, error) ||
        !exr_get_double(part, "mesorig.error", &hsh->error, error) ||
        !exr_get_double(part, "mesorig.exact_error", &hsh->exact_error, error) ||
        !exr_get_double(part, "mesorig.luminance_error", &hsh->luminance_error, error) ||
        !exr_get_double(part, "texel_mm", &hsh->texel_mm, error) ||
        !exr_get_double(part, "reference_mm", &hsh->reference_mm, error))
        return FALSE;
    hsh->name = g_strdup(name);
    return TRUE;
}

static gboolean hsh_is_error(double value) {
    return value >= 0 && isfinite(value);
}

/* What is wrong with the first part's numbers, or NULL. */
static const char *hsh_check_head(const struct hsh *hsh, int n_views, const struct exr_part *part) {
    if (hsh->n_terms != 4 && hsh->n_terms != 9 && hsh->n_terms != 16)
        return "mesorig.terms is not 4, 9 or 16";
    if (n_views != hsh->n_views)
        return "mesorig.views is not the number of its views";
    if (hsh->width != part->width || hsh->height < 1 ||
        (gint64)hsh->height * hsh->n_views != part->height)
        return "mesorig.width or mesorig.height does not fit its parts";
    if (!(hsh->texel_mm > 0) || !isfinite(hsh->texel_mm) || !isfinite(hsh->reference_mm))
        return "texel_mm or reference_mm is not a size";
    if (!hsh_is_error(hsh->error) || !hsh_is_error(hsh->exact_error) ||
        !hsh_is_error(hsh->luminance_error))
        return "one of its errors is negative or not finite";
    return NULL;
}

static gboolean hsh_read_head(struct hsh *hsh, const struct exr_file *file, const char *path,
                              GError **error) {
    const struct exr_part *part = file->parts->len ? g_ptr_array_index(file->parts, 0) : NULL;
    const char *kind = NULL;
    int n_views;
    if (!part || !exr_get_string(part, "mesorig.kind", &kind, NULL) || strcmp(kind, "hsh") != 0)
        return hsh_format_error(path, error, "mesorig.kind of its first part is not hsh");
    if (!hsh_read_numbers(hsh, &n_views, part, error))
        return FALSE;
    if (!hsh_read_directions(file, "views", &hsh->view_theta_deg, &hsh->view_phi_deg,
                             &hsh->n_views) ||
        !hsh_read_directions(file, "lights", &hsh->light_theta_deg, &hsh->light_phi_deg,
                             &hsh->n_lights))
        return hsh_format_error(path, error, "part views or lights is missing or damaged");
    const char *what = hsh_check_head(hsh, n_views, part);
    return !what || hsh_format_error(path, error, what);
}

static gboolean hsh_read_term(struct hsh *hsh, const struct exr_file *file, int term) {
    g_autofree char *name = hsh_term_name(term);
    const struct exr_part *part = exr_file_part(file, name);
    for (int c = 0; c < COLOURS; c++) {
        const float *plane = part ? exr_part_plane(part, hsh_colours[c]) : NULL;
        if (!plane || part->width != hsh->width || part->height != hsh->n_views * hsh->height ||
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
