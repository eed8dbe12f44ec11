#pragma once

#include "mdf/mdf_table.h"

/* Prints a row for each ring of views of truth: the mean error in mm of the depths at which rays in
 * the directions of its views meet the surface. table is the MDF, and path its file. The ways:
 *   interpolated  the MDF, interpolated between the views
 *   shell         rays are marched through the shell of the MDF
 *   library       as mesorig_material_intersect() does: interpolated where the shell confirms it */
void silhouettes_rays(const char *kind, const struct mdf_table *table, const char *path,
                      const struct mdf_table *truth);
