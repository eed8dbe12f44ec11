/* The MDF (mesostructure distance function) of a material in any form that a file can have. The MDF
 * is in memory, and can be uploaded to a graphics card or queried. */
#pragma once

#include "mdf_blocks.h"
#include "mdf_factors.h"
#include "mdf_packed.h"

/* The form of the MDF is factors if `factors` is set, blocks if only `blocks` and `table` are set,
 * and a table of views if only `table` is set. */
struct mdf_source {
    const struct mdf_table *table;     /* views; with blocks: the views decoded from them */
    const struct mdf_blocks *blocks;   /* the views of table as blocks; table is then also set */
    const struct mdf_factors *factors; /* weights and maps; table may be NULL */
};

/* Reads a file of any form. Returns NULL with an error if the file is missing or damaged. Grazing
 * views are added to tables (mdf_table_add_grazing()). Any thread. */
struct mdf_source *mdf_source_read(const char *path, GError **error);
/* An MDF and a material can be drawn together only if their tiles have the same size. Returns TRUE
 * if the sizes in mm are equal within 1 %. Returns FALSE with MDF_TABLE_ERROR_FORMAT if they
 * differ; the message names both sizes. Returns TRUE if a file cannot be read or has no size,
 * because the function that reads the file then gives the error.
 *
 * `mdf` is a file of any form. `material` is a session, its products/btf or a compressed file. Only
 * headers are read. Any thread. */
gboolean mdf_source_fits(const char *mdf, const char *material, GError **error);
void mdf_source_free(struct mdf_source *source); /* also frees the members; NULL is ignored */
