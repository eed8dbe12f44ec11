/*
 * UTIA's BRDFs (Filip & Vávra 2014; btf.utia.cas.cz): anisotropic, 288 directions of light by 288
 * of view, θ = 0°, 15° … 75° by φ = 0°, 7.5° … 352.5°. Direction number 48 i + j has the i-th θ and
 * the j-th φ.
 *   .bin  f64[3][288][288], little-endian: red, green, blue; then light, then view
 *   .exr  288 × 288 pixels, channels R, G, B: a row for each light, a column for each view
 * The 48 lights (views) of θ = 0 are one direction; their mean is taken. If the last 48 rows of an
 * EXR are more alike than its first 48, the rows are read from the last to the first.
 *
 * Readers do not agree on the unit of the numbers. Some use the numbers as linear values, others as
 * sRGB. Dupuy's dj_brdf computes 100 · linear (number / 140). struct brdf_coding selects the
 * conversion. Negative numbers, which some files have, count as 0.
 */
#pragma once

#include "brdf_function.h"

#define UTIA_THETAS 6
#define UTIA_PHIS   48
#define UTIA_SIDE   (UTIA_THETAS * UTIA_PHIS)

struct utia;

struct utia *utia_read(const char *path, const struct brdf_coding *coding, GError **error);
void utia_free(struct utia *utia); /* NULL is ignored */

/* Evaluates a BRDF. Between the measured directions, it is linear in θ and φ of light and view.
 * Beyond 75° it has the value at 75°. */
void utia_evaluate(const struct utia *utia, const float light[3], const float view[3],
                   float ret[3]);
