#include "psnr.h"

#include "base/srgb.h"

static float show(float linear) {
    return (float)srgb_encode(CLAMP(linear, 0.0F, 1.0F));
}

void psnr_show(const float *linear, gsize n, float *ret) {
    for (gsize i = 0; i < n; i++)
        ret[i] = show(linear[i]);
}

double psnr_mean_square(const float *reference, const float *test, int width, int height) {
    const gsize n = 3 * (gsize)width * (gsize)height;
    double sum = 0;
    for (gsize i = 0; i < n; i++) {
        const double difference = (double)show(reference[i]) - show(test[i]);
        sum += difference * difference;
    }
    return sum / (double)n;
}

double psnr_decibels(double mean_square) {
    return mean_square > 0 ? -10 * log10(mean_square) : INFINITY;
}

double psnr(const float *reference, const float *test, int width, int height) {
    return psnr_decibels(psnr_mean_square(reference, test, width, height));
}
