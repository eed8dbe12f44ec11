#include "webgl_pack.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/direction.h"
#include "codecs/lpca/lpca_volumes.h"
#include "directions/directions.h"
#include "exr/exr_half.h"
#include "webgl_neural.h"

/* Numbers over all mip levels: the sum of the clusters, the maximum number of components, and the
 * sum of the texels. */
struct totals {
    int clusters, components;
    gsize texels;
};

static struct totals webgl_pack_totals(const struct webgl_pack *pack) {
    struct totals all = {0};
    for (int k = 0; k < pack->n_levels; k++) {
        all.clusters += pack->levels[k]->n_clusters;
        all.components = MAX(all.components, pack->levels[k]->n_components);
        all.texels += btf_layout_texels(&pack->levels[k]->layout);
    }
    all.components = MAX(1, all.components);
    return all;
}

static gsize webgl_pack_block(int n) {
    const gsize samples = (gsize)n * (gsize)n;
    return 3 * samples * (samples + 1);
}

static gsize shell_bytes(const struct mdf_shell *s) {
    return (gsize)s->width * (gsize)s->height * (gsize)s->depth;
}

/* Returns the triangulation of the views of an MDF, or NULL if there are no triangles. */
static Directions *triangulate(const struct mdf_table *views) {
    int n = 0;
    g_autoptr(Directions) found =
        views ? directions_new_triangulated(views->theta_deg, views->phi_deg, views->n_views, NULL)
              : NULL;
    if (found)
        directions_triangles(found, &n);
    return n > 0 ? g_steal_pointer(&found) : NULL;
}

static gsize views_bytes(const struct mdf_table *t, const Directions *triangulated) {
    int n_triangles;
    directions_triangles(triangulated, &n_triangles);
    return (gsize)t->n_views * ((gsize)t->width * (gsize)t->height + 3 * sizeof(float)) +
           3 * sizeof(guint16) * (gsize)n_triangles;
}

static gsize levels_bytes(const struct webgl_pack *pack, int n_grid) {
    const struct totals all = webgl_pack_totals(pack);
    const int n = pack->levels[0]->n_grid > 0 ? pack->levels[0]->n_grid : n_grid;
    return all.texels * 2 * (1 + (gsize)all.components) +
           (gsize)all.clusters * (2 + (gsize)all.components) * webgl_pack_block(n);
}

gint64 webgl_pack_bytes(const struct webgl_pack *pack, int n_grid) {
    gsize bytes =
        pack->neural ? (gsize)webgl_neural_bytes(pack->neural) : levels_bytes(pack, n_grid);
    if (pack->shell)
        bytes += shell_bytes(pack->shell);
    g_autoptr(Directions) triangulated = triangulate(pack->views);
    if (triangulated)
        bytes += views_bytes(pack->views, triangulated);
    return (gint64)bytes;
}

/* Adds the sections "clusters" (indices counted through all levels) and "weights". */
static gboolean webgl_pack_texels(WebglFile *file, const struct webgl_pack *pack,
                                  const struct totals *all, GError **error) {
    const gsize components = (gsize)all->components;
    g_autofree guint16 *clusters = g_new(guint16, all->texels);
    g_autofree guint16 *weights = g_new0(guint16, all->texels * components);
    g_autofree float *row = g_new0(float, components);
    gsize at = 0;
    int first = 0;
    for (int level = 0; level < pack->n_levels; level++) {
        const struct lpca *lpca = pack->levels[level];
        const gsize own = (gsize)lpca->n_components;
        for (gsize k = 0; k < btf_layout_texels(&lpca->layout); k++, at++) {
            if (lpca->clusters[k] < 0 || lpca->clusters[k] >= lpca->n_clusters)
                return data_error_fail(pack->name, 0, error,
                                       "texel %zu of mip level %d has cluster %d, but the clusters "
                                       "are 0 to %d; compress the material again",
                                       k, level, lpca->clusters[k], lpca->n_clusters - 1);
            clusters[at] = GUINT16_TO_LE((guint16)(first + lpca->clusters[k]));
            for (gsize i = 0; i < own; i++) {
                if (!isfinite(lpca->weights[own * k + i]))
                    return data_error_fail(pack->name, 0, error,
                                           "weight %zu of texel %zu of mip level %d is not a "
                                           "finite number; compress the material again",
                                           i, k, level);
                row[i] = CLAMP(lpca->weights[own * k + i], -EXR_HALF_LARGEST, EXR_HALF_LARGEST);
            }
            exr_half_from_floats(weights + components * at, row, own);
        }
        first += lpca->n_clusters;
    }
    return webgl_file_add(file, "clusters", clusters, sizeof *clusters * all->texels, error) &&
           webgl_file_add(file, "weights", weights, sizeof *weights * all->texels * components,
                          error);
}

