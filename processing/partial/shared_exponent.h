/* Pictures of three colours in 32 bits per texel, as graphics cards read them: GL_RGB9_E5 of OpenGL
 * and WebGL. The mantissas r, g, b have 9 bits each, from the lowest bit on, and the exponent e has
 * the upper 5 bits. The colour is (r, g, b) · 2^(e − 24). Values are from 0 to 65408. If the
 * largest colour of a texel is at least 2^−16, it has a relative error of at most 1/512. Any
 * thread. */
#pragma once

#include <glib.h>
#include <math.h>

#define SHARED_EXPONENT_MAX 65408.0f

/* Returns 2^exponent for exponents of −126 to 127. A shift is an order of magnitude faster than
 * ldexpf(), and pictures have millions of texels. */
static inline float shared_exponent_power(int exponent) {
    const union {
        guint32 bits;
        float value;
    } ret = {.bits = (guint32)(exponent + 127) << 23};
    return ret.value;
}

/* Packs a colour. Values above SHARED_EXPONENT_MAX are limited to it. Negative values and NaN
 * become 0. */
static inline guint32 shared_exponent_pack(const float rgb[3]) {
    float c[3];
    union {
        float value;
        guint32 bits;
    } most = {0};
    for (int i = 0; i < 3; i++) {
        c[i] = rgb[i] > 0 ? fminf(rgb[i], SHARED_EXPONENT_MAX) : 0; /* also for NaN */
        most.value = fmaxf(most.value, c[i]);
    }
    int exponent = MAX((int)(most.bits >> 23) - 126, -15); /* most < 2^exponent */
    if (most.value * shared_exponent_power(9 - exponent) + 0.5f >= 512)
        exponent++;
    const float scale = shared_exponent_power(9 - exponent);
    guint32 ret = (guint32)(exponent + 15) << 27;
    for (int i = 0; i < 3; i++)
        ret |= (guint32)(c[i] * scale + 0.5f) << 9 * i;
    return ret;
}

static inline void shared_exponent_unpack(guint32 packed, float ret[3]) {
    const float scale = shared_exponent_power((int)(packed >> 27) - 24);
    for (int i = 0; i < 3; i++)
        ret[i] = scale * (float)(packed >> 9 * i & 511);
}
