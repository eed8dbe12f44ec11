#include <math.h>
#include <string.h>

#include "lobes_private.h"

#define COLOURS 3
#define LARGEST 65504.0F /* of a half */

static const char *const rgb[] = {"R", "G", "B"}, *const xyzn[] = {"X", "Y", "Z", "N"};

/* Of ward and ashikhmin. */
static char *facet_part(int value, const char **ret_channel) {
    static const char *const parts[] = {"diffuse", "specular", "normal", "tangent", "roughness"};
    static const char *const uv[] = {"U", "V"};
    const int group = MIN(value / 3, 4), at = value - 3 * group;
    *ret_channel = group < 2 ? rgb[at] : group < 4 ? xyzn[at] : uv[at];
    return g_strdup(parts[group]);
}

char *lobes_value_part(const struct lobes *lobes, int value, const char **ret_channel) {
    static const char *const polynomial[] = {"C0", "C1", "C2", "C3", "C4", "C5"};
    if (lobes->model == LOBES_WARD || lobes->model == LOBES_ASHIKHMIN)
        return facet_part(value, ret_channel);
    if (value < COLOURS) {
        *ret_channel = rgb[value];
        return g_strdup("colour");
    }
    value -= COLOURS;
    if (lobes->model == LOBES_PTM) {
        *ret_channel = polynomial[value];
        return g_strdup("polynomial");
    }
    if (lobes->model == LOBES_LAFORTUNE && value-- == 0) {
        *ret_channel = "D";
        return g_strdup("diffuse");
    }
    *ret_channel = xyzn[value % 4];
    return g_strdup_printf("lobe%d", value / 4 + 1);
}

static int lobes_file_by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

/* The part that begins with value first; ret_end is the first value of the next one. */
static struct exr_part *values_part(const struct lobes *lobes, int first, int *ret_end) {
    g_autoptr(GPtrArray) channels = g_ptr_array_new();
    const char *channel;
    g_autofree char *name = lobes_value_part(lobes, first, &channel);
    const gsize pixels = (gsize)lobes->n_slices * btf_layout_texels(&lobes->layout);
    int end = first;
    for (; end < lobes->n_values; end++) {
        g_autofree char *part = lobes_value_part(lobes, end, &channel);
        if (strcmp(part, name) != 0)
            break;
        g_ptr_array_add(channels, (gpointer)channel);
    }
    g_ptr_array_sort(channels, lobes_file_by_name);
    g_ptr_array_add(channels, NULL);
    struct exr_part *part =
        exr_part_new(name, lobes->layout.width, lobes->n_slices * lobes->layout.height,
                     (const char *const *)(gconstpointer)channels->pdata, EXR_HALF);
    for (int value = first; value < end; value++) {
        g_autofree char *same = lobes_value_part(lobes, value, &channel);
        float *plane = exr_part_plane(part, channel);
        for (gsize i = 0; i < pixels; i++)
            plane[i] = lobes->values[i * (gsize)lobes->n_values + (gsize)value];
    }
    *ret_end = end;
    return part;
}

static void lobes_file_set_head(struct exr_part *part, const struct lobes *lobes) {
    exr_set_string(part, "mesorig.kind", lobes_model_name(lobes->model));
    exr_set_string(part, "mesorig.name", lobes->name ? lobes->name : "");
    exr_set_int(part, "mesorig.lobes", lobes->n_lobes);
    exr_set_int(part, "mesorig.slices", lobes->n_slices);
    exr_set_int(part, "mesorig.width", lobes->layout.width);
    exr_set_int(part, "mesorig.height", lobes->layout.height);
    exr_set_double(part, "mesorig.error", lobes->error);
    exr_set_double(part, "mesorig.exact_error", lobes->exact_error);
    exr_set_double(part, "mesorig.luminance_error", lobes->luminance_error);
    btf_layout_write_sizes(&lobes->layout, part);
}

struct exr_file *lobes_to_exr(const struct lobes *lobes) {
    struct exr_file *file = exr_file_new();
    for (int value = 0; value < lobes->n_values;) {
        struct exr_part *part = values_part(lobes, value, &value);
        exr_file_add(file, part);
    }
    lobes_file_set_head(g_ptr_array_index(file->parts, 0), lobes);
    btf_layout_write_directions(&lobes->layout, file);
    return file;
}

gboolean lobes_write(const char *path, const struct lobes *lobes, GError **error) {
    struct exr_file *file = lobes_to_exr(lobes);
    const gboolean ok = exr_write(path, file, EXR_PIZ, TRUE, error);
    exr_file_free(file);
    return ok;
}

static gboolean lobes_file_format_error(const char *path, GError **error, const char *what) {
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: this is not a whole model of lobes: %s; compress again", path, what);
    return FALSE;
}

static gboolean lobes_file_all_finite(const float *values, gsize n) {
    for (gsize i = 0; i < n; i++)
        if (!(fabsf(values[i]) <= LARGEST))
            return FALSE;
    return TRUE;
}

