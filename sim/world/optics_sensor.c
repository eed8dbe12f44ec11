#include "optics.h"

#include "samples/sample.h"

/* The table has quantiles of the normal distribution. A normal deviate is the sum of two entries of
 * the table. The quantiles are scaled so that these sums have the variance 1. The sums reach 4.6
 * σ. */
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

struct sensor { /* properties of a sensor in electrons and DN; see optics_sense() */
    float electrons_per_rate, read_variance, full_well, dn_per_e, bend, max;
};

struct column { /* factor of the signal, and offset in DN */
    float gain, black;
};

static inline guint16 read_pixel(const struct sensor *s, const struct column *column, float rate,
                                 float deviate, float noise) {
    float e = rate * s->electrons_per_rate;
    float seen = e + sqrtf(e + s->read_variance) * deviate * noise;
    float linear = MIN(seen, s->full_well) * s->dn_per_e * column->gain;
    float dn = column->black + linear * (1 - s->bend * linear) + 0.5f;
    return (guint16)CLAMP(dn, 0, s->max);
}

/* Returns a struct column for each pixel of a row. */
static struct column *columns_new(const struct optics_camera *camera) {
    const double max = (double)((1 << camera->bits) - 1);
    struct column *columns = g_new0(struct column, camera->width);
    struct sample_random random = {camera->columns_key};
    for (int x = 0; x < camera->width; x++) {
        const double offset = camera->column_offset * sample_deviate(&random);
        columns[x] =
            (struct column){.gain = (float)(2 * x < camera->width ? 1 : 1 + camera->half_gain_step),
                            .black = (float)(camera->black_level + offset * max)};
    }
    return columns;
}

void optics_add_glare(const struct optics_camera *camera, float *rate) {
    double sum[3] = {0};
    guint n[3] = {0};
    if (!(camera->veiling_glare > 0))
        return;
    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++) {
            const enum cfa_colour colour = cfa_colour_at(camera->cfa, x, y);
            sum[colour] += (double)rate[y * camera->width + x];
            n[colour]++;
        }
    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++) {
            const enum cfa_colour colour = cfa_colour_at(camera->cfa, x, y);
            rate[y * camera->width + x] += (float)(camera->veiling_glare * sum[colour] / n[colour]);
        }
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
        .max = (float)max,
    };
    g_autofree struct column *columns = columns_new(camera);
    const struct column *column = columns, *end = columns + camera->width;
    float on = noise ? 1 : 0;
    gsize n = (gsize)camera->width * (gsize)camera->height;
    for (gsize i = 0; i < n; i += 2) {
        guint64 bits = sample_hash(key + i * 0x9e3779b97f4a7c15u);
        ret_pixels[i] = read_pixel(&s, column, rate ? rate[i] : 0, normal((guint32)bits), on);
        column = column + 1 < end ? column + 1 : columns;
        if (i + 1 < n)
            ret_pixels[i + 1] =
                read_pixel(&s, column, rate ? rate[i + 1] : 0, normal((guint32)(bits >> 32)), on);
        column = column + 1 < end ? column + 1 : columns;
    }
}
