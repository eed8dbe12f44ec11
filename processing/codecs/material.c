#include "material.h"

#include <string.h>

#include "exr/exr.h"
#include "session/session.h"

#define COLOURS 3

struct Material {
    struct material_info info;
    /* One of them. */
    struct btf_matrix *btf;
    struct lpca *lpca;
    struct eigenmaps *maps;
    struct lobes *lobes;
};

void material_free(Material *material) {
    if (!material)
        return;
    g_free(material->info.label);
    btf_matrix_free(material->btf);
    lpca_free(material->lpca);
    eigenmaps_free(material->maps);
    lobes_free(material->lobes);
    g_free(material);
}

const struct material_info *material_info(const Material *material) {
    return &material->info;
}

const struct btf_matrix *material_btf(const Material *material) {
    return material->btf;
}

/* They all name what they share alike. */
#define COPY_INFO(material, from)                                                                  \
    G_STMT_START {                                                                                 \
        (material)->info.width = (from)->width;                                                    \
        (material)->info.height = (from)->height;                                                  \
        (material)->info.n_views = (from)->n_views;                                                \
        (material)->info.n_lights = (from)->n_lights;                                              \
        (material)->info.view_theta_deg = (from)->view_theta_deg;                                  \
        (material)->info.view_phi_deg = (from)->view_phi_deg;                                      \
        (material)->info.light_theta_deg = (from)->light_theta_deg;                                \
        (material)->info.light_phi_deg = (from)->light_phi_deg;                                    \
    }                                                                                              \
    G_STMT_END

static Material *material_new(const char *label, const char *kind) {
    Material *material = g_new0(Material, 1);
    material->info.label = g_strdup(label);
    material->info.kind = kind;
    return material;
}

static gint64 values(const struct material_info *info) {
    return (gint64)info->width * info->height * info->n_views * info->n_lights * COLOURS;
}

Material *material_of_btf(const char *label, struct btf_matrix *btf) {
    Material *material = material_new(label, "btf");
    material->btf = btf;
    COPY_INFO(material, btf);
    material->info.bytes = 2 * values(&material->info);
    return material;
}

Material *material_of_lpca(const char *label, struct lpca *lpca) {
    Material *material = material_new(label, "lpca");
    material->lpca = lpca;
    COPY_INFO(material, lpca);
    material->info.bytes = lpca_bytes(lpca);
    return material;
}

Material *material_of_eigenmaps(const char *label, struct eigenmaps *maps) {
    Material *material = material_new(label, "eigenmaps");
    material->maps = maps;
    COPY_INFO(material, maps);
    material->info.bytes =
        maps->n_terms * (2 * values(&material->info) / maps->n_views + 4 * (gint64)maps->n_views);
    return material;
}

Material *material_of_lobes(const char *label, struct lobes *lobes) {
    Material *material = material_new(label, lobes_model_name(lobes->model));
    material->lobes = lobes;
    COPY_INFO(material, lobes);
    material->info.bytes = lobes_bytes(lobes);
    return material;
}

static char *material_kind_of(const char *path, GError **error) {
    struct exr_file *file = exr_read_headers(path, error);
    const char *kind = NULL;
    for (guint i = 0; file && !kind && i < file->parts->len; i++)
        exr_get_string(file->parts->pdata[i], "mesorig.kind", &kind, NULL);
    char *ret = g_strdup(kind);
    if (file && !kind)
        g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                    "%s: it does not say what it is: there is no attribute mesorig.kind", path);
    exr_file_free(file);
    return ret;
}

static Material *open_exr(const char *path, const char *label, GError **error) {
    g_autofree char *kind =
        session_check_product(path, error) ? material_kind_of(path, error) : NULL;
    enum lobes_model model;
    if (!kind)
        return NULL;
    if (strcmp(kind, "lpca") == 0) {
        struct lpca *lpca = lpca_read(path, error);
        return lpca ? material_of_lpca(label, lpca) : NULL;
    }
    if (strcmp(kind, "eigenmaps") == 0) {
        struct eigenmaps *maps = eigenmaps_read(path, error);
        return maps ? material_of_eigenmaps(label, maps) : NULL;
    }
    if (lobes_model_parse(kind, &model)) {
        struct lobes *lobes = lobes_read(path, error);
        return lobes ? material_of_lobes(label, lobes) : NULL;
    }
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: a file of kind “%s” is no material that can be compared", path, kind);
    return NULL;
}

Material *material_open(const char *path, const struct work *work, GError **error) {
    g_autofree char *label = g_path_get_basename(path);
    if (!g_file_test(path, G_FILE_TEST_IS_DIR))
        return open_exr(path, label, error);
    struct btf_matrix *btf = btf_matrix_read(path, work, error);
    return btf ? material_of_btf(label, btf) : NULL;
}

/* maps: term × light × texel × RGB. */
static void reconstruct_maps(const struct eigenmaps *maps, int texel, float *ret) {
    const gsize texels = (gsize)maps->width * (gsize)maps->height, n_lights = (gsize)maps->n_lights;
    memset(ret, 0, sizeof(float) * (gsize)maps->n_views * n_lights * COLOURS);
    for (gsize term = 0; term < (gsize)maps->n_terms; term++)
        for (gsize view = 0; view < (gsize)maps->n_views; view++) {
            const float weight = maps->weights[term * (gsize)maps->n_views + view];
            for (gsize light = 0; light < n_lights; light++) {
                const float *map =
                    maps->maps + ((term * n_lights + light) * texels + (gsize)texel) * COLOURS;
                float *to = ret + (view * n_lights + light) * COLOURS;
                for (int c = 0; c < COLOURS; c++)
                    to[c] += weight * map[c];
            }
        }
}

void material_reconstruct(const Material *material, int texel, float *ret) {
    const gsize n = (gsize)material->info.n_views * (gsize)material->info.n_lights * COLOURS;
    if (material->btf)
        memcpy(ret, material->btf->values + (gsize)texel * n, sizeof(float) * n);
    else if (material->lpca)
        lpca_reconstruct(material->lpca, texel, ret);
    else if (material->maps)
        reconstruct_maps(material->maps, texel, ret);
    else
        lobes_reconstruct(material->lobes, texel, ret);
}
