/*
 * Hemispherical harmonics (hsh.h) on the graphics card: the coefficients of each view are the
 * layers of one array texture of halves, as they are in the file. Those of the up to four measured
 * views around v are evaluated and interpolated bilinearly in θ and φ, as ptm's are (lobes_view.h),
 * and negative values are black.
 *
 * Mip levels are made on the card: f is linear in its coefficients, so that their mean is the fit
 * of the mean. Under an even sky all functions of the basis but the first integrate to 0, so that
 * (1/π) ∫ f dω = √(2/π) c_0.
 */
#pragma once

#include "hsh/hsh.h"
#include "method.h"

typedef struct HshView HshView; /* belongs to the thread of the GL context */

HshView *hsh_view_new(const struct hsh *hsh, GError **error); /* copies what it needs */
void hsh_view_free(HshView *view);                            /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(HshView, hsh_view_free)

extern const struct method method_hsh; /* its material is a HshView */
