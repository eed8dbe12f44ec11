/* The table of pictures and their poses. import_poses.h says what its columns mean. Any thread. */
#pragma once

#include "base/text_table.h"

/* Reads a table. Returns NULL with DATA_ERROR if the table cannot be read, has a column of another
 * name, lacks file or camera, or has neither lamp nor laser. */
TextTable *poses_table_read(const char *path, GError **error);
