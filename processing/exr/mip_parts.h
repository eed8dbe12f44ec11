/* Mip levels of a material in one EXR. The parts of level n > 0 have the names of the parts of
 * level 0 with the prefix "mip<n>.". */
#pragma once

#include "exr.h"

/* Moves all parts of `level` to the end of the file as the level with this number, and adds the
 * prefix of the level to their names. Frees `level`. */
void mip_parts_add(struct exr_file *file, struct exr_file *level, int number);

/* Returns the number of levels. part is the name of a part that each level has. The file may have
 * been read with its headers only. Returns 0 with an error that names the path if a level is
 * missing, or if a level has other parts but lacks this part. */
int mip_parts_count(const struct exr_file *file, const char *part, const char *path,
                    GError **error);

/* Moves the parts of a level out of the file. The returned parts have the names of level 0; there
 * are none if the file lacks the level. exr_file_free() */
struct exr_file *mip_parts_take(struct exr_file *file, int number);
