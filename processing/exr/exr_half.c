/* A half has 1 sign bit, 5 exponent bits (bias 15) and 10 fraction bits. A float has 1 sign bit, 8
 * exponent bits (bias 127) and 23 fraction bits. */
#include "exr_half.h"

#include <string.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

#define HALF_MAX      0x7bffu
#define FLOAT_INF     0x7f800000u
#define FLOAT_TOO_BIG 0x477ff000u /* 65520: from this value on, a half rounds to infinity */
#define FLOAT_NORMAL  0x38800000u /* 2⁻¹⁴, the smallest normal half */

static inline guint32 bits_of(float value) {
    guint32 bits;

    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static inline float float_of(guint32 bits) {
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline guint16 half_of(float value) {
    guint32 bits = bits_of(value), sign = bits >> 16 & 0x8000, magnitude = bits & 0x7fffffff;
    guint32 half;

    if (magnitude > FLOAT_INF) {
        half = 0x7c00 | (magnitude >> 13 & 0x3ff);
        half |=
            /* a NaN whose upper fraction bits are all 0 would become infinity */
            half == 0x7c00 ? 0x200 : 0;
    } else if (magnitude >= FLOAT_TOO_BIG) {
        half = HALF_MAX;
    } else if (magnitude < FLOAT_NORMAL) {
        /* In the sum with 0.5, the processor rounds the value to the last bits, which are then the
         * bits of the subnormal half. */
        half = bits_of(float_of(magnitude) + 0.5f) - bits_of(0.5f);
    } else {
        half = (magnitude - ((127 - 15) << 23) + 0xfff + (magnitude >> 13 & 1)) >> 13;
    }
    return (guint16)(sign | half);
}

/* Converts a half. There are no branches, so that compilers can vectorise the loop. The
 * multiplication by 2¹¹² corrects the bias of the exponent, without rounding, and normalises
 * subnormal halves. */
static inline float float_of_half(guint16 half) {
    guint32 sign = (guint32)(half & 0x8000) << 16, rest = (guint32)(half & 0x7fff) << 13;
    guint32 bits = bits_of(float_of(rest) * 0x1p112f);

    return float_of(sign | (rest >= 0x0f800000 ? FLOAT_INF | rest : bits));
}

void exr_half_from_floats(guint16 *to, const float *from, gsize n) {
    for (gsize i = 0; i < n; i++)
        to[i] = GUINT16_TO_LE(half_of(from[i]));
}

/* Converts groups of eight values with F16C. Stops before a group with infinity or NaN, because
 * F16C would change the bits of a signalling NaN; float_of_half() converts such a group. Returns
 * the number of converted values. */
#ifdef __x86_64__
__attribute__((target("avx,f16c"))) static gsize convert_eights(float *to, const guint16 *from,
                                                                gsize n) {
    const __m128i exponent = _mm_set1_epi16(0x7c00);
    gsize done = 0;

    for (; done + 8 <= n; done += 8) {
        const __m128i halves = _mm_loadu_si128((const __m128i *)(gconstpointer)(from + done));
        if (_mm_movemask_epi8(_mm_cmpeq_epi16(_mm_and_si128(halves, exponent), exponent)))
            break;
        _mm256_storeu_ps(to + done, _mm256_cvtph_ps(halves));
    }
    return done;
}
#endif

void exr_half_to_floats(float *to, const guint16 *from, gsize n) {
    gsize done = 0;

    while (done < n) {
#ifdef __x86_64__
        if (__builtin_cpu_supports("avx2")) /* implies F16C */
            done += convert_eights(to + done, from + done, n - done);
#endif
        for (gsize end = MIN(n, done + 64); done < end; done++)
            to[done] = float_of_half(GUINT16_FROM_LE(from[done]));
    }
}
