#include "neural_private.h"

#include <math.h>
#include <string.h>

#include "codecs/codec/texel_model.h"
#include "exr/mip_parts.h"

#define LARGEST 65504.0 /* largest value of a number in a file */

static const char *const rgba[] = {"R", "G", "B", "A"};
static const char *const abgr[] = {"A", "B", "G", "R", NULL};
static const char *const xyz[] = {"X", "Y", "Z", NULL};

/* Adds the parts of an array of bytes. An array of n channels has n / 4 parts of four channels. */

static void add_pictures(struct exr_file *file, const char *name, const guint8 *bytes, gsize width,
                         gsize height, gsize n_channels) {
    for (gsize k = 0; k < n_channels; k++) {
        g_autofree char *numbered = g_strdup_printf("%s%zu", name, k / 4 + 1);
        if (k % 4 == 0)
            exr_file_add(file, exr_part_new(numbered, (int)width, (int)height, abgr, EXR_HALF));
        float *plane = exr_part_plane(exr_file_part(file, numbered), rgba[k % 4]);
        for (gsize i = 0; i < width * height; i++)
            plane[i] = bytes[i * n_channels + k];
    }
}

static void add_picture(struct exr_file *file, const char *name, const char *channel,
                        const guint8 *bytes, gsize width, gsize height) {
    const char *const channels[] = {channel, NULL};
    struct exr_part *part = exr_part_new(name, (int)width, (int)height, channels, EXR_HALF);
    for (gsize i = 0; i < width * height; i++)
        part->planes[0][i] = bytes[i];
    exr_file_add(file, part);
}

/* Lists the scales in the order of the part "scales". Returns their number. */
#define MAX_SCALES (NEURAL_MAX_CHANNELS + 1 + 2 * NEURAL_PLANE_CHANNELS)
static int list_scales(struct neural *neural, struct neural_scale *ret[MAX_SCALES]) {
    int n = 0;
    for (int k = 0; k < neural->n_channels; k++)
        ret[n++] = &neural->surface_scales[k];
    ret[n++] = &neural->height_scale;
    for (int k = 0; k < NEURAL_PLANE_CHANNELS; k++)
        ret[n++] = &neural->half_scales[k];
    for (int k = 0; k < NEURAL_PLANE_CHANNELS; k++)
        ret[n++] = &neural->difference_scales[k];
    return n;
}

static void add_scales(struct exr_file *file, const struct neural *neural) {
    static const char *const of_scales[] = {"MINIMUM", "STEP", NULL};
    static const char *const of_rows[] = {"BIAS", "MINIMUM", "STEP", NULL};
    struct neural_scale *scales[MAX_SCALES];
    const int n = list_scales((struct neural *)neural, scales);
    struct exr_part *part = exr_part_new("scales", n, 1, of_scales, EXR_FLOAT);
    for (int k = 0; k < n; k++) {
        part->planes[0][k] = scales[k]->minimum;
        part->planes[1][k] = scales[k]->step;
    }
    exr_file_add(file, part);
    part = exr_part_new("rows", NEURAL_ROWS, 1, of_rows, EXR_FLOAT);
    for (int k = 0; k < NEURAL_ROWS; k++) {
        part->planes[0][k] = neural->biases[k];
        part->planes[1][k] = neural->rows[k].minimum;
        part->planes[2][k] = neural->rows[k].step;
    }
    exr_file_add(file, part);
}

static void add_positions(struct exr_file *file, const char *name, const float *positions,
                          gsize n) {
    if (!positions)
        return;
    struct exr_part *part = exr_part_new(name, (int)n, 1, xyz, EXR_FLOAT);
    for (gsize i = 0; i < n; i++)
        for (gsize k = 0; k < 3; k++)
            part->planes[k][i] = positions[3 * i + k];
    exr_file_add(file, part);
}

/* Gives the size of a layer's weights. */
static void layer_size(int n_channels, int layer, gsize *ret_inputs, gsize *ret_outputs) {
    *ret_inputs = layer == 0 ? (gsize)neural_inputs(n_channels) : NEURAL_HIDDEN;
    *ret_outputs = layer == NEURAL_LAYERS - 1 ? NEURAL_OUTPUTS : NEURAL_HIDDEN;
}

