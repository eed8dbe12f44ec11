#include <math.h>
#include <string.h>

#include "exr/exr.h"
#include "lpca_pack_private.h"

#define COLOURS 3

static const char *const colours[] = {"R", "G", "B"};

static struct exr_part *clusters_part(const struct lpca *lpca) {
    static const char *const channels[] = {"K", NULL};
    struct exr_part *part =
        exr_part_new("clusters", lpca->layout.width, lpca->layout.height, channels, EXR_FLOAT);
    for (gsize i = 0; i < btf_layout_texels(&lpca->layout); i++)
        part->planes[0][i] = (float)lpca->clusters[i];
    exr_set_string(part, "mesorig.kind", "lpca");
    exr_set_string(part, "mesorig.name", lpca->name ? lpca->name : "");
    exr_set_string(part, "mesorig.quantise", lpca_quantise_name(lpca->quantise));
    exr_set_double(part, "mesorig.error", lpca->error);
    if (lpca->n_grid > 0)
        exr_set_int(part, "mesorig.grid", lpca->n_grid);
    if (lpca->colours == LPCA_LOG)
        exr_set_string(part, "mesorig.colours", "log");
    if (lpca->quantise == LPCA_PACKED)
        exr_set_double(part, "mesorig.step", lpca->packed->step);
    btf_layout_write_sizes(&lpca->layout, part);
    return part;
}

static float weight_scale(const struct lpca *lpca, int texel, int component) {
    return lpca->weight_scales[lpca->clusters[texel] * lpca->n_components + component];
}

/* Returns the number that the file has for a weight w: whole steps w / s if weights have 8 bits,
 * otherwise w. */
static float stored_weight(const struct lpca *lpca, int texel, int component) {
    const float weight = lpca->weights[(gsize)texel * (gsize)lpca->n_components + (gsize)component];
    return lpca->quantise == LPCA_8BIT_WEIGHTS
               ? roundf(weight / weight_scale(lpca, texel, component))
               : weight;
}

static struct exr_part *weights_part(const struct lpca *lpca) {
    const int c = lpca->n_components;
    g_auto(GStrv) channels = g_new0(char *, c + 1);
    for (int i = 0; i < c; i++)
        channels[i] = g_strdup_printf("W%02d", i + 1);
    struct exr_part *part = exr_part_new("weights", lpca->layout.width, lpca->layout.height,
                                         (const char *const *)channels,
                                         lpca->quantise == LPCA_FLOAT ? EXR_FLOAT : EXR_HALF);
    for (gsize texel = 0; texel < btf_layout_texels(&lpca->layout); texel++)
        for (int i = 0; i < c; i++)
            part->planes[i][texel] = stored_weight(lpca, texel, i);
    return part;
}

/* Makes a part with n scales of each cluster: cluster k in column k. */
static struct exr_part *scales_part(const char *name, const struct lpca *lpca, const float *scales,
                                    int n) {
    static const char *const channels[] = {"S", NULL};
    struct exr_part *part = exr_part_new(name, lpca->n_clusters, n, channels, EXR_FLOAT);
    for (int i = 0; i < lpca->n_clusters * n; i++)
        part->planes[0][i % n * lpca->n_clusters + i / n] = scales[i];
    return part;
}

static struct exr_part *light_scales_part(const struct lpca *lpca) {
    static const char *const channels[] = {"S", NULL};
    const int tables = lpca->n_clusters * (lpca->n_components + 1);
    struct exr_part *part =
        exr_part_new("light_scales", lpca->layout.lights.n, tables, channels, EXR_HALF);
    memcpy(part->planes[0], lpca->light_scales,
           sizeof(float) * lpca->layout.lights.n * (gsize)tables);
    return part;
}

static char *table_name(int component) {
    return component == 0 ? g_strdup("means") : g_strdup_printf("E%02d", component);
}

static gsize table_size(const struct lpca *lpca) {
    return lpca->layout.views.n * lpca->layout.lights.n;
}

