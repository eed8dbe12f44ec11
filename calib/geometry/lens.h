/* This header has the lens models and their names, for C and C++. */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* How a lens maps a direction to the picture, in OpenCV's conventions. The centre of the top
 * left pixel is (0, 0), with x to the right and y down. For a point (x, y, z) in camera
 * coordinates (z forward), (x', y') = (x, y) / z, r² = x'² + y'², and θ is the angle from the
 * optical axis. The model gives x'' and y'', and then x_px = fx x'' + cx and y_px = fy y'' + cy.
 *   polynomial  x'' = x' (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x'y' + p2 (r² + 2x'²)  (Brown 1966)
 *   rational    as above, with the factor (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
 *   fisheye     x'' = x'/r θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)  (Kannala & Brandt 2006)
 * y'' is computed in the same way. Parameters that a model does not have are 0. */
enum rig_lens {
    RIG_LENS_POLYNOMIAL, /* the numbers are part of the file format */
    RIG_LENS_RATIONAL,
    RIG_LENS_FISHEYE,
    RIG_LENSES,
};
/* Returns "polynomial", "rational" or "fisheye". */
const char *rig_lens_name(enum rig_lens lens);
/* Returns FALSE if no lens model has that name. */
gboolean rig_lens_by_name(const char *name, enum rig_lens *ret);

G_END_DECLS
