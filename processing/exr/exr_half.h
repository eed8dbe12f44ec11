/* IEEE 754 half floats as EXR stores them: little-endian, rounded to nearest, ties to even. The
 * bits of NaN are kept in both directions. Any thread. */
#pragma once

#include <glib.h>

#define EXR_HALF_LARGEST 65504.0F

/* Values beyond ±65504, infinities included, become ±65504. to and from do not overlap. */
void exr_half_from_floats(guint16 *to, const float *from, gsize n);
void exr_half_to_floats(float *to, const guint16 *from, gsize n);
