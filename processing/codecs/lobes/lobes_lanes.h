/* Vectors of eight floats, and the few functions on them that lobes_fit.c needs. */
#pragma once

#include <glib.h>
#include <string.h>

#define LANES 8
typedef float lanes __attribute__((vector_size(4 * LANES)));
/* result of a comparison: −1 in each lane where it is true, otherwise 0 */
typedef gint32 lane_bits __attribute__((vector_size(4 * LANES)));

/* Functions with this mark are always inlined, because their callers are compiled for several kinds
 * of processors. */
#define LANES_INLINE static inline __attribute__((always_inline))

LANES_INLINE lanes lanes_all(float value) {
    return (lanes){value, value, value, value, value, value, value, value};
}

LANES_INLINE lanes lanes_if(lane_bits condition, lanes yes, lanes no) {
    return (lanes)((condition & (lane_bits)yes) | (~condition & (lane_bits)no));
}

LANES_INLINE lanes lanes_max(lanes a, lanes b) {
    return lanes_if(a > b, a, b);
}

LANES_INLINE lanes lanes_min(lanes a, lanes b) {
    return lanes_if(a < b, a, b);
}

/* Computes log₂ x of normal numbers x > 0. The absolute error is about 1e-7. */
LANES_INLINE lanes lanes_log2(lanes x) {
    const lane_bits bits = (lane_bits)x - 0x3f3504f3; /* √½: the mantissa lies in √½ … √2 */
    const lane_bits exponent = bits >> 23;
    const lanes mantissa = (lanes)((lane_bits)x - (exponent << 23));
    const lanes t = (mantissa - 1.0F) / (mantissa + 1.0F), t2 = t * t;
    const lanes series = 2.88539008F + t2 * (0.96179669F + t2 * (0.57707802F + t2 * 0.41219859F));
    return __builtin_convertvector(exponent, lanes) + t * series;
}

/* Computes 2^x, clamped to 2^±50. The squares of smaller values would be denormal, which is slow on
 * many processors. */
LANES_INLINE lanes lanes_exp2(lanes x) {
    /* 1.5 · 2²³; adding this number to x rounds x to a whole number */
    const lanes magic = lanes_all(12582912.0F);
    x = lanes_max(lanes_min(x, lanes_all(50)), lanes_all(-50));
    const lanes shifted = x + magic, whole = shifted - magic;
    const lanes u = (x - whole) * 0.69314718F;
    const lanes series =
        1.0F +
        u * (1.0F +
             u * (0.5F + u * (1.0F / 6 + u * (1.0F / 24 + u * (1.0F / 120 + u * (1.0F / 720))))));
    const lane_bits power = (__builtin_convertvector(whole, lane_bits) + 127) << 23;
    return series * (lanes)power;
}

/* Computes √x of normal numbers x > 0. */
LANES_INLINE lanes lanes_sqrt(lanes x) {
    return lanes_exp2(0.5F * lanes_log2(x));
}
