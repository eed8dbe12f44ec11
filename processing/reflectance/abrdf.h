/*
 * The mean apparent BRDF of a material's texels, and a smooth function of it.
 *
 * B(v, l), which holds n·l, is averaged over the texels of a region without holes, and divided by
 * π cos θ_l: f_r(l, v) = B / (π cos θ_l). Between the measured directions f_r is interpolated as
 * direction_grid.h does, over views and lights each on their own; beyond the lowest measured
 * direction it keeps the value that it has there. It is never negative.
 */
#pragma once

#include "btf/btf_layout.h"
#include "formats/import.h"

#define ABRDF_LEAST_DIRECTIONS 4 /* views, and lights, from which a BRDF can be interpolated */

typedef struct Abrdf Abrdf;

struct abrdf_info {
    int width, height;           /* of the material */
    struct import_region region; /* of which the mean was taken */
    struct direction_list views, lights;
    gint64 holes;      /* values that were left out */
    int filled;        /* pairs of directions without any value, which have the nearest light's */
    double error;      /* of the interpolant at the measured pairs, relative RMS of B */
    double lowest_deg; /* of a measured direction: beyond it nothing is known */
};

/* Reads a session, or what “mesorig compress” made of one. region: all 0: all texels. Needs at most
 * the memory of one view of a session, or of a file's model. Stage "read". DATA_ERROR_INVALID: too
 * few directions, a region that is not in the material, or no value at all. */
Abrdf *abrdf_read(const char *path, const struct import_region *region, const struct work *work,
                  GError **error);
void abrdf_free(Abrdf *abrdf); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Abrdf, abrdf_free)

const struct abrdf_info *abrdf_info(const Abrdf *abrdf);

/* f_r in 1/sr; a BrdfFunction (brdf.h) with the ABRDF as data. Any thread. */
void abrdf_evaluate(const float light[3], const float view[3], float ret[3], gpointer abrdf);
