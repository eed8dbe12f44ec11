#include "webgl_source.h"

#include <gio/gio.h>

#include "base/data_error.h"
#include "codecs/codecs.h"
#include "codecs/lpca/lpca_pack.h"
#include "codecs/mdf_codecs/mdf_source.h"
#include "session/session.h"

#define CLUSTERS   32 /* defaults of “mesorig compress” */
#define COMPONENTS 8

/* Returns the BTF that a material of another codec reconstructs. Returns NULL with an error if the
 * BTF does not fit into memory. */
static struct btf_matrix *matrix(const Material *material, const char *path, GError **error) {
    const struct material_info *info = material_info(material);
    const gsize texels = btf_layout_texels(info->layout), row = btf_layout_values(info->layout);
    float *values = g_try_new(float, texels *row);
    if (!values) {
        data_error_set(path, 0, error,
                       "the %zu texels of %zu values do not fit into memory; compress the session "
                       "with “mesorig compress --method lpca” and export that file",
                       texels, row);
        return NULL;
    }
    for (gsize k = 0; k < texels; k++)
        material_reconstruct(material, (int)k, values + row * k);
    struct btf_matrix *btf = g_new0(struct btf_matrix, 1);
    btf->name = g_strdup(info->label);
    btf->layout = btf_layout_copy(info->layout);
    btf->values = values;
    return btf;
}

static gboolean compute(struct webgl_source *source, const struct btf_matrix *btf,
                        const struct work *work, GError **error) {
    const struct lpca_options options = {
        .n_clusters = (int)MIN(CLUSTERS, btf_layout_texels(&btf->layout)),
        .n_components = (int)MIN(COMPONENTS, btf_layout_values(&btf->layout)),
        .work = *work};
    source->levels[0] = lpca_compute(btf, &options, error);
    source->n_levels = source->levels[0] != NULL;
    source->compressed = TRUE;
    return source->levels[0] != NULL;
}

static gboolean convert(struct webgl_source *source, const char *path, const struct work *work,
                        GError **error) {
    g_autoptr(Material) material = material_open(path, work, error);
    if (!material)
        return FALSE;
    const struct btf_matrix *btf = material_btf(material);
    if (btf)
        return compute(source, btf, work, error);
    struct btf_matrix *own = matrix(material, path, error);
    const gboolean ok = own && compute(source, own, work, error);
    btf_matrix_free(own);
    return ok;
}

/* A packed local PCA has a single cluster, which may have too many components for drawing. Replaces
 * it by a local PCA of CLUSTERS clusters. Does not change any other local PCA. */
static gboolean make_drawable(struct lpca **lpca, GError **error) {
    const struct lpca_options options = {.n_clusters = CLUSTERS, .n_components = COMPONENTS};
    if ((*lpca)->quantise != LPCA_PACKED || (*lpca)->n_clusters > 1)
        return TRUE;
    struct lpca *grouped = lpca_regroup(*lpca, &options, error);
    lpca_free(*lpca);
    *lpca = grouped;
    return grouped != NULL;
}

static gboolean webgl_source_read(struct webgl_source *source, const char *file,
                                  const struct work *work, GError **error) {
    g_autoptr(GError) local = NULL;
    g_autoptr(ExrFile) headers = exr_read_headers(file, error);
    const struct exr_part *clusters = headers ? exr_file_part(headers, "clusters") : NULL;
    const struct exr_part *surface = headers ? exr_file_part(headers, "surface1") : NULL;
    const char *kind = NULL, *colours = NULL;
    if (!headers)
        return FALSE;
    if (clusters) {
        exr_get_string(clusters, "mesorig.kind", &kind, NULL);
        exr_get_string(clusters, "mesorig.colours", &colours, NULL);
    }
    if (surface)
        exr_get_string(surface, "mesorig.kind", &kind, NULL);
    if (g_strcmp0(kind, "neural") == 0) {
        source->neural = session_check_product(file, error) ? neural_read(file, error) : NULL;
        return source->neural != NULL;
    }
    /* A local PCA of logarithms is converted as well, because logarithms cannot be interpolated in
     * the same way as reflectances. */
    if (g_strcmp0(kind, "lpca") != 0 || g_strcmp0(colours, "log") == 0)
        return convert(source, file, work, error);
    if (!session_check_product(file, error))
        return FALSE;
    source->n_levels = lpca_read_levels(file, source->levels, error);
    for (int k = 0; k < source->n_levels; k++)
        if (!make_drawable(&source->levels[k], error))
            return FALSE;
    return source->n_levels > 0;
}

/* Reads an MDF in any form. Keeps only its measured views, and makes the same shell as
 * mesorig-view. */
static gboolean read_mdf(struct webgl_source *source, const char *file, GError **error) {
    struct mdf_source *mdf = mdf_source_read(file, error);
    if (!mdf)
        return FALSE;
    source->views =
        mdf->factors ? mdf_factors_table(mdf->factors) : mdf_table_copy_measured(mdf->table);
    source->shell = mdf_shell_new(source->views);
    mdf_source_free(mdf);
    return TRUE;
}

gboolean webgl_source_open(struct webgl_source *source, const char *path, const char *mdf,
                           const struct work *work, GError **error) {
    const gboolean directory = g_file_test(path, G_FILE_TEST_IS_DIR);
    g_autofree char *folder =
        directory ? g_build_filename(path, "products", NULL) : g_path_get_dirname(path);
    g_autofree char *lpca = g_build_filename(folder, "lpca.exr", NULL);
    g_autofree char *beside = g_build_filename(folder, "mdf.exr", NULL);
    *source = (struct webgl_source){0};
    const gboolean ok = !directory ? webgl_source_read(source, path, work, error)
                        : g_file_test(lpca, G_FILE_TEST_EXISTS)
                            ? webgl_source_read(source, lpca, work, error)
                            : convert(source, path, work, error);
    if (!ok || (!mdf && !g_file_test(beside, G_FILE_TEST_EXISTS)))
        return ok;
    return mdf_source_fits(mdf ? mdf : beside, path, error) &&
           read_mdf(source, mdf ? mdf : beside, error);
}

void webgl_source_clear(struct webgl_source *source) {
    for (int k = 0; k < source->n_levels; k++)
        lpca_free(source->levels[k]);
    neural_free(source->neural);
    mdf_shell_free(source->shell);
    mdf_table_free(source->views);
    *source = (struct webgl_source){0};
}
