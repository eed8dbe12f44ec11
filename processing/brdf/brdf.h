/*
 * BRDFs that others have measured, read from their files through one interface:
 *   rgl    RGL's .bsdf (Dupuy & Jakob 2018), see rgl.h
 *   merl   MERL's .binary (Matusik et al. 2003), see merl.h
 *   utia   UTIA's .bin or .exr (Filip & Vávra 2014), see utia.h
 *
 * f_r (l, v) is reflected radiance over irradiance, in 1/sr, of linear sRGB; it does not hold n·l.
 * Directions are unit vectors with z along the normal. Any thread; an opened BRDF may be evaluated
 * by several at once.
 */
#pragma once

#include <gio/gio.h>

enum brdf_kind { BRDF_RGL, BRDF_MERL, BRDF_UTIA };
#define BRDF_KINDS 3

/* A BRDF to be written, or any other function of two directions. light and view lie above the
 * surface. It is called from several threads at once. */
typedef void (*BrdfFunction)(const float light[3], const float view[3], float ret[3],
                             gpointer data);

/* How UTIA's numbers become f_r = scale · decode (number / divide); see utia.h. */
struct brdf_coding {
    double divide, scale; /* 0: 1 */
    gboolean srgb;        /* decode: from sRGB to linear; else numbers are linear */
};

typedef struct Brdf Brdf;

/* coding is for UTIA's files; NULL: numbers are f_r. Errors: DATA_ERROR_INVALID and DATA_ERROR_IO
 * name the file and what is wrong with it. */
Brdf *brdf_open(const char *path, enum brdf_kind kind, const struct brdf_coding *coding,
                GError **error);
void brdf_free(Brdf *brdf); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Brdf, brdf_free)

/* 0 where one of the directions lies below the surface; never negative. Is a BrdfFunction, with the
 * BRDF as data. */
void brdf_evaluate(const float light[3], const float view[3], float ret[3], gpointer brdf);

gboolean brdf_is_isotropic(const Brdf *brdf);
/* The description in the file, or NULL; owned by the BRDF. */
const char *brdf_description(const Brdf *brdf);
