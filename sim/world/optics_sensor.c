#include "optics.h"

#include "samples/sample.h"

/* Normal deviates by table: quantiles of the normal distribution, scaled so that the table's
 * variance is one. The sum of two entries has tails to 4.6 σ. */
#define TABLE_BITS 11
#define TABLE_SIZE (1 << TABLE_BITS)

static float table[TABLE_SIZE];

static double normal_quantile(double p) {
    double low = -8, high = 8;
    for (int i = 0; i < 60; i++) {
        double mid = (low + high) / 2;
        if (erfc(-mid / G_SQRT2) / 2 < p)
            low = mid;
        else
            high = mid;
    }
    return low;
}

static void fill_table(void) {
    double sum = 0;
    for (int i = 0; i < TABLE_SIZE / 2; i++) {
        double q = normal_quantile((i + 0.5) / TABLE_SIZE);
        table[i] = (float)q;
        table[TABLE_SIZE - 1 - i] = (float)-q;
        sum += 2 * q * q;
    }
    double scale = sqrt(TABLE_SIZE / sum) / G_SQRT2;
    for (int i = 0; i < TABLE_SIZE; i++)
        table[i] = (float)(table[i] * scale);
}

static inline float normal(guint32 bits) {
    return table[bits & (TABLE_SIZE - 1)] + table[bits >> TABLE_BITS & (TABLE_SIZE - 1)];
}

struct sensor { /* electrons, DN an electron, DN */
    float electrons_per_rate, read_variance, full_well, dn_per_e, bend, black, max;
};

static inline guint16 read_pixel(const struct sensor *s, float rate, float deviate, float noise) {
    float e = rate * s->electrons_per_rate;
    float seen = e + sqrtf(e + s->read_variance) * deviate * noise;
    float linear = MIN(seen, s->full_well) * s->dn_per_e;
    float dn = s->black + linear * (1 - s->bend * linear) + 0.5f;
    return (guint16)CLAMP(dn, 0, s->max);
}

void optics_sense(const struct optics_camera *camera, const float *rate, double exposure_s,
                  double gain_db, gboolean noise, guint64 key, guint16 *ret_pixels) {
    static gsize filled;
    if (g_once_init_enter(&filled)) {
        fill_table();
        g_once_init_leave(&filled, 1);
    }
    double max = (double)((1 << camera->bits) - 1);
    double e_per_dn = camera->full_well_e / (max - camera->black_level);
    struct sensor s = {
        .electrons_per_rate = (float)(exposure_s * e_per_dn),
        .read_variance = (float)(camera->read_noise_e * camera->read_noise_e),
        .full_well = (float)camera->full_well_e,
        .dn_per_e = (float)(pow(10, gain_db / 20) / e_per_dn),
        .bend = (float)(camera->curvature / (max - camera->black_level)),
        .black = (float)camera->black_level,
        .max = (float)max,
    };
    float on = noise ? 1 : 0;
    gsize n = (gsize)camera->width * (gsize)camera->height;
    for (gsize i = 0; i < n; i += 2) {
        guint64 bits = sample_hash(key + i * 0x9e3779b97f4a7c15u);
        ret_pixels[i] = read_pixel(&s, rate ? rate[i] : 0, normal((guint32)bits), on);
        if (i + 1 < n)
            ret_pixels[i + 1] =
                read_pixel(&s, rate ? rate[i + 1] : 0, normal((guint32)(bits >> 32)), on);
    }
}
