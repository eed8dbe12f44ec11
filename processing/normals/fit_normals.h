/*
 * Normals, and heights by integrating them, from how each texel's brightness depends on the light:
 * for materials of one view, or without an MDF, of which there is a PTM or an HSH
 * (`mesorig compress --method ptm | hsh`). If there are several views, it takes the one nearest to
 * the normal. Any thread.
 */
#pragma once

#include "base/work.h"

enum fit_normals_method {
    /* The fit is evaluated under lights that are spread evenly down to the lowest one measured, and
     * the normal b / |b| is that of Lambert's law, min Σ (f(l) − b·l)², over the lights that the
     * surface faces and under which it is neither in shadow nor shines: b·l > 0.15 |b| and |f(l) −
     * b·l| < 0.1 |b|; these lights are found by repeating the fit (Woodham 1980). Median errors on
     * Lambertian surfaces: 0.6° for a PTM, 1.1° for HSH of 4 terms, 0.3° for 9 and 16 terms. With
     * cast shadows or a highlight: 8° for a PTM, which spreads them over all lights, 1° for HSH of
     * 16 terms. */
    FIT_NORMALS_LAMBERT,
    /* PTM only: the light under which the polynomial is greatest (Malzbender et al. 2001), with
     * C0 … C5 as in lobes.h
     *   lx = (C2 C4 − 2 C1 C3) / (4 C0 C1 − C2²), ly = (C2 C3 − 2 C0 C4) / (4 C0 C1 − C2²).
     * Its error is 4° to 8° for Lambert's law, and texels where it is clipped (no maximum, or one
     * outside of the unit disc, as beyond about 45°) are holes. */
    FIT_NORMALS_MAXIMUM,
};

struct fit_normals_result {
    const char *model; /* "ptm" or "hsh" */
    int texels, holes; /* holes: texels without light, or clipped */
    int clipped;       /* FIT_NORMALS_MAXIMUM: texels whose maximum is clipped */
    int shadowed; /* FIT_NORMALS_LAMBERT: texels in shadow, or shining, under more than a quarter of
                     the lights that they face; their normals are less certain */
};

/* Whether a path is one that fit_normals() is for: a model's file, or a
 * session that has no MDF but one of these models. */
gboolean fit_normals_applies(const char *path);

/* path: a session or the model's file. Writes an EXR: a part "normals" with "X", "Y", "Z", all 0
 * where there is none; or with heights a part "height" with "Z" in mm with mean 0, since slopes do
 * not give absolute heights, and "N", 1, or 0 for a hole. Attributes: mesorig.kind, mesorig.model,
 * texel_mm, reference_mm, holes, clipped, shadowed. DATA_ERROR if no texel has a normal, or the
 * model is another. */
gboolean fit_normals(const char *path, const char *file, gboolean heights,
                     enum fit_normals_method method, const struct work *work,
                     struct fit_normals_result *ret, GError **error);
