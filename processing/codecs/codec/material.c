#include "material.h"

#include <string.h>

#define COLOURS 3

struct Material {
    struct material_info info;
    const struct codec *codec;
    gpointer model;
    gboolean borrowed; /* the caller owns the model */
};

static void btf_free(gpointer model) {
    btf_matrix_free(model);
}

static gint64 btf_bytes(gconstpointer model) {
    const struct btf_matrix *btf = model;
    return btf_matrix_bytes(&btf->layout) / 2;
}

static void btf_reconstruct(gconstpointer model, int texel, float *ret) {
    const struct btf_matrix *btf = model;
    const gsize n = btf_layout_values(&btf->layout);
    memcpy(ret, btf->values + (gsize)texel * n, sizeof(float) * n);
}

/* Adds Σ_a Σ_b g_a h_b B(x, v_a, l_b) for each texel x, times its share. v_a and l_b are the views
 * and lights of the query. g_a and h_b are their weights. */
static void btf_evaluate(gconstpointer model, const struct codec_query *query,
                         const struct codec_texels *texels, float ret[COLOURS]) {
    const struct btf_matrix *btf = model;
    const gsize n = btf_layout_values(&btf->layout), row = btf->layout.lights.n * COLOURS;
    for (int k = 0; k < texels->n; k++)
        for (int a = 0; a < query->n_views; a++) {
            const float *from =
                btf->values + (gsize)texels->index[k] * n + (gsize)query->views[a] * row;
            const float share = texels->share[k] * query->view_weights[a];
            for (int b = 0; b < query->n_lights; b++)
                for (int c = 0; c < COLOURS; c++)
                    ret[c] += share * query->light_weights[b] *
                              from[(gsize)query->lights[b] * COLOURS + (gsize)c];
        }
}

const struct codec material_btf_codec = {
    .name = "btf",
    .free = btf_free,
    .layout = G_STRUCT_OFFSET(struct btf_matrix, layout),
    .bytes = btf_bytes,
    .reconstruct = btf_reconstruct,
    .evaluate = btf_evaluate,
};

Material *material_new(const char *label, const struct codec *codec, gpointer model) {
    Material *material = g_new0(Material, 1);
    material->info.layout = G_STRUCT_MEMBER_P(model, codec->layout);
    material->info.label = g_strdup(label);
    material->info.kind = codec->name;
    material->info.bytes = codec->bytes(model);
    material->codec = codec;
    material->model = model;
    return material;
}

Material *material_borrow(const char *label, const struct codec *codec, gconstpointer model) {
    Material *material = material_new(label, codec, (gpointer)model);
    material->borrowed = TRUE;
    return material;
}

void material_free(Material *material) {
    if (!material)
        return;
    g_free(material->info.label);
    if (!material->borrowed)
        material->codec->free(material->model);
    g_free(material);
}

const struct material_info *material_info(const Material *material) {
    return &material->info;
}

const struct codec *material_codec(const Material *material) {
    return material->codec;
}

gconstpointer material_model(const Material *material) {
    return material->model;
}

const struct btf_matrix *material_btf(const Material *material) {
    return material->codec == &material_btf_codec ? material->model : NULL;
}

void material_reconstruct(const Material *material, int texel, float *ret) {
    material->codec->reconstruct(material->model, texel, ret);
}
