#include <math.h>
#include <string.h>

#include "codecs/codec/texel_model.h"
#include "exr/exr_half.h"
#include "lobes_private.h"

#define COLOURS 3

static const char *const rgb[] = {"R", "G", "B"}, *const xyzn[] = {"X", "Y", "Z", "N"};

char *lobes_value_part(const struct lobes *lobes, int value, const char **ret_channel) {
    static const char *const polynomial[] = {"C0", "C1", "C2", "C3", "C4", "C5"};
    static const char *const facet[] = {"diffuse", "specular", "normal", "tangent", "roughness"};
    static const char *const uv[] = {"U", "V"};
    if (lobes_traits[lobes->model].facet) {
        const int group = MIN(value / 3, 4), at = value - 3 * group;
        *ret_channel = group < 2 ? rgb[at] : group < 4 ? xyzn[at] : uv[at];
        return g_strdup(facet[group]);
    }
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

static int by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

/* Makes the part whose first channel holds the value number `first` of each texel
 * (lobes_value_part()). *ret_end is the number of the first value of the next part. */
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
    g_ptr_array_sort(channels, by_name);
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

struct exr_file *lobes_to_exr(const struct lobes *lobes) {
    struct exr_file *file = exr_file_new();
    for (int value = 0; value < lobes->n_values;) {
        struct exr_part *part = values_part(lobes, value, &value);
        exr_file_add(file, part);
    }
    const struct texel_model_head head = {
        .kind = lobes_model_name(lobes->model),
        .name = lobes->name,
        .names = {"mesorig.lobes", "mesorig.slices"},
        .numbers = {lobes->n_lobes, lobes->n_slices},
        .error = lobes->error,
        .luminance_error = lobes->luminance_error,
        .exact_error = lobes->exact_error,
    };
    texel_model_write_head(&head, &lobes->layout, file);
    return file;
}

static gboolean format_error(const char *path, GError **error, const char *what) {
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: this is not a valid file of an analytic model: %s; compress the BTF again",
                path, what);
    return FALSE;
}

static gboolean all_finite(const float *values, gsize n) {
    for (gsize i = 0; i < n; i++)
        if (!(fabsf(values[i]) <= EXR_HALF_LARGEST))
            return FALSE;
    return TRUE;
}

static gboolean read_head(struct lobes *lobes, const struct exr_file *file, const char *path,
                          GError **error) {
    struct texel_model_head head = {.names = {"mesorig.lobes", "mesorig.slices"}};
    const char *what = NULL;
    if (!lobes_model_parse(texel_model_kind(file), &lobes->model))
        return format_error(
            path, error,
            "mesorig.kind of the first part is not fields, ptm, lafortune, ward or ashikhmin");
    if (!texel_model_read_head(path, file, &head, &lobes->layout, &what, error))
        return what && format_error(path, error, what);
    const struct lobes_traits *traits = &lobes_traits[lobes->model];
    const int least = traits->lobed ? 1 : 0, most = traits->lobed ? LOBES_MAX_LOBES : 0;
    lobes->name = g_strdup(head.name);
    lobes->n_lobes = head.numbers[0];
    lobes->n_slices = head.numbers[1];
    lobes->error = head.error;
    lobes->luminance_error = head.luminance_error;
    lobes->exact_error = head.exact_error;
    if (lobes->n_lobes < least || lobes->n_lobes > most)
        return format_error(path, error,
                            traits->lobed ? "mesorig.lobes is not 1, 2 or 3"
                                          : "mesorig.lobes is not 0 in a model without lobes");
    if (lobes->n_slices < 1 ||
        (gsize)lobes->n_slices != (traits->each_view ? lobes->layout.views.n : 1))
        return format_error(path, error,
                            traits->each_view ? "mesorig.slices is not the number of views"
                                              : "mesorig.slices is not 1");
    lobes->n_values = traits->n_values + 4 * lobes->n_lobes;
    return TRUE;
}

static gboolean read_values(struct lobes *lobes, const struct exr_file *file, const char *path,
                            GError **error) {
    const gsize pixels = (gsize)lobes->n_slices * btf_layout_texels(&lobes->layout);
    lobes->values = g_try_new(float, pixels *(gsize)lobes->n_values);
    if (!lobes->values) {
        g_set_error(error, EXR_ERROR, EXR_ERROR_TOO_LARGE,
                    "%s: there is no memory for its %zu pixels of %d values; open it on a computer "
                    "with more memory",
                    path, pixels, lobes->n_values);
        return FALSE;
    }
    for (int value = 0; value < lobes->n_values; value++) {
        const char *channel;
        g_autofree char *name = lobes_value_part(lobes, value, &channel);
        const struct exr_part *part = exr_file_part(file, name);
        const float *plane = part ? exr_part_plane(part, channel) : NULL;
        g_autofree char *what = NULL;
        if (!part)
            what = g_strdup_printf("part “%s” is missing", name);
        else if (!plane)
            what = g_strdup_printf("part “%s” lacks channel %s", name, channel);
        else if ((gsize)part->width != lobes->layout.width ||
                 (gsize)part->height != (gsize)lobes->n_slices * lobes->layout.height)
            what = g_strdup_printf("part “%s” is %d × %d, but must be %zu × %zu", name, part->width,
                                   part->height, lobes->layout.width,
                                   (gsize)lobes->n_slices * lobes->layout.height);
        else if (!all_finite(plane, pixels))
            what = g_strdup_printf("channel %s of part “%s” has a value that is not finite",
                                   channel, name);
        if (what || !plane)
            return format_error(path, error, what);
        for (gsize i = 0; i < pixels; i++)
            lobes->values[i * (gsize)lobes->n_values + (gsize)value] = plane[i];
    }
    return TRUE;
}

struct lobes *lobes_from_exr(const struct exr_file *file, const char *path, GError **error) {
    struct lobes *lobes = g_new0(struct lobes, 1);
    if (!read_head(lobes, file, path, error) || !read_values(lobes, file, path, error))
        g_clear_pointer(&lobes, lobes_free);
    return lobes;
}

struct lobes *lobes_read(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    struct lobes *lobes = file ? lobes_from_exr(file, path, error) : NULL;
    exr_file_free(file);
    return lobes;
}
