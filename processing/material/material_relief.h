/* The relief of a material, to be queried on the CPU. Any thread may call the functions. */
#pragma once

#include "base/vec.h"
#include "mdf/shell_ray.h"

struct material_relief;

/* Reads an MDF, measured or compressed. Returns NULL with an error if the file cannot be read or
 * its views cannot be interpolated. */
struct material_relief *material_relief_read(const char *path, GError **error);
void material_relief_free(struct material_relief *relief); /* NULL is ignored */

double material_relief_deepest_mm(const struct material_relief *relief);

/* Gives the size of a tile of the material in mm. */
void material_relief_size_mm(const struct material_relief *relief, double *ret_width,
                             double *ret_height);

/* Returns the shell of the MDF, which belongs to the relief. The first call makes it, in about a
 * second for 60 views of 64² texels. */
const struct mdf_shell *material_relief_shell(const struct material_relief *relief);

/* Returns the depth in mm below the reference plane at which a ray meets the surface of the flat
 * sample. The ray enters the reference plane at (u, v), in tiles. view is the unit vector from this
 * point to the eye, above the horizon. ret_normal receives the unit normal of the surface, on the
 * side of the eye, with y upwards. */
double material_relief_depth(const struct material_relief *relief, double u, double v,
                             struct vec3 view, struct vec3 *ret_normal);
