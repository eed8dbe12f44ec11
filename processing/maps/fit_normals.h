/* Normals, and heights by integrating them, from the dependence of each texel's brightness on the
 * light. For materials of one view, or without an MDF, of which there is a PTM or an HSH (`mesorig
 * compress --method ptm | hsh`). If there are several views, the view nearest to the normal is
 * used. Any thread. */
#pragma once

#include "base/work.h"

enum fit_normals_method {
    /* The fit is evaluated under lights that are spread evenly down to the lowest measured one. The
     * normal b / |b| follows from Lambert's law, min Σ (f(l) − b·l)². The sum is over the lights
     * that the surface faces and under which it is neither in shadow nor in a highlight: b·l > 0.15
     * |b| and |f(l) − b·l| < 0.1 |b|. These lights are found by repeating the fit (Woodham 1980).
     * Median errors on Lambertian surfaces are 0.6° for a PTM, 1.1° for HSH of 4 terms, and 0.3°
     * for 9 and 16 terms. With cast shadows or a highlight they are 8° for a PTM, which spreads
     * shadows and highlights over all lights, and 1° for HSH of 16 terms. */
    FIT_NORMALS_LAMBERT,
    /* For PTM only: the light under which the polynomial has its maximum (Malzbender et al. 2001),
     * with C0 … C5 as in lobes.h
     *   lx = (C2 C4 − 2 C1 C3) / (4 C0 C1 − C2²), ly = (C2 C3 − 2 C0 C4) / (4 C0 C1 − C2²).
     * Its error is 4° to 8° for Lambert's law. Texels without a maximum, or with one outside of the
     * unit disc, as beyond about 45°, are clipped and count as holes. */
    FIT_NORMALS_MAXIMUM,
};

struct fit_normals_result {
    const char *model; /* "ptm" or "hsh" */
    int texels, holes; /* holes is the number of texels without light, or with a clipped maximum */
    int clipped;       /* for FIT_NORMALS_MAXIMUM the number of texels whose maximum is clipped */
    /* for FIT_NORMALS_LAMBERT the number of texels in shadow or in a highlight under more than a
     * quarter of the lights that they face; their normals are less certain */
    int shadowed;
};

/* Returns whether fit_normals() can be used for a path: a file of such a model, or a session that
 * has such a model but no MDF. */
gboolean fit_normals_applies(const char *path);

/* path is a session or the file of a model. Writes an EXR with a part "normals" with "X", "Y", "Z",
 * all 0 for a texel without a normal. With heights, it instead has a part "height" with "Z" in mm
 * and "N", which is 1, or 0 for a hole. Heights have mean 0, because slopes do not give absolute
 * heights. The attributes are mesorig.kind, mesorig.model, texel_mm, reference_mm, holes, clipped
 * and shadowed. The error is in DATA_ERROR if no texel has a normal, or if the file is of another
 * model. */
gboolean fit_normals(const char *path, const char *file, gboolean heights,
                     enum fit_normals_method method, const struct work *work,
                     struct fit_normals_result *ret, GError **error);
