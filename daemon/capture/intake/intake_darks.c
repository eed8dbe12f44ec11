#include "intake_darks.h"

#include <math.h>

/* Estimates the dark level of each pixel at an exposure for which there are no dark frames. With
 * dark frames at two exposures, the level is a linear function of exposure through the pixel's two
 * values. With dark frames at one exposure, their values are used. Without dark frames, the
 * sensor's nominal black level is used. */
static void guess_dark(const struct intake_darks *darks, gint64 exposure_us, const Frame *frame,
                       struct intake_dark *ret) {
    const struct intake_dark *known[2] = {NULL, NULL};
    const gsize n = (gsize)frame->width * frame->height;
    double sum = 0, along = 0;
    for (int i = 0, k = 0; i < SHOT_MAX_DARKS && k < 2; i++)
        if (darks->levels[i].pixels)
            known[k++] = &darks->levels[i];
    if (known[1])
        along = (double)(exposure_us - known[0]->exposure_us) /
                (double)(known[1]->exposure_us - known[0]->exposure_us);
    if (!ret->pixels)
        ret->pixels = g_new(float, n);
    for (gsize p = 0; p < n; p++) {
        double level = known[0] ? known[0]->pixels[p] : frame->black_level;
        level += known[1] ? along * (known[1]->pixels[p] - level) : 0;
        ret->pixels[p] = (float)level;
        sum += level;
    }
    ret->mean_dn = sum / (double)n;
    ret->exposure_us = exposure_us;
}

const struct intake_dark *intake_darks_at(struct intake_darks *darks, int sub, const Frame *frame) {
    for (int i = 0; i < SHOT_MAX_DARKS; i++)
        if (darks->levels[i].pixels && darks->levels[i].exposure_us == frame->exposure_us)
            return &darks->levels[i];
    struct intake_dark *guess = &darks->guesses[sub];
    if (!guess->pixels || guess->exposure_us != frame->exposure_us)
        guess_dark(darks, frame->exposure_us, frame, guess);
    return guess;
}

void intake_darks_set(struct intake_darks *darks, int index, gint64 exposure_us, float *pixels,
                      double mean_dn) {
    g_free(darks->levels[index].pixels);
    darks->levels[index] = (struct intake_dark){exposure_us, mean_dn, pixels};
    for (int i = 0; i < PLAN_MAX_BRACKET; i++)
        g_clear_pointer(&darks->guesses[i].pixels, g_free);
}

void intake_darks_clear(struct intake_darks *darks) {
    for (int i = 0; i < SHOT_MAX_DARKS; i++)
        g_clear_pointer(&darks->levels[i].pixels, g_free);
    for (int i = 0; i < PLAN_MAX_BRACKET; i++)
        g_clear_pointer(&darks->guesses[i].pixels, g_free);
}