static int expected_values(const struct lobes *lobes) {
    switch (lobes->model) {
    case LOBES_FIELDS:
        return COLOURS + 4 * lobes->n_lobes;
    case LOBES_PTM:
        return COLOURS + 6;
    case LOBES_LAFORTUNE:
        return COLOURS + 1 + 4 * lobes->n_lobes;
    default:
        return 14;
    }
}

static gboolean is_error(double value) {
    return value >= 0 && isfinite(value);
}

static gboolean lobes_file_read_head(struct lobes *lobes, const struct exr_file *file,
                                     const char *path, GError **error) {
    const struct exr_part *part = file->parts->len ? g_ptr_array_index(file->parts, 0) : NULL;
    struct btf_layout *layout = &lobes->layout;
    const char *kind = NULL, *name = NULL;
    int width, height;
    if (!part || !exr_get_string(part, "mesorig.kind", &kind, NULL) ||
        !lobes_model_parse(kind, &lobes->model))
        return lobes_file_format_error(path, error, "its first part is not of such a kind");
    if (!exr_get_string(part, "mesorig.name", &name, error) ||
        !exr_get_double(part, "mesorig.error", &lobes->error, error) ||
        !exr_get_double(part, "mesorig.exact_error", &lobes->exact_error, error) ||
        !exr_get_double(part, "mesorig.luminance_error", &lobes->luminance_error, error) ||
        !exr_get_int(part, "mesorig.lobes", &lobes->n_lobes, error) ||
        !exr_get_int(part, "mesorig.slices", &lobes->n_slices, error) ||
        !exr_get_int(part, "mesorig.width", &width, error) ||
        !exr_get_int(part, "mesorig.height", &height, error))
        return FALSE;
    lobes->name = g_strdup(name);
    const char *what = btf_layout_read(file, part, layout);
    layout->width = (gsize)width;
    layout->height = (gsize)height;
    if (what)
        return lobes_file_format_error(path, error, what);
    const gboolean lobed = lobes->model == LOBES_FIELDS || lobes->model == LOBES_LAFORTUNE;
    const gboolean views = lobes->model == LOBES_FIELDS || lobes->model == LOBES_PTM;
    if (lobes->n_lobes < (lobed ? 1 : 0) || lobes->n_lobes > (lobed ? LOBES_MAX_LOBES : 0))
        return lobes_file_format_error(path, error, "there can be 1 to 3 lobes");
    if (lobes->n_slices < 1 || (gsize)lobes->n_slices != (views ? layout->views.n : 1))
        return lobes_file_format_error(path, error, "the slices do not fit the views");
    if (width != part->width || height < 1 || (gint64)height * lobes->n_slices != part->height)
        return lobes_file_format_error(path, error, "its size does not fit its parts");
    if (!is_error(lobes->error) || !is_error(lobes->exact_error) ||
        !is_error(lobes->luminance_error))
        return lobes_file_format_error(path, error, "its errors are negative or not finite");
    return TRUE;
}

static gboolean lobes_file_read_values(struct lobes *lobes, const struct exr_file *file,
                                       const char *path, GError **error) {
    const gsize pixels = (gsize)lobes->n_slices * btf_layout_texels(&lobes->layout);
    lobes->n_values = expected_values(lobes);
    lobes->values = g_try_new(float, pixels *(gsize)lobes->n_values);
    if (!lobes->values)
        return lobes_file_format_error(path, error, "it is larger than memory");
    for (int value = 0; value < lobes->n_values; value++) {
        const char *channel;
        g_autofree char *name = lobes_value_part(lobes, value, &channel);
        const struct exr_part *part = exr_file_part(file, name);
        const float *plane = part ? exr_part_plane(part, channel) : NULL;
        if (!plane || (gsize)part->width != lobes->layout.width ||
            (gsize)part->height != (gsize)lobes->n_slices * lobes->layout.height ||
            !lobes_file_all_finite(plane, pixels)) {
            g_autofree char *what =
                g_strdup_printf("part %s, channel %s, is missing or damaged", name, channel);
            return lobes_file_format_error(path, error, what);
        }
        for (gsize i = 0; i < pixels; i++)
            lobes->values[i * (gsize)lobes->n_values + (gsize)value] = plane[i];
    }
    return TRUE;
}

struct lobes *lobes_from_exr(const struct exr_file *file, const char *path, GError **error) {
    struct lobes *lobes = g_new0(struct lobes, 1);
    if (!lobes_file_read_head(lobes, file, path, error) ||
        !lobes_file_read_values(lobes, file, path, error))
        g_clear_pointer(&lobes, lobes_free);
    return lobes;
}

struct lobes *lobes_read(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    struct lobes *lobes = file ? lobes_from_exr(file, path, error) : NULL;
    exr_file_free(file);
    return lobes;
}