/* Returns the quantisation step of value i of a table of eigen-BRDFs. */
static float step_of(const struct lpca *lpca, gsize table, gsize i) {
    const gsize n = lpca->layout.lights.n;
    return lpca->scales[table] * (lpca->light_scales ? lpca->light_scales[table * n + i % n] : 1);
}

/* Makes a part with E_i of all clusters (i = 0: the means). With 8 bits, the values for i ≥ 1 are
 * whole steps, E_i / (S_i S_i,l). */
static struct exr_part *table_part(const struct lpca *lpca, int component) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    const gsize tables = (gsize)lpca->n_components + 1;
    const gsize size = table_size(lpca);
    g_autofree char *name = table_name(component);
    struct exr_part *part =
        exr_part_new(name, lpca->layout.lights.n, lpca->n_clusters * lpca->layout.views.n, channels,
                     lpca->quantise == LPCA_FLOAT ? EXR_FLOAT : EXR_HALF);
    for (int k = 0; k < lpca->n_clusters; k++) {
        const gsize table = (gsize)k * tables + (gsize)component;
        const float *rgb = lpca->brdfs + table * size * COLOURS;
        for (gsize i = 0; i < size * COLOURS; i++)
            part->planes[COLOURS - 1 - i % COLOURS][(gsize)k * size + i / COLOURS] =
                lpca->quantise >= LPCA_8BIT && component > 0
                    ? roundf(rgb[i] / step_of(lpca, table, i / COLOURS))
                    : rgb[i];
    }
    return part;
}

struct exr_file *lpca_to_exr(const struct lpca *lpca) {
    struct exr_file *file = exr_file_new();
    const gboolean packed = lpca->quantise == LPCA_PACKED;
    exr_file_add(file, clusters_part(lpca));
    if (packed)
        lpca_packed_add_parts(file, lpca);
    else
        exr_file_add(file, weights_part(lpca));
    exr_file_add(file, scales_part("scales", lpca, packed ? lpca->packed->scales : lpca->scales,
                                   lpca->n_components + 1));
    if (lpca->quantise == LPCA_8BIT_WEIGHTS)
        exr_file_add(file,
                     scales_part("weight_scales", lpca, lpca->weight_scales, lpca->n_components));
    if (lpca->light_scales)
        exr_file_add(file, light_scales_part(lpca));
    for (int i = 0; !packed && i <= lpca->n_components; i++)
        exr_file_add(file, table_part(lpca, i));
    btf_layout_write_directions(&lpca->layout, file);
    return file;
}

gboolean lpca_write(const char *path, const struct lpca *lpca, GError **error) {
    struct exr_file *file = lpca_to_exr(lpca);
    /* Both methods are lossless. ZIP gives the smaller file for integers of 8 bits. */
    gboolean ok =
        exr_write(path, file, lpca->quantise >= LPCA_8BIT ? EXR_ZIP : EXR_PIZ, TRUE, error);
    exr_file_free(file);
    return ok;
}

static gboolean format_error(const char *path, GError **error, const char *what) {
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: this is not a valid file of a local PCA: %s; compress the BTF again", path,
                what);
    return FALSE;
}

static gboolean memory_error(const struct lpca *lpca, const char *path, GError **error) {
    g_set_error(
        error, EXR_ERROR, EXR_ERROR_TOO_LARGE,
        "%s: there is no memory for %d clusters of %d components; open it on a computer with "
        "more memory",
        path, lpca->n_clusters, lpca->n_components);
    return FALSE;
}

/* Returns the values of a channel of a part. Returns NULL with an error if the part does not exist,
 * has another size or lacks the channel, or if a value is not finite. */
