/* The mean apparent BRDF of a material's texels, and a smooth function that interpolates it.
 *
 * B(v, l), which contains n·l, is averaged over the texels of a region. Holes are left out. The
 * mean B is divided by π cos θ_l, with cos θ_l at least 0.05: f_r(l, v) = B / (π cos θ_l). Between
 * the measured directions f_r is interpolated as by direction_grid.h, separately over views and
 * lights. Beyond the lowest measured direction f_r keeps the value of that direction. f_r is never
 * negative. */
#pragma once

#include "btf/btf_layout.h"
#include "formats/import.h"

/* minimum number of views, and of lights, from which a BRDF can be interpolated */
#define ABRDF_MIN_DIRECTIONS 4

typedef struct Abrdf Abrdf;

struct abrdf_info {
    int width, height;           /* texels of the material */
    struct import_region region; /* region over which the mean was taken */
    struct direction_list views, lights;
    gint64 holes; /* number of values that were left out */
    /* number of pairs of a view and a light without any value; they get the value of the nearest
     * light in the same view */
    int filled;
    /* RMS error of the interpolated B at the measured pairs of directions, relative to the RMS of
     * B */
    double error;
    /* angle of the lowest view from the normal, or of the lowest light if that is smaller */
    double lowest_deg;
};

/* Reads a session, or a file that “mesorig compress” made from a session. A region of zeros means
 * all texels. Needs at most the memory of one view of a session, or of a file's model. The progress
 * stage is "read". The error is DATA_ERROR_INVALID if there are too few directions, if the region
 * is not in the material, or if a view has no value in the region. */
Abrdf *abrdf_read(const char *path, const struct import_region *region, const struct work *work,
                  GError **error);
void abrdf_free(Abrdf *abrdf); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Abrdf, abrdf_free)

const struct abrdf_info *abrdf_info(const Abrdf *abrdf);

/* Evaluates f_r in 1/sr. This is a BrdfFunction (brdf.h) with the ABRDF as data. Any thread. */
void abrdf_evaluate(const float light[3], const float view[3], float ret[3], gpointer abrdf);
/* The same as a BrdfBothFunction. */
void abrdf_evaluate_both(const float a[3], const float b[3], float ret[2][3], gpointer abrdf);
