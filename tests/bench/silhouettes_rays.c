#include "silhouettes_rays.h"

#include "bench.h"
#include "directions/directions.h"
#include "material/material_relief.h"

#include <math.h>

#define DEG (G_PI / 180.0)

struct ways {
    const struct mdf_table *table;
    Directions *views;
    struct material_relief *relief;
};

/* Returns the depth at a texel, interpolated between the measured views. */
static double interpolated(const struct ways *ways, struct vec3 v, gsize texel) {
    const struct mdf_table *t = ways->table;
    const gsize n = (gsize)t->width * t->height;
    struct direction_weights w;
    double depth = 0.0;
    int n_pole;
    const int *pole = directions_pole(ways->views, &n_pole);
    directions_weights(ways->views, v, &w);
    for (int k = 0; k < 4; k++)
        if (w.weight[k] > 0.0F && w.index[k] < t->n_views)
            depth += (double)(w.weight[k] * t->depth_mm[w.index[k] * n + texel]);
        else
            for (int i = 0; w.weight[k] > 0.0F && i < n_pole; i++)
                depth += (double)(w.weight[k] * t->depth_mm[pole[i] * n + texel]) / n_pole;
    return depth;
}

/* Adds the errors of all rays of a view of truth. */
static void add_view(const struct ways *ways, const struct mdf_table *truth, int view,
                     double sums[3]) {
    const struct mdf_shell *shell = material_relief_shell(ways->relief);
    const struct shell_surface flat = {.tile = {shell->width_mm, shell->height_mm}};
    const int width = truth->width, height = truth->height;
    const double theta = (double)truth->theta_deg[view] * DEG;
    const double phi = (double)truth->phi_deg[view] * DEG;
    const struct vec3 v = vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
    for (int k = 0; k < width * height; k++) {
        const double is = (double)truth->depth_mm[(gsize)view * width * height + k];
        const double x = (k % width + 0.5) / width, y = (k / width + 0.5) / height;
        struct shell_hit hit = {0};
        struct vec3 normal;
        shell_ray_march(shell, &flat, x, y, (const double[]){v.x, v.y, v.z}, INFINITY, &hit);
        sums[0] += fabs(interpolated(ways, v, (gsize)k) - is);
        sums[1] += fabs(hit.depth_mm - is);
        sums[2] += fabs(material_relief_depth(ways->relief, x, y, v, &normal) - is);
    }
}

void silhouettes_rays(const char *kind, const struct mdf_table *table, const char *path,
                      const struct mdf_table *truth) {
    g_autoptr(GError) error = NULL;
    struct ways ways = {.table = table, .relief = material_relief_read(path, &error)};
    bench_check(error);
    ways.views = directions_new(table->theta_deg, table->phi_deg, table->n_views, &error);
    bench_check(error);
    for (int first = 0, end; first < truth->n_views; first = end) {
        double sums[3] = {0};
        for (end = first;
             end < truth->n_views && fabsf(truth->theta_deg[end] - truth->theta_deg[first]) < 0.01F;
             end++)
            add_view(&ways, truth, end, sums);
        const double n = (double)(end - first) * truth->width * truth->height;
        bench_row(NULL,
                  "%-8s{material} %4.1f{theta_deg} %.4f{interpolated_mm} %.4f{shell_mm} "
                  "%.4f{library_mm}",
                  kind, (double)truth->theta_deg[first], sums[0] / n, sums[1] / n, sums[2] / n);
    }
    directions_free(ways.views);
    material_relief_free(ways.relief);
}