static const float *plane(const struct exr_file *file, const char *name, const char *channel,
                          gint64 width, gint64 height, const char *path, GError **error) {
    const struct exr_part *part = exr_file_part(file, name);
    const float *values = part ? exr_part_plane(part, channel) : NULL;
    g_autofree char *what = NULL;
    if (!part)
        what = g_strdup_printf("the part “%s” is missing", name);
    else if (!values)
        what = g_strdup_printf("the part “%s” lacks channel %s", name, channel);
    else if (part->width != width || part->height != height)
        what = g_strdup_printf("the part “%s” is %d × %d, but must be %" G_GINT64_FORMAT
                               " × %" G_GINT64_FORMAT,
                               name, part->width, part->height, width, height);
    else if (!exr_all_finite(values, (gsize)width * (gsize)height))
        what = g_strdup_printf("channel %s of the part “%s” has a value that is not finite",
                               channel, name);
    if (what)
        format_error(path, error, what);
    return what ? NULL : values;
}

static gboolean read_colours(struct lpca *lpca, const struct exr_part *part) {
    const char *name = "rgb";
    exr_get_string(part, "mesorig.colours", &name, NULL);
    lpca->colours = strcmp(name, "log") == 0 ? LPCA_LOG : LPCA_RGB;
    return lpca->colours == LPCA_LOG || strcmp(name, "rgb") == 0;
}

static gboolean read_head(struct lpca *lpca, const struct exr_file *file, const char *path,
                          GError **error) {
    const struct exr_part *part = exr_file_part(file, "clusters");
    const char *kind = NULL, *name = NULL, *quantise = NULL;
    if (!part)
        return format_error(path, error, "the part “clusters” is missing");
    if (!exr_get_string(part, "mesorig.kind", &kind, NULL) || strcmp(kind, "lpca") != 0)
        return format_error(path, error, "mesorig.kind of the part “clusters” is not lpca");
    if (!exr_get_string(part, "mesorig.name", &name, error) ||
        !exr_get_string(part, "mesorig.quantise", &quantise, error) ||
        !exr_get_double(part, "mesorig.error", &lpca->error, error)) {
        g_prefix_error(error, "%s: ", path);
        return FALSE;
    }
    lpca->name = g_strdup(name);
    lpca->layout.width = (gsize)part->width;
    lpca->layout.height = (gsize)part->height;
    if (!lpca_quantise_parse(quantise, &lpca->quantise))
        return format_error(path, error,
                            "mesorig.quantise is not float, half, 8bit, 8bit-weights or packed");
    if (!read_colours(lpca, part))
        return format_error(path, error, "mesorig.colours is not rgb or log");
    const char *what = btf_layout_read(file, part, &lpca->layout);
    if (what)
        return format_error(path, error, what);
    if (exr_get_int(part, "mesorig.grid", &lpca->n_grid, NULL) &&
        (lpca->n_grid < 2 || lpca->n_grid > 1024 ||
         lpca->layout.views.n != (gsize)lpca->n_grid * (gsize)lpca->n_grid ||
         lpca->layout.lights.n != lpca->layout.views.n))
        return format_error(path, error,
                            "mesorig.grid is not the n of n × n views and n × n lights");
    part = exr_file_part(file, "scales");
    const int most = lpca->quantise == LPCA_PACKED ? LPCA_MAX_PACKED : LPCA_MAX_COMPONENTS;
    if (!part || part->width > LPCA_MAX_CLUSTERS || part->height < 2 || part->height > most + 1)
        return format_error(path, error,
                            "the part “scales” is missing, or is too large for the clusters or "
                            "components of a local PCA");
    lpca->n_clusters = part->width;
    lpca->n_components = part->height - 1;
    return TRUE;
}

/* Reads the scales that scales_part() wrote. Returns NULL with an error if the part is missing or
 * damaged. g_free() */
static float *read_scales(const struct exr_file *file, const char *name, int clusters, int n,
                          const char *path, GError **error) {
    const float *scales = plane(file, name, "S", clusters, n, path, error);
    float *ret = scales ? g_new0(float, (gsize)clusters *(gsize)n) : NULL;
    for (int i = 0; ret && i < clusters * n; i++)
        ret[i] = scales[i % n * clusters + i / n];
    return ret;
}

