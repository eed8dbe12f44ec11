/* The MDF (mesostructure distance function) of a material in any form that a file can have, read
 * and ready to be uploaded or queried. */
#pragma once

#include "mdf_blocks.h"
#include "mdf_factors.h"
#include "mdf_packed.h"

/* The form is that of the most specific member that is set: factors, else blocks, else table. */
struct mdf_source {
    const struct mdf_table *table;     /* views; with blocks: the views decoded from them */
    const struct mdf_blocks *blocks;   /* the same views compressed; needs table too */
    const struct mdf_factors *factors; /* weights and maps; needs no table */
};

/* If the file is missing or damaged, the error says so. Tables get grazing views
 * (mdf_table_add_grazing()). Any thread. */
struct mdf_source *mdf_source_read(const char *path, GError **error);
void mdf_source_free(struct mdf_source *source); /* frees its members too; NULL is ignored */