static struct exr_file *to_exr(const struct neural *neural) {
    const struct btf_layout *layout = &neural->layout;
    const gsize w = layout->width, h = layout->height;
    const guint8 *weights = neural->weights;
    struct exr_file *file = exr_file_new();
    add_pictures(file, "surface", neural->surface, w, h, (gsize)neural->n_channels);
    add_picture(file, "heights", "Z", neural->heights, 2 * w, 2 * h);
    add_pictures(file, "halves", neural->halves, NEURAL_PLANE, NEURAL_PLANE, NEURAL_PLANE_CHANNELS);
    add_pictures(file, "differences", neural->differences, NEURAL_PLANE, NEURAL_PLANE,
                 NEURAL_PLANE_CHANNELS);
    for (int layer = 0; layer < NEURAL_LAYERS; layer++) {
        g_autofree char *name = g_strdup_printf("weights%d", layer + 1);
        gsize inputs, outputs;
        layer_size(neural->n_channels, layer, &inputs, &outputs);
        add_picture(file, name, "W", weights, inputs, outputs);
        weights += inputs * outputs;
    }
    add_scales(file, neural);
    const struct texel_model_head head = {
        .kind = "neural",
        .name = neural->name,
        .names = {"mesorig.channels", "mesorig.slices"},
        .numbers = {neural->n_channels, 1},
        .error = neural->error,
        .luminance_error = neural->luminance_error,
        .exact_error = neural->exact_error,
    };
    texel_model_write_head(&head, layout, file);
    add_positions(file, "cameras", neural->camera_mm, layout->views.n);
    add_positions(file, "lamps", neural->lamp_mm, layout->lights.n);
    return file;
}

gboolean neural_write(const char *path, struct neural *const *levels, int n, GError **error) {
    g_autoptr(ExrFile) file = exr_file_new();
    for (int level = 0; level < n; level++)
        mip_parts_add(file, to_exr(levels[level]), level);
    return exr_write(path, file, EXR_ZIP, TRUE, error);
}

static gboolean format_error(const char *path, GError **error, const char *what) {
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: this is not a valid file of neural planes: %s; compress the BTF again", path,
                what);
    return FALSE;
}

/* Returns a part of this size. If there is none, returns NULL and sets *ret_what to a clause that
 * says what is wrong (g_free()). */
static const struct exr_part *find_part(const struct exr_file *file, const char *name, gsize width,
                                        gsize height, char **ret_what) {
    const struct exr_part *part = exr_file_part(file, name);
    if (!part)
        *ret_what = g_strdup_printf("part “%s” is missing", name);
    else if ((gsize)part->width != width || (gsize)part->height != height)
        *ret_what = g_strdup_printf("part “%s” is %d × %d, but must be %zu × %zu", name,
                                    part->width, part->height, width, height);
    return *ret_what ? NULL : part;
}

/* Returns the values of a channel. If the channel is missing or a value is not finite, returns NULL
 * and sets *ret_what as find_part() does. */
static const float *find_plane(const struct exr_part *part, const char *channel, char **ret_what) {
    const float *plane = exr_part_plane(part, channel);
    if (!plane)
        *ret_what = g_strdup_printf("part “%s” lacks channel %s", part->name, channel);
    else if (!exr_all_finite(plane, (gsize)part->width * (gsize)part->height))
        *ret_what = g_strdup_printf("channel %s of part “%s” has a value that is not finite",
                                    channel, part->name);
    return *ret_what ? NULL : plane;
}

/* Reads a channel of bytes into ret, `apart` elements apart. */
static char *read_bytes(const struct exr_part *part, const char *channel, guint8 *ret,
                        gsize apart) {
    char *what = NULL;
    const float *plane = find_plane(part, channel, &what);
    for (gsize i = 0; plane && i < (gsize)part->width * (gsize)part->height; i++) {
        if (!(plane[i] >= 0 && plane[i] <= 255))
            return g_strdup_printf("channel %s of part “%s” has the value %g, but all values must "
                                   "be 0 to 255",
                                   channel, part->name, (double)plane[i]);
        ret[i * apart] = (guint8)lrintf(plane[i]);
    }
    return what;
}

/* These functions return NULL on success, otherwise a clause that says what is wrong (g_free()). */

