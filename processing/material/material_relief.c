#include "material_relief.h"

#include "codecs/mdf_codecs/mdf_source.h"
#include "directions/directions.h"

struct material_relief {
    const struct mdf_table *table;
    Directions *views;
};

struct material_relief *material_relief_read(const char *path, GError **error) {
    struct mdf_source *source = mdf_source_read(path, error);
    if (!source)
        return NULL;
    struct material_relief *relief = g_new0(struct material_relief, 1);
    relief->table =
        source->table ? g_steal_pointer(&source->table) : mdf_factors_table(source->factors);
    mdf_source_free(source);
    relief->views = directions_new(relief->table->theta_deg, relief->table->phi_deg,
                                   relief->table->n_views, error);
    if (relief->views)
        return relief;
    g_prefix_error(error, "%s: views of the MDF: ", path);
    material_relief_free(relief);
    return NULL;
}

void material_relief_free(struct material_relief *relief) {
    if (!relief)
        return;
    mdf_table_free((struct mdf_table *)relief->table);
    directions_free(relief->views);
    g_free(relief);
}

double material_relief_deepest_mm(const struct material_relief *relief) {
    return relief->table->deepest_mm;
}

void material_relief_size_mm(const struct material_relief *relief, double *ret_width,
                             double *ret_height) {
    *ret_width = relief->table->width * relief->table->texel_mm;
    *ret_height = relief->table->height * relief->table->texel_mm;
}

static int wrap(double i, int n) {
    const int rest = (int)fmod(i, n);
    return rest < 0 ? rest + n : rest;
}

/* Interpolates at the fractions (p, q) between four texels with depths a b / c d. Adds share times
 * the depth (1−q)((1−p)a + p b) + q((1−p)c + p d), its ∂/∂p and its ∂/∂q to sum. */
static void add(const float *depth, const gsize at[4], double p, double q, double share,
                double sum[3]) {
    const double a = depth[at[0]], b = depth[at[1]], c = depth[at[2]], d = depth[at[3]];
    sum[0] += share * ((1 - q) * ((1 - p) * a + p * b) + q * ((1 - p) * c + p * d));
    sum[1] += share * ((1 - q) * (b - a) + q * (d - c));
    sum[2] += share * ((1 - p) * (c - a) + p * (d - b));
}

double material_relief_depth(const struct material_relief *relief, double u, double v,
                             const double view[3], double ret_slope[2]) {
    const struct mdf_table *t = relief->table;
    const double x = (u - floor(u)) * t->width - 0.5, y = (v - floor(v)) * t->height - 0.5;
    const int left = wrap(floor(x), t->width), right = (left + 1) % t->width;
    const int top = wrap(floor(y), t->height), below = (top + 1) % t->height;
    const gsize at[4] = {
        (gsize)top * t->width + left,
        (gsize)top * t->width + right,
        (gsize)below * t->width + left,
        (gsize)below * t->width + right,
    };
    const gsize n = (gsize)t->width * t->height;
    struct direction_weights weights;
    double sum[3] = {0};
    int n_pole;
    const int *pole = directions_pole(relief->views, &n_pole);
    directions_weights(relief->views, vec3(view[0], view[1], view[2]), &weights);
    for (int k = 0; k < 4; k++) {
        const gboolean is_pole = weights.index[k] >= t->n_views;
        const int members = is_pole ? n_pole : 1;
        for (int i = 0; weights.weight[k] > 0 && i < members; i++)
            add(t->depth_mm + (gsize)(is_pole ? pole[i] : weights.index[k]) * n, at, x - floor(x),
                y - floor(y), (double)weights.weight[k] / members, sum);
    }
    /* Rows count downwards, y upwards. */
    ret_slope[0] = sum[1] / t->texel_mm;
    ret_slope[1] = -sum[2] / t->texel_mm;
    return MAX(sum[0], 0);
}