static gboolean read_weight_scales(struct lpca *lpca, const struct exr_file *file, const char *path,
                                   GError **error) {
    const int c = lpca->n_components;
    lpca->weight_scales = lpca->quantise == LPCA_8BIT_WEIGHTS
                              ? read_scales(file, "weight_scales", lpca->n_clusters, c, path, error)
                              : lpca_ones((gsize)lpca->n_clusters * (gsize)c);
    return lpca->weight_scales != NULL;
}

/* Reads the scales of lights. If the file has none, light_scales stays NULL, which means that all
 * are 1. Returns FALSE with an error if the part is damaged. */
static gboolean read_light_scales(struct lpca *lpca, const struct exr_file *file, const char *path,
                                  GError **error) {
    if (!exr_file_part(file, "light_scales"))
        return TRUE;
    const int tables = lpca->n_clusters * (lpca->n_components + 1);
    const gsize n = (gsize)tables * lpca->layout.lights.n;
    const float *scales =
        plane(file, "light_scales", "S", (gint64)lpca->layout.lights.n, tables, path, error);
    for (gsize i = 0; scales && i < n; i++)
        if (!(scales[i] > 0))
            return format_error(path, error,
                                "the part “light_scales” has a value that is not above 0");
    if (scales)
        lpca->light_scales = g_memdup2(scales, sizeof(float) * n);
    return scales != NULL;
}

static gboolean read_clusters(struct lpca *lpca, const struct exr_file *file, const char *path,
                              GError **error) {
    const int n = btf_layout_texels(&lpca->layout);
    const float *clusters = plane(file, "clusters", "K", (gint64)lpca->layout.width,
                                  (gint64)lpca->layout.height, path, error);
    if (!clusters)
        return FALSE;
    lpca->clusters = g_new(int, n);
    for (int i = 0; i < n; i++) {
        if (!(clusters[i] >= 0) || clusters[i] >= (float)lpca->n_clusters ||
            clusters[i] != floorf(clusters[i]))
            return format_error(path, error,
                                "the cluster of a texel is not a whole number from 0 to the number "
                                "of clusters − 1");
        lpca->clusters[i] = (int)clusters[i];
    }
    return TRUE;
}

static gboolean read_texels(struct lpca *lpca, const struct exr_file *file, const char *path,
                            GError **error) {
    const int c = lpca->n_components, n = btf_layout_texels(&lpca->layout);
    if (!read_weight_scales(lpca, file, path, error))
        return FALSE;
    lpca->weights = g_try_new(float, (gsize)n *(gsize)c);
    if (!lpca->weights)
        return memory_error(lpca, path, error);
    for (int i = 0; i < c; i++) {
        g_autofree char *channel = g_strdup_printf("W%02d", i + 1);
        const float *weights = plane(file, "weights", channel, (gint64)lpca->layout.width,
                                     (gint64)lpca->layout.height, path, error);
        if (!weights)
            return FALSE;
        for (int texel = 0; texel < n; texel++)
            lpca->weights[(gsize)texel * (gsize)c + (gsize)i] =
                weights[texel] * weight_scale(lpca, texel, i);
    }
    return TRUE;
}

/* Reads the values that table_part() wrote. Returns FALSE with an error if the part is missing or
 * damaged. */
static gboolean read_table(struct lpca *lpca, const struct exr_file *file, int component,
                           const char *path, GError **error) {
    const gsize tables = (gsize)lpca->n_components + 1;
    const gsize size = table_size(lpca);
    g_autofree char *name = table_name(component);
    const gint64 height = (gint64)lpca->n_clusters * lpca->layout.views.n;
    for (int c = 0; c < COLOURS; c++) {
        const float *values =
            plane(file, name, colours[c], (gint64)lpca->layout.lights.n, height, path, error);
        if (!values)
            return FALSE;
        for (int k = 0; k < lpca->n_clusters; k++) {
            const gsize table = (gsize)k * tables + (gsize)component;
            for (gsize i = 0; i < size; i++)
                lpca->brdfs[(table * size + i) * COLOURS + (gsize)c] =
                    values[(gsize)k * size + i] *
                    (component > 0 ? step_of(lpca, table, i) : lpca->scales[table]);
        }
    }
    return TRUE;
}

