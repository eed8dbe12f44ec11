#include <math.h>
#include <string.h>

#include "exr/exr.h"
#include "mdf_factors.h"

#define MAX_MAP 255
#define MAX_MM  6e4

/* Returns "M01", "M02", …. Two digits keep the channels of a part in alphabetical order. */
static char *channel_name(int term) {
    return g_strdup_printf("M%02d", term + 1);
}

/* The weights are n_views × (c + 1) in memory, but c + 1 lines of n_views pixels in the file. */
gboolean mdf_factors_write(const char *path, const struct mdf_factors *factors, GError **error) {
    static const char *const weight[] = {"W", NULL};
    static const char *const angles[] = {"phi_deg", "theta_deg", NULL};
    const int n = factors->n_views, c = factors->n_terms, m = c + 1;
    const gsize texels = (gsize)factors->width * (gsize)factors->height;
    g_auto(GStrv) channels = g_new0(char *, m);
    for (int i = 0; i < c; i++)
        channels[i] = channel_name(i);
    struct exr_file *file = exr_file_new();
    struct exr_part *maps = exr_part_new("maps", factors->width, factors->height,
                                         (const char *const *)channels, EXR_HALF);
    struct exr_part *weights = exr_part_new("weights", n, m, weight, EXR_FLOAT);
    struct exr_part *views = exr_part_new("views", n, 1, angles, EXR_FLOAT);
    for (gsize i = 0; i < (gsize)c * texels; i++)
        maps->planes[i / texels][i % texels] = factors->maps[i];
    exr_set_string(maps, "mesorig.kind", MDF_FACTORS_KIND);
    exr_set_int(maps, "mesorig.measured", factors->n_measured);
    exr_set_double(maps, "mesorig.error_mm", factors->error_mm);
    exr_set_double(maps, "texel_mm", factors->texel_mm);
    exr_set_double(maps, "deepest_mm", factors->deepest_mm);
    for (int i = 0; i < n * m; i++)
        weights->planes[0][i % m * n + i / m] = factors->weights[i];
    memcpy(views->planes[0], factors->phi_deg, sizeof(float) * (gsize)n);
    memcpy(views->planes[1], factors->theta_deg, sizeof(float) * (gsize)n);
    exr_file_add(file, maps);
    exr_file_add(file, weights);
    exr_file_add(file, views);
    const gboolean ok = exr_write(path, file, EXR_ZIP, TRUE, error);
    exr_file_free(file);
    return ok;
}

/* Reads sizes and attributes. Returns a text that says what is wrong with them, or NULL if they are
 * valid. */
static const char *read_head(struct mdf_factors *factors, const struct exr_file *file) {
    const struct exr_part *maps = exr_file_part(file, "maps"),
                          *views = exr_file_part(file, "views");
    const struct exr_part *weights = exr_file_part(file, "weights");
    const char *kind = NULL;
    if (!maps)
        return "the part “maps” is missing";
    if (!exr_get_string(maps, "mesorig.kind", &kind, NULL) || strcmp(kind, MDF_FACTORS_KIND) != 0)
        return "mesorig.kind of the part “maps” is not " MDF_FACTORS_KIND;
    if (!views || !weights)
        return "the part “weights” or the part “views” is missing";
    factors->width = maps->width;
    factors->height = maps->height;
    factors->n_terms = maps->n_channels;
    factors->n_views = views->width;
    if (factors->n_terms > MDF_FACTORS_MAX_TERMS || factors->n_views > MDF_FACTORS_MAX_VIEWS ||
        (gint64)maps->width * maps->height > MDF_TABLE_MAX_TEXELS)
        return "it has more maps, views or texels than are allowed";
    if (views->height != 1 || weights->width != views->width ||
        weights->height != factors->n_terms + 1)
        return "the size of the part “weights” does not fit the numbers of maps and views";
    if (!exr_get_int(maps, "mesorig.measured", &factors->n_measured, NULL) ||
        factors->n_measured < 1 || factors->n_measured > factors->n_views)
        return "mesorig.measured is not a number from 1 to the number of views";
    if (!exr_get_double(maps, "texel_mm", &factors->texel_mm, NULL) ||
        !(factors->texel_mm > 0 && factors->texel_mm < MAX_MM) ||
        !exr_get_double(maps, "deepest_mm", &factors->deepest_mm, NULL) ||
        !(factors->deepest_mm >= 0 && factors->deepest_mm < MAX_MM) ||
        !exr_get_double(maps, "mesorig.error_mm", &factors->error_mm, NULL) ||
        !(factors->error_mm >= 0))
        return "texel_mm, deepest_mm or mesorig.error_mm is missing or out of range";
    return NULL;
}

/* Reads directions, weights and maps. Returns NULL or a text, as read_head() does. */
static const char *read_values(struct mdf_factors *factors, const struct exr_file *file) {
    const gsize texels = (gsize)factors->width * (gsize)factors->height;
    const float *theta = exr_part_plane(exr_file_part(file, "views"), "theta_deg");
    const float *phi = exr_part_plane(exr_file_part(file, "views"), "phi_deg");
    const float *weights = exr_part_plane(exr_file_part(file, "weights"), "W");
    const int n = factors->n_views, m = factors->n_terms + 1;
    if (!theta || !phi || !weights)
        return "the part “weights” lacks the channel W, or the part “views” lacks theta_deg or "
               "phi_deg";
    for (int i = 0; i < n; i++)
        if (!(theta[i] >= 0 && theta[i] <= 90) || !(fabsf(phi[i]) <= 720))
            return "the direction of a view is out of range";
    for (int i = 0; i < n * m; i++)
        if (!(fabsf(weights[i]) <= MAX_MM))
            return "a weight is not a number from −60000 to 60000 mm";
    factors->theta_deg = g_memdup2(theta, sizeof(float) * (gsize)n);
    factors->phi_deg = g_memdup2(phi, sizeof(float) * (gsize)n);
    factors->weights = g_new(float, (gsize)n *(gsize)m);
    for (int i = 0; i < n * m; i++)
        factors->weights[i] = weights[i % m * n + i / m];
    factors->maps = g_new(guint8, texels * (gsize)factors->n_terms);
    for (int i = 0; i < factors->n_terms; i++) {
        g_autofree char *name = channel_name(i);
        const float *from = exr_part_plane(exr_file_part(file, "maps"), name);
        if (!from)
            return "a channel of the part “maps” has another name than M01, M02, …";
        for (gsize x = 0; x < texels; x++) {
            if (!(from[x] >= 0 && from[x] <= MAX_MAP) || from[x] != floorf(from[x]))
                return "a map has a value that is not a whole number from 0 to 255";
            factors->maps[(gsize)i * texels + x] = (guint8)from[x];
        }
    }
    return NULL;
}

struct mdf_factors *mdf_factors_read(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    if (!file)
        return NULL;
    g_autoptr(MdfFactors) factors = g_new0(struct mdf_factors, 1);
    const char *what = read_head(factors, file);
    if (!what)
        what = read_values(factors, file);
    exr_file_free(file);
    if (!what)
        return g_steal_pointer(&factors);
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: this is not a valid file of a compressed MDF: %s; compress the MDF again",
                path, what);
    return NULL;
}
