#include "mdf_source.h"

#include "btf/btf_matrix.h"
#include "exr/exr.h"
#include "mdf/mdf_table.h"
#include "session/session.h"

#include <gio/gio.h>
#include <math.h>

#define SIZE_TOLERANCE 0.01 /* relative */

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

/* Gives the size of the tile of a compressed material or of an MDF. In most files, the part with
 * texel_mm has a pixel for each texel. In a file of MDF blocks, attributes give the number of
 * texels. In a file of eigen-maps, other parts have the pixels. */
static gboolean file_size(const char *path, double ret_mm[2]) {
    g_autoptr(ExrFile) file = exr_read_headers(path, NULL);
    const struct exr_part *map = file ? exr_file_part(file, "E000_light_0000") : NULL;
    for (guint i = 0; file && i < file->parts->len; i++) {
        const struct exr_part *part = file->parts->pdata[i];
        double texel_mm;
        int width = (map ? map : part)->width, height = (map ? map : part)->height;
        if (!exr_get_double(part, "texel_mm", &texel_mm, NULL))
            continue;
        exr_get_int(part, "mesorig.width", &width, NULL);
        exr_get_int(part, "mesorig.height", &height, NULL);
        ret_mm[0] = width * texel_mm;
        ret_mm[1] = height * texel_mm;
        return TRUE;
    }
    return FALSE;
}

static gboolean folder_size(const char *path, double ret_mm[2]) {
    g_autofree char *directory = btf_matrix_session(path);
    g_autoptr(Session) session = session_open(directory, SESSION_READ, NULL);
    struct session_grid grid;
    if (!session || !session_grid(session, &grid, NULL))
        return FALSE;
    ret_mm[0] = grid.width_mm;
    ret_mm[1] = grid.height_mm;
    return TRUE;
}

gboolean mdf_source_fits(const char *mdf, const char *material, GError **error) {
    double is[2], needed[2];
    if (!file_size(mdf, is) ||
        !(g_file_test(material, G_FILE_TEST_IS_DIR) ? folder_size(material, needed)
                                                    : file_size(material, needed)))
        return TRUE;
    if (fabs(is[0] / needed[0] - 1) <= SIZE_TOLERANCE &&
        fabs(is[1] / needed[1] - 1) <= SIZE_TOLERANCE)
        return TRUE;
    g_set_error(error, MDF_TABLE_ERROR, MDF_TABLE_ERROR_FORMAT,
                "%s: the distances (MDF) are those of a sample of %.4g × %.4g mm, but the material "
                "%s has %.4g × %.4g mm; give the MDF of the same session",
                mdf, is[0], is[1], material, needed[0], needed[1]);
    return FALSE;
}

void mdf_source_free(struct mdf_source *source) {
    if (source == NULL)
        return;
    mdf_table_free((struct mdf_table *)source->table);
    mdf_factors_free((struct mdf_factors *)source->factors);
    mdf_blocks_free((struct mdf_blocks *)source->blocks);
    g_free(source);
}