static gboolean read_tables(struct lpca *lpca, const struct exr_file *file, const char *path,
                            GError **error) {
    const int tables = lpca->n_components + 1, n = lpca->n_clusters * tables;
    lpca->scales = read_scales(file, "scales", lpca->n_clusters, tables, path, error);
    const struct exr_part *means = exr_file_part(file, "means");
    /* The sizes come from small parts of the file, and may be much too large in a damaged file. The
     * size of the means is therefore checked before memory is allocated. */
    if (!lpca->scales)
        return FALSE;
    if (!means || (gsize)means->width != lpca->layout.lights.n ||
        (gsize)means->height != (gsize)lpca->n_clusters * lpca->layout.views.n)
        return format_error(path, error,
                            "the part “means” is missing, or its size does not fit the clusters, "
                            "views and lights");
    if (!read_light_scales(lpca, file, path, error))
        return FALSE;
    lpca->brdfs = g_try_new(float, (gsize)n *table_size(lpca) * COLOURS);
    if (!lpca->brdfs)
        return memory_error(lpca, path, error);
    for (int i = 0; i < tables; i++)
        if (!read_table(lpca, file, i, path, error))
            return FALSE;
    return TRUE;
}

static gboolean read_packed(struct lpca *lpca, const struct exr_file *file, const char *path,
                            GError **error) {
    const int tables = lpca->n_components + 1;
    const gsize n = (gsize)lpca->n_clusters * (gsize)tables;
    struct lpca_packed *packed = lpca->packed = lpca_packed_new();
    if (lpca->n_clusters != 1)
        return format_error(path, error,
                            "it is packed, but has several clusters: a packed file has one");
    if (lpca->colours != LPCA_RGB || lpca->n_grid > 0)
        return format_error(path, error,
                            "it is packed, but has mesorig.colours or mesorig.grid, which a packed "
                            "file cannot have");
    if (!exr_get_double(exr_file_part(file, "clusters"), "mesorig.step", &packed->step, NULL) ||
        !(packed->step > 0) || !isfinite(packed->step))
        return format_error(path, error, "mesorig.step is missing or not a number above 0");
    packed->scales = read_scales(file, "scales", lpca->n_clusters, tables, path, error);
    for (gsize i = 0; packed->scales && i < n; i++)
        if (!(packed->scales[i] > 0))
            return format_error(path, error, "the part “scales” has a value that is not above 0");
    if (!packed->scales)
        return FALSE;
    if (!lpca_packed_read_parts(lpca, file))
        return format_error(path, error,
                            "a packed part (view_axes, light_axes, colour_axes, tables or maps) is "
                            "missing or damaged");
    lpca->scales = lpca_ones(n);
    lpca->weight_scales = lpca_ones((gsize)lpca->n_clusters * (gsize)lpca->n_components);
    lpca->weights = g_try_new(float, btf_layout_texels(&lpca->layout) * (gsize)lpca->n_components);
    lpca->brdfs = g_try_new(float, n *table_size(lpca) * COLOURS);
    if (!lpca->weights || !lpca->brdfs)
        return memory_error(lpca, path, error);
    lpca_unpack(lpca, 0);
    return TRUE;
}

struct lpca *lpca_from_exr(const struct exr_file *file, const char *path, GError **error) {
    struct lpca *lpca = g_new0(struct lpca, 1);
    if (!read_head(lpca, file, path, error) || !read_clusters(lpca, file, path, error) ||
        !(lpca->quantise == LPCA_PACKED
              ? read_packed(lpca, file, path, error)
              : read_texels(lpca, file, path, error) && read_tables(lpca, file, path, error)))
        g_clear_pointer(&lpca, lpca_free);
    return lpca;
}

struct lpca *lpca_read(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    struct lpca *lpca = file ? lpca_from_exr(file, path, error) : NULL;
    exr_file_free(file);
    return lpca;
}
