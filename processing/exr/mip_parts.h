/* Mip levels of a material in one EXR: the parts of level n > 0 have the names of those of level
 * 0 with the prefix "mip<n>.". */
#pragma once

#include "exr.h"

/* Moves all parts of a level to the end of the file; frees the level. */
void mip_parts_add(struct exr_file *file, struct exr_file *level, int number);

/* Returns the number of levels. part: the name of a part that each level has. file may hold headers
 * alone. 0 with an error that names the path: a level before the last one, or a level that has
 * other parts, lacks this part. */
int mip_parts_count(const struct exr_file *file, const char *part, const char *path,
                    GError **error);

/* Moves the parts of a level out of the file, with their names at level 0. */
struct exr_file *mip_parts_take(struct exr_file *file, int number);
