/* Light directions in proportion to what a material reflects. */
#include "material_private.h"
#include "material_sampler.h"

#include <math.h>

/* The tables are made at the first call, as not every renderer asks for them. */
static const MaterialSampler *material_sampling(const mesorig_material *material) {
    mesorig_material *m = (mesorig_material *)material;
    MaterialSampler *ready = g_atomic_pointer_get(&m->sampling);
    if (ready)
        return ready;
    pthread_mutex_lock(&m->sampling_lock);
    ready = g_atomic_pointer_get(&m->sampling);
    if (!ready) {
        const struct material_sampler_source source = {
            m->layout, m->views, m->lights, m->n_grid, m->codec->reconstruct, m->levels->pdata[0]};
        ready = material_sampler_new(&source);
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

/* FALSE: it has no direction. */
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
    const MaterialSampler *sampler = material_sampling(material);
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
    const MaterialSampler *sampler = material_sampling(material);
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