/* The arrays that receive the tables of all levels. */
struct volumes {
    int n;
    gsize components, block;
    guint16 *means;
    gint8 *brdfs;
    /* scales: clusters × components
     * values: buffer for one block */
    float *scales, *values;
};

/* Converts the tables of one cluster of a level, and stores them as cluster `at` of all levels. */
static gboolean webgl_pack_cluster(struct volumes *to, const struct lpca *grid, int cluster,
                                   gsize at, const char *name, GError **error) {
    const gsize samples = (gsize)to->n * (gsize)to->n, size = 3 * samples * samples;
    const gsize own = (gsize)grid->n_components;
    for (gsize i = 0; i <= own; i++) {
        lpca_volumes_block(to->n, grid->brdfs + size * ((gsize)cluster * (own + 1) + i),
                           to->values);
        for (gsize k = 0; k < to->block; k++) {
            if (!isfinite(to->values[k]))
                return data_error_fail(name, 0, error,
                                       "an eigen-BRDF of cluster %d has a value that is not "
                                       "finite; compress the material again",
                                       cluster);
            to->values[k] = CLAMP(to->values[k], -EXR_HALF_LARGEST, EXR_HALF_LARGEST);
        }
        if (i == 0)
            exr_half_from_floats(to->means + to->block * at, to->values, to->block);
        else
            to->scales[to->components * at + i - 1] = lpca_volumes_quantise(
                to->values, to->block, to->brdfs + to->block * (to->components * at + i - 1));
    }
    return TRUE;
}

static gboolean webgl_pack_levels(struct volumes *to, const struct webgl_pack *pack, int clusters,
                                  const struct work *work, GError **error) {
    const gint64 begun_us = g_get_monotonic_time();
    gsize at = 0;
    for (int level = 0; level < pack->n_levels; level++) {
        g_autoptr(Lpca) grid = lpca_volumes_on_grid(pack->levels[level], to->n, error);
        if (!grid)
            return FALSE;
        for (int k = 0; k < grid->n_clusters; k++, at++)
            if (!work_tell(work, "pack", (int)at, clusters, begun_us, error) ||
                !webgl_pack_cluster(to, grid, k, at, pack->name, error))
                return FALSE;
    }
    return TRUE;
}

static gboolean webgl_pack_volumes(WebglFile *file, const struct webgl_pack *pack,
                                   const struct totals *all, int n, const struct work *work,
                                   GError **error) {
    const gsize clusters = (gsize)all->clusters, components = (gsize)all->components;
    const gsize block = webgl_pack_block(n);
    g_autofree guint16 *means = g_new(guint16, clusters * block);
    g_autofree gint8 *brdfs = g_new0(gint8, clusters * components * block);
    g_autofree float *scales = g_new0(float, clusters *components);
    g_autofree float *values = g_new(float, block);
    struct volumes to = {n, components, block, means, brdfs, scales, values};
    return webgl_pack_levels(&to, pack, all->clusters, work, error) &&
           webgl_file_add(file, "scales", scales, sizeof *scales * clusters * components, error) &&
           webgl_file_add(file, "means", means, sizeof *means * clusters * block, error) &&
           webgl_file_add(file, "brdfs", brdfs, clusters * components * block, error);
}

/* Adds the sections "depths", "directions" and "triangles". */
static gboolean add_views(WebglFile *file, const struct mdf_table *t,
                          const Directions *triangulated, double deepest_mm, GError **error) {
    const gsize n = (gsize)t->width * (gsize)t->height * (gsize)t->n_views;
    const double scale = deepest_mm > 0.0 ? 255.0 / deepest_mm : 0.0;
    int n_triangles;
    const int *corners = directions_triangles(triangulated, &n_triangles);
    const gsize n_corners = 3 * (gsize)n_triangles, n_floats = 3 * (gsize)t->n_views;
    g_autofree guint8 *depths = g_new(guint8, n);
    g_autofree float *views = g_new(float, n_floats);
    g_autofree guint16 *triangles = g_new(guint16, n_corners);
    for (gsize k = 0; k < n; k++)
        depths[k] = (guint8)lrint(CLAMP((double)t->depth_mm[k] * scale, 0.0, 255.0));
    for (int k = 0; k < t->n_views; k++)
        direction_from_deg((double)t->theta_deg[k], (double)t->phi_deg[k], views + 3 * (gsize)k);
    for (gsize k = 0; k < n_corners; k++)
        triangles[k] = GUINT16_TO_LE((guint16)corners[k]);
    return webgl_file_add(file, "depths", depths, n, error) &&
           webgl_file_add(file, "directions", views, sizeof *views * n_floats, error) &&
           webgl_file_add(file, "triangles", triangles, sizeof *triangles * n_corners, error);
}

