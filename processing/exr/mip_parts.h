/* Mip levels of a material in one EXR: the parts of level n, n > 0, are all named "mip<n>.", and
 * then as those of level 0. */
#pragma once

#include "exr.h"

/* Moves all parts of one level, which is freed, to the end of the file. */
void mip_parts_add(struct exr_file *file, struct exr_file *level, int number);

/* How many levels there are; part: one that each of them has. Headers suffice. 0 with an error that
 * names the path if a level lacks it that has other parts, or that others follow. */
int mip_parts_count(const struct exr_file *file, const char *part, const char *path,
                    GError **error);

/* Moves the parts of a level out of the file, under the names they have at level 0. */
struct exr_file *mip_parts_take(struct exr_file *file, int number);
