/*
 * Analytic models of each texel (lobes.h) on the graphics card. Their values are the layers of one
 * array texture of half floats, in the order of the file.
 *
 * A reflectance field or polynomial belongs to one view. The models of up to four measured views
 * around v are evaluated, and the results are interpolated bilinearly in θ and φ (Meseth et al.
 * 2003 §5.4, with direction_table.h instead of the paper's cube maps). If the pole was not
 * measured, the mean of the topmost ring stands for it.
 *
 * In the models of Ward and of Ashikhmin and Shirley, the tangent has the azimuth of the surface's
 * anisotropy, and the normal is the texel's own (lobes.h). With these two models,
 * METHOD_ROTATION_EXACT draws exactly the fitted model. The other rotations are the approximations
 * that Kang & Cho 2011 compare with the exact one.
 *
 * Parameters of different texels cannot be averaged. Instead, four texels are evaluated in each of
 * two mip levels, and the results are interpolated. Mip levels have separate models
 * (lobes_levels.h). A file may lack mip levels.
 *
 * An even sky is replaced by 16 lights, each of which stands for the same solid angle. The sum of
 * the reflectances under these lights is computed beforehand for each texel and measured view.
 */
#pragma once

#include "codecs/lobes/lobes_levels.h"
#include "method.h"

typedef struct LobesView LobesView; /* belongs to the thread of the GL context */

/* Makes the view. levels is a model and its n − 1 mip levels. Copies everything that it needs. */
LobesView *lobes_view_new(struct lobes *const *levels, int n, GError **error);
void lobes_view_free(LobesView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LobesView, lobes_view_free)

/* The methods in the order of enum lobes_model. The material of each is a LobesView of its
 * model. */
extern const struct method methods_lobes[LOBES_MODELS];