static GVariant *along_info(const struct mdf_table *t) {
    GVariantDict along;
    g_variant_dict_init(&along, NULL);
    g_variant_dict_insert(&along, "width", "i", t->width);
    g_variant_dict_insert(&along, "height", "i", t->height);
    g_variant_dict_insert(&along, "views", "i", t->n_views);
    return g_variant_dict_end(&along);
}

static GVariant *shell_info(const struct mdf_shell *s) {
    GVariantDict shell;
    g_variant_dict_init(&shell, NULL);
    g_variant_dict_insert(&shell, "width", "i", s->width);
    g_variant_dict_insert(&shell, "height", "i", s->height);
    g_variant_dict_insert(&shell, "depth", "i", s->depth);
    g_variant_dict_insert(&shell, "width_mm", "d", s->width_mm);
    g_variant_dict_insert(&shell, "height_mm", "d", s->height_mm);
    g_variant_dict_insert(&shell, "depth_mm", "d", s->depth_mm);
    g_variant_dict_insert(&shell, "top_mm", "d", s->top_mm);
    g_variant_dict_insert(&shell, "most_per_mm", "d", s->most_per_mm);
    return g_variant_dict_end(&shell);
}

static void insert_levels(GVariantDict *info, const struct webgl_pack *pack,
                          const struct totals *all, int n) {
    GVariantBuilder levels;
    g_variant_builder_init(&levels, G_VARIANT_TYPE("aax"));
    for (int k = 0; k < pack->n_levels; k++)
        g_variant_builder_add_value(
            &levels, g_variant_new_parsed("[%x, %x]", (gint64)pack->levels[k]->layout.width,
                                          (gint64)pack->levels[k]->layout.height));
    g_variant_dict_insert_value(info, "levels", g_variant_builder_end(&levels));
    g_variant_dict_insert(info, "clusters", "i", all->clusters);
    g_variant_dict_insert(info, "components", "i", all->components);
    g_variant_dict_insert(info, "grid", "i", n);
}

static void insert_common(GVariantDict *info, const struct webgl_pack *pack,
                          const struct btf_layout *layout, gboolean along) {
    g_variant_dict_insert(info, "name", "s", pack->name);
    g_variant_dict_insert(info, "texel_mm", "d", layout->texel_mm);
    g_variant_dict_insert(info, "views", "i", (int)layout->views.n);
    if (pack->shell)
        g_variant_dict_insert_value(info, "shell", shell_info(pack->shell));
    if (along)
        g_variant_dict_insert_value(info, "along", along_info(pack->views));
}

/* Adds the sections of the local PCA. */
static gboolean add_levels(WebglFile *file, const struct webgl_pack *pack, int n_grid,
                           const struct work *work, GVariantDict *info, GError **error) {
    const struct totals all = webgl_pack_totals(pack);
    const int n = pack->levels[0]->n_grid > 0 ? pack->levels[0]->n_grid : n_grid;
    if (all.clusters > G_MAXUINT16)
        return data_error_fail(
            pack->name, 0, error,
            "the mip levels have %d clusters together, but a web file can have at most 65535; "
            "compress the material with fewer clusters (-k)",
            all.clusters);
    insert_levels(info, pack, &all, n);
    return webgl_pack_texels(file, pack, &all, error) &&
           webgl_pack_volumes(file, pack, &all, n, work, error);
}

/* Adds the sections of neural planes. */
static gboolean add_neural(WebglFile *file, const struct neural *neural, GVariantDict *info,
                           GError **error) {
    g_variant_dict_insert_value(info, "levels",
                                g_variant_new_parsed("[[%x, %x]]", (gint64)neural->layout.width,
                                                     (gint64)neural->layout.height));
    return webgl_neural_add(file, neural, info, error);
}

GBytes *webgl_pack(const struct webgl_pack *pack, int n_grid, const struct work *work,
                   GError **error) {
    const struct btf_layout *layout =
        pack->neural ? &pack->neural->layout : &pack->levels[0]->layout;
    g_autoptr(WebglFile) file = webgl_file_new();
    g_autoptr(Directions) triangulated = triangulate(pack->views);
    g_auto(GVariantDict) info;
    g_variant_dict_init(&info, NULL);
    insert_common(&info, pack, layout, triangulated != NULL);
    if (!(pack->neural ? add_neural(file, pack->neural, &info, error)
                       : add_levels(file, pack, n_grid, work, &info, error)) ||
        (pack->shell &&
         !webgl_file_add(file, "shell", pack->shell->values, shell_bytes(pack->shell), error)) ||
        (pack->shell && triangulated &&
         !add_views(file, pack->views, triangulated, pack->shell->depth_mm, error)))
        return NULL;
    return webgl_file_bytes(file, g_variant_dict_end(&info));
}
