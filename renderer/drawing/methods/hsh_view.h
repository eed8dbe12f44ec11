/*
 * Hemispherical harmonics (hsh.h) on the graphics card. The coefficients of each view are the
 * layers of one array texture of half floats, in the order of the file. Up to four measured views
 * around v are evaluated, and the results are interpolated bilinearly in θ and φ, as for ptm
 * (lobes_view.h). Negative values become black.
 *
 * Mip levels are made on the card. The reflectance f is linear in its coefficients c_i, so the mean
 * of the coefficients is the fit of the mean. Under an even sky, all basis functions except the
 * first integrate to 0, so (1/π) ∫ f dω = √(2/π) c_0.
 */
#pragma once

#include "codecs/hsh/hsh.h"
#include "method.h"

typedef struct HshView HshView; /* belongs to the thread of the GL context */

HshView *hsh_view_new(const struct hsh *hsh, GError **error); /* copies everything that it needs */
void hsh_view_free(HshView *view);                            /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(HshView, hsh_view_free)

extern const struct method method_hsh; /* its material is a HshView */