static char *read_pictures(const struct exr_file *file, const char *name, guint8 *bytes,
                           gsize width, gsize height, gsize n_channels) {
    char *what = NULL;
    for (gsize k = 0; !what && k < n_channels; k++) {
        g_autofree char *numbered = g_strdup_printf("%s%zu", name, k / 4 + 1);
        const struct exr_part *part = find_part(file, numbered, width, height, &what);
        if (part)
            what = read_bytes(part, rgba[k % 4], bytes + k, n_channels);
    }
    return what;
}

static char *read_picture(const struct exr_file *file, const char *name, const char *channel,
                          guint8 *bytes, gsize width, gsize height) {
    char *what = NULL;
    const struct exr_part *part = find_part(file, name, width, height, &what);
    return part ? read_bytes(part, channel, bytes, 1) : what;
}

static gboolean is_moderate(const struct neural_scale *scale, double divisor) {
    return (fabs((double)scale->minimum) + 255 * fabs((double)scale->step)) / divisor <= LARGEST;
}

/* Checks that no value of the evaluation can overflow. */
static char *check_scales(const struct neural *neural, struct neural_scale *const *scales, int n) {
    for (int k = 0; k < n; k++)
        if (!is_moderate(scales[k], 1))
            return g_strdup_printf("the scale %d of part “scales” is larger than %g", k, LARGEST);
    for (int k = 0; k < NEURAL_ROWS; k++)
        if (!is_moderate(&neural->rows[k], 1) || !(fabsf(neural->biases[k]) <= (float)LARGEST))
            return g_strdup_printf("a value in row %d of part “rows” is larger than %g", k,
                                   LARGEST);
    if (!is_moderate(&neural->height_scale, neural->layout.texel_mm) ||
        !(neural->height_scale.step >= 0))
        return g_strdup_printf("the step of the heights is negative, or a height is larger than %g "
                               "texels",
                               LARGEST);
    return NULL;
}

static char *read_weights(struct neural *neural, const struct exr_file *file) {
    guint8 *weights = neural->weights;
    char *what = NULL;
    for (int layer = 0; !what && layer < NEURAL_LAYERS; layer++) {
        g_autofree char *name = g_strdup_printf("weights%d", layer + 1);
        gsize inputs, outputs;
        layer_size(neural->n_channels, layer, &inputs, &outputs);
        what = read_picture(file, name, "W", weights, inputs, outputs);
        weights += inputs * outputs;
    }
    return what;
}

static char *read_scales(struct neural *neural, const struct exr_file *file) {
    struct neural_scale *scales[MAX_SCALES];
    const int n = list_scales(neural, scales);
    char *what = NULL;
    const struct exr_part *part = find_part(file, "scales", (gsize)n, 1, &what);
    const float *minimum = part ? find_plane(part, "MINIMUM", &what) : NULL;
    const float *step = minimum ? find_plane(part, "STEP", &what) : NULL;
    for (int k = 0; step && k < n; k++)
        *scales[k] = (struct neural_scale){minimum[k], step[k]};
    part = step ? find_part(file, "rows", NEURAL_ROWS, 1, &what) : NULL;
    const float *bias = part ? find_plane(part, "BIAS", &what) : NULL;
    minimum = bias ? find_plane(part, "MINIMUM", &what) : NULL;
    step = minimum ? find_plane(part, "STEP", &what) : NULL;
    for (int k = 0; step && k < NEURAL_ROWS; k++) {
        neural->rows[k] = (struct neural_scale){minimum[k], step[k]};
        neural->biases[k] = bias[k];
    }
    return what ? what : check_scales(neural, scales, n);
}

/* Reads positions, which must be above the reference plane. */
static char *read_positions(const struct exr_file *file, const char *name, gsize n,
                            double reference_mm, float **ret) {
    char *what = NULL;
    const struct exr_part *part = find_part(file, name, n, 1, &what);
    *ret = part ? g_new0(float, 3 * n) : NULL;
    for (gsize k = 0; part && !what && k < 3; k++) {
        const float *plane = find_plane(part, xyz[k], &what);
        for (gsize i = 0; plane && i < n; i++)
            (*ret)[3 * i + k] = plane[i];
    }
    for (gsize i = 0; part && !what && i < n; i++)
        if (!((*ret)[3 * i + 2] > reference_mm))
            what = g_strdup_printf("position %zu of part “%s” is not above the reference plane", i,
                                   name);
    return what;
}

