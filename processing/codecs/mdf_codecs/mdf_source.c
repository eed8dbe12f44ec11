#include "mdf_source.h"

#include "exr/exr.h"
#include "session/session.h"

struct mdf_source *mdf_source_read(const char *path, GError **error) {
    if (!session_check_product(path, error))
        return NULL;
    if (!g_file_test(path, G_FILE_TEST_EXISTS)) {
        g_set_error(error, EXR_ERROR, EXR_ERROR_IO,
                    "%s: there is no such file of distances (MDF), which silhouettes need; "
                    "“mesorig process” makes it from a session with laser sweeps",
                    path);
        return NULL;
    }
    const enum mdf_kind kind = mdf_kind(path);
    struct mdf_source *source = g_new0(struct mdf_source, 1);
    struct mdf_table *table = NULL;
    if (kind == MDF_KIND_FACTORS)
        source->factors = mdf_factors_read(path, error);
    else if (kind != MDF_KIND_BLOCKS)
        table = mdf_table_read(path, error);
    else if ((source->blocks = mdf_blocks_read(path, error)) != NULL)
        table = mdf_blocks_table(source->blocks);
    if (table != NULL)
        mdf_table_add_grazing(table);
    source->table = table;
    if (table == NULL && source->factors == NULL)
        g_clear_pointer(&source, mdf_source_free);
    return source;
}

void mdf_source_free(struct mdf_source *source) {
    if (source == NULL)
        return;
    mdf_table_free((struct mdf_table *)source->table);
    mdf_factors_free((struct mdf_factors *)source->factors);
    mdf_blocks_free((struct mdf_blocks *)source->blocks);
    g_free(source);
}
