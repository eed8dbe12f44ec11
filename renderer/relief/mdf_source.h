/* An MDF of any of the kinds that mdf_kind() tells, read and made ready to be put on the card. */
#pragma once

#include "mdf_codecs/mdf_blocks.h"
#include "mdf_codecs/mdf_factors.h"
#include "mdf_codecs/mdf_packed.h"

struct mdf_source {
    enum mdf_kind kind;
    struct mdf_table *table;     /* of views and of blocks */
    struct mdf_factors *factors; /* of factors alone */
    struct mdf_blocks *blocks;   /* of blocks alone */
};

/* Any thread; with a sentence if there is none. */
struct mdf_source *mdf_source_read(const char *path, GError **error);
void mdf_source_free(struct mdf_source *source); /* NULL is ignored */