static gboolean read_head(struct neural *neural, const struct exr_file *file, const char *path,
                          GError **error) {
    struct texel_model_head head = {.names = {"mesorig.channels", "mesorig.slices"}};
    const char *what = NULL;
    if (g_strcmp0(texel_model_kind(file), "neural") != 0)
        return format_error(path, error, "mesorig.kind of the first part is not neural");
    if (!texel_model_read_head(path, file, &head, &neural->layout, &what, error))
        return what && format_error(path, error, what);
    neural->name = g_strdup(head.name);
    neural->n_channels = head.numbers[0];
    neural->error = head.error;
    neural->luminance_error = head.luminance_error;
    neural->exact_error = head.exact_error;
    if (neural->n_channels < 4 || neural->n_channels > NEURAL_MAX_CHANNELS ||
        neural->n_channels % 4 != 0)
        return format_error(path, error, "mesorig.channels is not 4, 8, 12 or 16");
    return head.numbers[1] == 1 || format_error(path, error, "mesorig.slices is not 1");
}

static gboolean read_arrays(struct neural *neural, const struct exr_file *file, const char *path,
                            GError **error) {
    const struct btf_layout *layout = &neural->layout;
    const gsize w = layout->width, h = layout->height, channels = (gsize)neural->n_channels;
    neural->surface = g_try_new(guint8, w * h * channels);
    neural->heights = g_try_new(guint8, 4 * w * h);
    if (!neural->surface || !neural->heights) {
        g_set_error(error, EXR_ERROR, EXR_ERROR_TOO_LARGE,
                    "%s: there is no memory for its %zu × %zu texels; open it on a computer with "
                    "more memory",
                    path, w, h);
        return FALSE;
    }
    g_autofree char *what = read_pictures(file, "surface", neural->surface, w, h, channels);
    what = what ? what : read_picture(file, "heights", "Z", neural->heights, 2 * w, 2 * h);
    what = what ? what
                : read_pictures(file, "halves", neural->halves, NEURAL_PLANE, NEURAL_PLANE,
                                NEURAL_PLANE_CHANNELS);
    what = what ? what
                : read_pictures(file, "differences", neural->differences, NEURAL_PLANE,
                                NEURAL_PLANE, NEURAL_PLANE_CHANNELS);
    what = what ? what : read_weights(neural, file);
    what = what ? what : read_scales(neural, file);
    if (!what && (exr_file_part(file, "cameras") || exr_file_part(file, "lamps"))) {
        what = read_positions(file, "cameras", layout->views.n, layout->reference_mm,
                              &neural->camera_mm);
        what = what ? what
                    : read_positions(file, "lamps", layout->lights.n, layout->reference_mm,
                                     &neural->lamp_mm);
    }
    return !what || format_error(path, error, what);
}

static struct neural *from_exr(const struct exr_file *file, int level, const char *path,
                               GError **error) {
    struct neural *neural = g_new0(struct neural, 1);
    neural->level = level;
    if (read_head(neural, file, path, error) && read_arrays(neural, file, path, error))
        neural_prepare(neural);
    else
        g_clear_pointer(&neural, neural_free);
    return neural;
}

struct neural *neural_read(const char *path, GError **error) {
    g_autoptr(ExrFile) file = exr_read(path, error);
    return file ? from_exr(file, 0, path, error) : NULL;
}

int neural_read_levels(const char *path, struct neural *ret_levels[NEURAL_MAX_LEVELS],
                       GError **error) {
    g_autoptr(ExrFile) file = exr_read(path, error);
    const int there = file ? mip_parts_count(file, "views", path, error) : 0;
    const int n = MIN(there, NEURAL_MAX_LEVELS);
    for (int level = 0; level < n; level++) {
        g_autoptr(ExrFile) one = mip_parts_take(file, level);
        ret_levels[level] = from_exr(one, level, path, error);
        if (ret_levels[level])
            continue;
        while (level > 0)
            neural_free(ret_levels[--level]);
        return 0;
    }
    return n;
}
