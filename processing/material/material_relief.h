/* The distances (MDF) of a material, to be queried on the CPU. Any thread. */
#pragma once

#include <glib.h>

struct material_relief;

/* Reads an MDF in any form. Returns NULL with an error if it cannot be used. */
struct material_relief *material_relief_read(const char *path, GError **error);
void material_relief_free(struct material_relief *relief); /* NULL is ignored */

double material_relief_deepest_mm(const struct material_relief *relief);

/* Returns the depth in mm below the reference plane at which a ray meets the surface. The ray
 * enters the reference plane at (u, v), in tiles. view is the unit vector from there to the eye,
 * above the horizon. ret_slope gives the slopes ∂depth/∂x, ∂depth/∂y (y upwards) in the plane where
 * the ray enters. */
double material_relief_depth(const struct material_relief *relief, double u, double v,
                             const double view[3], double ret_slope[2]);

/* Gives the size of a tile. */
void material_relief_size_mm(const struct material_relief *relief, double *ret_width,
                             double *ret_height);
