/*
 * Analytic models of each texel (lobes.h) on the graphics card. Their values are the layers of one
 * array texture of halves, as they are in the file.
 *
 * Reflectance fields and polynomials belong to one view each: those of the up to four measured
 * views around v are evaluated and interpolated bilinearly in θ and φ (Meseth et al. 2003 §5.4;
 * direction_table.h takes the place of its cube maps). A pole is the mean of its ring.
 *
 * Ward and Ashikhmin–Shirley: the tangent's azimuth is that of the surface's anisotropy, the normal
 * is the perturbed one, so that METHOD_ROTATION_EXACT is exactly the model that was fitted, and the
 * other rotations are those that Kang & Cho 2011 compares with it.
 *
 * Parameters cannot be mixed: four texels are evaluated, in each of two mip levels, and their
 * values are mixed. Mip levels are models of their own (lobes_levels.h), which a file may lack. An
 * even sky is 16 lights that see equal areas of it, evaluated beforehand for each measured view.
 */
#pragma once

#include "lobes/lobes_levels.h"
#include "method.h"

typedef struct LobesView LobesView; /* belongs to the thread of the GL context */

/* levels: a model and its n − 1 mip levels. Copies what it needs. */
LobesView *lobes_view_new(struct lobes *const *levels, int n, GError **error);
void lobes_view_free(LobesView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LobesView, lobes_view_free)

/* In the order of enum lobes_model; the material of each is a LobesView of its model. */
extern const struct method methods_lobes[LOBES_MODELS];
