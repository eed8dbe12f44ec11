/* Finds normals, and heights by integrating the normals, from the dependence of each texel's
 * brightness on the light. The material needs a PTM or an HSH (`mesorig compress --method ptm |
 * hsh`), but no MDF. If there are several views, the view nearest to the normal is used. Any
 * thread. */
#pragma once

#include "base/work.h"

enum fit_normals_method {
    /* The normal b / |b| by Lambert's law: b minimises Σ (f(l) − b·l)². f(l) is the PTM or HSH
     * under the light l. The lights l are spread evenly down to the lowest measured one. Only the
     * lights count that the surface faces (b·l > 0.15 |b|), and under which there is no shadow and
     * no highlight (|f(l) − b·l| < 0.1 |b|). These lights are found by repeating the fit (Woodham
     * 1980).
     *
     * Median errors on Lambertian surfaces are 0.6° for a PTM, 1.1° for HSH of 4 terms, and 0.3°
     * for 9 and 16 terms. With cast shadows or a highlight the errors are 8° for a PTM and 1° for
     * HSH of 16 terms. The errors of a PTM are large, because a PTM spreads shadows and highlights
     * over all lights. */
    FIT_NORMALS_LAMBERT,
    /* For PTM only: the light under which the polynomial has its maximum (Malzbender et al. 2001),
     * with C0 … C5 as in lobes.h
     *   lx = (C2 C4 − 2 C1 C3) / (4 C0 C1 − C2²), ly = (C2 C3 − 2 C0 C4) / (4 C0 C1 − C2²).
     * On surfaces that follow Lambert's law the error is 4° to 8°. A texel is clipped and counts as
     * a hole if there is no maximum in the unit disc, which is usual for normals beyond about
     * 45°. */
    FIT_NORMALS_MAXIMUM,
};

struct fit_normals_result {
    const char *model; /* "ptm" or "hsh" */
    /* texels: number of all texels
     * holes: number of texels without a normal */
    int texels, holes;
    int clipped; /* number of clipped texels for FIT_NORMALS_MAXIMUM, otherwise 0 */
    /* For FIT_NORMALS_LAMBERT, the number of texels with less certain normals. Such a texel is in
     * shadow or in a highlight under more than a quarter of the lights that it faces. */
    int shadowed;
};

/* Returns whether fit_normals() can be used for a path: any file, or a session that has a PTM or an
 * HSH but no MDF. */
gboolean fit_normals_applies(const char *path);

/* Writes normals or heights as an EXR. path is a session or the file of a model. Of a session,
 * products/ptm.exr is used, or products/hsh.exr if there is no PTM.
 *
 * If heights is FALSE, the EXR has a part "normals" with the channels "X", "Y", "Z", all 0 for a
 * texel without a normal. If heights is TRUE, it has a part "height" with the channels "Z", in mm,
 * and "N", which is 1, or 0 for a hole. Heights have mean 0, because slopes do not give absolute
 * heights. The attributes are mesorig.kind, mesorig.model, texel_mm, reference_mm, holes, clipped
 * and shadowed.
 *
 * The progress stage is "normals". The error is in DATA_ERROR if no texel has a normal, if the file
 * is of another model, or if FIT_NORMALS_MAXIMUM is asked of an HSH. */
gboolean fit_normals(const char *path, const char *file, gboolean heights,
                     enum fit_normals_method method, const struct work *work,
                     struct fit_normals_result *ret, GError **error);
