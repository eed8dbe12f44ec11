/* BRDFs that other laboratories have measured, read from their files through one interface:
 *   rgl    RGL's .bsdf (Dupuy & Jakob 2018), see rgl.h
 *   merl   MERL's .binary (Matusik et al. 2003), see merl.h
 *   utia   UTIA's .bin or .exr (Filip & Vávra 2014), see utia.h
 *
 * f_r (l, v) is reflected radiance over irradiance, in 1/sr, in linear sRGB. It does not contain
 * n·l. Directions are unit vectors with z along the normal. Any thread; several threads may
 * evaluate an opened BRDF at the same time. */
#pragma once

#include "brdf_function.h"

enum brdf_kind { BRDF_RGL, BRDF_MERL, BRDF_UTIA };
#define BRDF_KINDS 3

typedef struct Brdf Brdf;

/* Opens a file. coding is for UTIA's files; NULL means that numbers are f_r. Errors are
 * DATA_ERROR_INVALID and DATA_ERROR_IO, and name the file and its defect. */
Brdf *brdf_open(const char *path, enum brdf_kind kind, const struct brdf_coding *coding,
                GError **error);
void brdf_free(Brdf *brdf); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Brdf, brdf_free)

/* Evaluates a BRDF. The result is never negative, and is 0 if one of the directions is below the
 * surface. This is a BrdfFunction, with the BRDF as data. */
void brdf_evaluate(const float light[3], const float view[3], float ret[3], gpointer brdf);
