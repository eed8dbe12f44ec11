#include "material_relief.h"

#include "codecs/mdf_codecs/mdf_source.h"
#include "directions/directions.h"

#include <math.h>

#define MEASURED 0.99 /* a direction counts as measured if a view has at least this weight */
/* The shell confirms an interpolated depth if the depth of the shell differs from it by at most
 * this number of texels. */
#define AGREEMENT 0.25
/* where z of a view is a divisor, it is at least this, as in shell_ray.c */
#define MIN_SLOPE  0.01
#define MIN_FACING 0.02 /* smallest cosine between the normal and the view */

struct material_relief {
    const struct mdf_table *table;
    Directions *views;
    /* the pointer to a struct mdf_shell, which is made at its first use; 0 before that */
    gsize shell;
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
    mdf_shell_free((struct mdf_shell *)relief->shell);
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

const struct mdf_shell *material_relief_shell(const struct material_relief *relief) {
    gsize *shell = (gsize *)&relief->shell;
    if (g_once_init_enter(shell))
        g_once_init_leave(shell, (gsize)mdf_shell_new(relief->table));
    return (const struct mdf_shell *)*shell;
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

/* Returns the depth that the MDF gives, interpolated between texels and between views. ret_slope
 * receives the slopes ∂depth/∂x and ∂depth/∂y (y upwards) in the plane where the ray enters.
 * *ret_share receives the largest of the weights of the views. */
static double interpolated_depth(const struct material_relief *relief, double u, double v,
                                 struct vec3 view, double ret_slope[2], double *ret_share) {
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
    directions_weights(relief->views, view, &weights);
    *ret_share = 0.0;
    for (int k = 0; k < 4; k++) {
        const gboolean is_pole = weights.index[k] >= t->n_views;
        const int members = is_pole ? n_pole : 1;
        *ret_share = fmax(*ret_share, (double)weights.weight[k] / members);
        for (int i = 0; weights.weight[k] > 0 && i < members; i++)
            add(t->depth_mm + (gsize)(is_pole ? pole[i] : weights.index[k]) * n, at, x - floor(x),
                y - floor(y), (double)weights.weight[k] / members, sum);
    }
    /* Rows count downwards, y upwards. */
    ret_slope[0] = sum[1] / t->texel_mm;
    ret_slope[1] = -sum[2] / t->texel_mm;
    return MAX(sum[0], 0);
}

/* Returns the unit normal of the surface for a view v. D (x, y) is the depth of the ray below the
 * reference plane, and slope has its derivatives D_x and D_y.
 *
 * The distance along the ray is D / v_z, and the surface is P (x, y) = (x, y, 0) − v D / v_z. The
 * normal is along ∂P/∂x × ∂P/∂y = (D_x, D_y, 1 − (v_x D_x + v_y D_y) / v_z). This vector faces the
 * eye, because its product with v is v_z. */
static struct vec3 normal_of_slopes(const double slope[2], struct vec3 v) {
    const double down = fmax(v.z, MIN_SLOPE);
    return vec3_unit(vec3(slope[0], slope[1], 1.0 - (v.x * slope[0] + v.y * slope[1]) / down));
}

/* Returns the unit normal of the shell's surface, which is opposite to the gradient of g
 * (mdf_shell.h). The normal is turned towards v where its cosine to v would be below MIN_FACING.
 * Returns v if there is no gradient. */
static struct vec3 normal_of_shell(const struct mdf_shell *shell, const struct shell_hit *hit,
                                   struct vec3 v) {
    double gradient[3];
    shell_ray_value(shell, hit->u, hit->v, hit->depth_mm, gradient);
    struct vec3 n = vec3(-gradient[0], -gradient[1], -gradient[2]);
    const double length = vec3_length(n);
    if (!(length > 0.0))
        return v;
    n = vec3_scale(n, 1.0 / length);
    const double missing = MIN_FACING - vec3_dot(n, v);
    return missing > 0.0 ? vec3_unit(vec3_add(n, vec3_scale(v, missing))) : n;
}

/* Between measured directions, the interpolated depth is more exact than the shell where the
 * structure is smooth. At edges and under overhangs, the interpolated depth is a mean of two
 * surfaces, whereas the shell gives one of the two. The depth and the normal of the shell are
 * therefore returned where its depth differs from the interpolated depth by more than AGREEMENT. In
 * a measured direction, the MDF is used without this test. */
double material_relief_depth(const struct material_relief *relief, double u, double v,
                             struct vec3 view, struct vec3 *ret_normal) {
    const struct mdf_shell *shell = material_relief_shell(relief);
    const struct shell_surface flat = {.tile = {shell->width_mm, shell->height_mm}};
    struct shell_hit hit;
    double slope[2], share;
    const double depth = interpolated_depth(relief, u, v, view, slope, &share);
    if (share < MEASURED &&
        shell_ray_march(shell, &flat, u, v, (const double[]){view.x, view.y, view.z}, INFINITY,
                        &hit) &&
        fabs(hit.depth_mm - depth) > AGREEMENT * relief->table->texel_mm) {
        *ret_normal = normal_of_shell(shell, &hit, view);
        return hit.depth_mm;
    }
    *ret_normal = normal_of_slopes(slope, view);
    return depth;
}
