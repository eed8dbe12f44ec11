/* Draws light directions in proportion to the reflection of a material. */
#include "material_private.h"
#include "material_sampler.h"

#include <math.h>
#include <string.h>

/* The context of sample_evaluate(), which evaluates a model in one measured view. */
struct sample_formula {
    const struct codec *codec;
    gconstpointer model;
    const float *views; /* x, y, z of the unit vector of each measured view */
};

static void sample_evaluate(gconstpointer context, int view, int texel, const float light[3],
                            float ret[3]) {
    const struct sample_formula *formula = context;
    const float one = 1.0F;
    struct codec_query query = {
        .n_views = 1,
        .views = &view,
        .view_weights = &one,
    };
    memcpy(query.view, formula->views + 3 * (gsize)view, sizeof query.view);
    memcpy(query.light, light, sizeof query.light);
    formula->codec->evaluate(formula->model, &query, &(struct codec_texels){1, &texel, &one}, ret);
}

/* Returns whether the model is a formula, which can be evaluated in any direction of the light. A
 * model that is a table of values gives 0 here, because a table needs the weights of measured
 * lights, and sample_evaluate() sets none. */
static gboolean sample_is_formula(const struct sample_formula *formula,
                                  const struct btf_layout *layout) {
    const gsize n = btf_layout_texels(layout);
    for (gsize k = 0; k < MIN(n, 64); k++) {
        const int texel = (int)(k * n / MIN(n, 64));
        float rgb[3] = {0.0F, 0.0F, 0.0F};
        sample_evaluate(formula, (int)(k % layout->views.n), texel,
                        (const float[3]){0.0F, 0.6F, 0.8F}, rgb);
        if (rgb[0] != 0.0F || rgb[1] != 0.0F || rgb[2] != 0.0F)
            return TRUE;
    }
    return FALSE;
}

static MaterialSampler *sample_make(const mesorig_material *m) {
    g_autofree float *views = direction_list_vectors(&m->layout->views);
    const struct sample_formula formula = {m->codec, m->levels->pdata[0], views};
    struct material_sampler_source source = {.layout = m->layout,
                                             .views = m->tables.views,
                                             .lights = m->tables.lights,
                                             .n_grid = m->tables.n_grid,
                                             .reconstruct = m->codec->reconstruct,
                                             .model = formula.model};
    if (sample_is_formula(&formula, m->layout)) {
        source.evaluate = sample_evaluate;
        source.context = &formula;
    }
    return material_sampler_new(&source);
}

/* Returns the sampler. Its tables are made at the first call, because not every renderer needs
 * them. */
static const MaterialSampler *sampling(const mesorig_material *material) {
    mesorig_material *m = (mesorig_material *)material;
    MaterialSampler *ready = g_atomic_pointer_get(&m->sampling);
    if (ready)
        return ready;
    pthread_mutex_lock(&m->sampling_lock);
    ready = g_atomic_pointer_get(&m->sampling);
    if (!ready) {
        ready = sample_make(m);
        m->sampling_free = (GDestroyNotify)material_sampler_free;
        g_atomic_pointer_set(&m->sampling, ready);
    }
    pthread_mutex_unlock(&m->sampling_lock);
    return ready;
}

static gboolean finite_numbers(const float *values, int n) {
    for (int k = 0; k < n; k++)
        if (!isfinite(values[k]))
            return FALSE;
    return TRUE;
}

/* Normalises a vector. Returns FALSE if the vector has no length or is not finite. */
static gboolean normalised(const float from[3], float ret[3]) {
    const double length =
        sqrt((double)from[0] * (double)from[0] + (double)from[1] * (double)from[1] +
             (double)from[2] * (double)from[2]);
    if (!(length > 0.0) || !isfinite(length))
        return FALSE;
    for (int c = 0; c < 3; c++)
        ret[c] = (float)((double)from[c] / length);
    return TRUE;
}

static float footprint_at(const float *footprint, size_t k) {
    return footprint != NULL && isfinite(footprint[k]) ? footprint[k] : 0.0F;
}

int mesorig_material_sample(const mesorig_material *material, size_t n, const float *uv,
                            const float *view, const float *footprint, const float *random,
                            float *ret_light, float *ret_pdf) {
    if (material == NULL ||
        (n > 0 && (uv == NULL || view == NULL || random == NULL || !ret_light || !ret_pdf)))
        return MESORIG_ERROR_ARGUMENT;
    const MaterialSampler *sampler = sampling(material);
    for (size_t k = 0; k < n; k++) {
        float v[3], numbers[2] = {random[2 * k], random[2 * k + 1]};
        ret_light[3 * k] = ret_light[3 * k + 1] = ret_light[3 * k + 2] = ret_pdf[k] = 0.0F;
        if (!normalised(view + 3 * k, v) || !finite_numbers(uv + 2 * k, 2) ||
            !finite_numbers(numbers, 2))
            continue;
        for (int c = 0; c < 2; c++)
            numbers[c] = CLAMP(numbers[c], 0.0F, 1.0F);
        ret_pdf[k] = material_sampler_draw(sampler, uv + 2 * k, v, footprint_at(footprint, k),
                                           numbers, ret_light + 3 * k);
    }
    return MESORIG_OK;
}

int mesorig_material_pdf(const mesorig_material *material, size_t n, const float *uv,
                         const float *view, const float *light, const float *footprint,
                         float *ret_pdf) {
    if (material == NULL || (n > 0 && (uv == NULL || view == NULL || light == NULL || !ret_pdf)))
        return MESORIG_ERROR_ARGUMENT;
    const MaterialSampler *sampler = sampling(material);
    for (size_t k = 0; k < n; k++) {
        float v[3], l[3];
        ret_pdf[k] = 0.0F;
        if (normalised(view + 3 * k, v) && normalised(light + 3 * k, l) &&
            finite_numbers(uv + 2 * k, 2))
            ret_pdf[k] =
                material_sampler_density(sampler, uv + 2 * k, v, l, footprint_at(footprint, k));
    }
    return MESORIG_OK;
}
