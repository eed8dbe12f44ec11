#include <math.h>
#include <string.h>

#include "exr/exr.h"
#include "mdf_blocks.h"
#include "mdf_factors.h"
#include "mdf_packed.h"

#define KIND   "mdf-blocks"
#define MOST   255
#define MAX_MM 6e4

static const char *const channels[] = {"B0", "B1", "B2", "B3", "B4", "B5", "B6", "B7", NULL};

void mdf_blocks_free(struct mdf_blocks *blocks) {
    if (!blocks)
        return;
    g_free(blocks->theta_deg);
    g_free(blocks->phi_deg);
    g_free(blocks->blocks);
    g_free(blocks);
}

static guint8 *view_of(const struct mdf_blocks *blocks, int view) {
    return blocks->blocks + (gsize)view * mdf_blocks_bytes(blocks->width, blocks->height);
}

/* Encodes all views of a table. The depths of all views have the same range, min_mm …
 * deepest_mm. */
struct mdf_blocks *mdf_blocks_new(const struct mdf_table *table) {
    const gsize n = (gsize)table->width * (gsize)table->height, views = (gsize)table->n_views;
    struct mdf_blocks *blocks = g_new0(struct mdf_blocks, 1);
    *blocks = (struct mdf_blocks){
        .width = table->width,
        .height = table->height,
        .n_views = table->n_views,
        .texel_mm = table->texel_mm,
        .min_mm = table->deepest_mm,
        .theta_deg = g_memdup2(table->theta_deg, sizeof(float) * views),
        .phi_deg = g_memdup2(table->phi_deg, sizeof(float) * views),
        .blocks = g_new(guint8, views * mdf_blocks_bytes(table->width, table->height)),
    };
    for (gsize i = 0; i < views * n; i++) {
        blocks->min_mm = MIN(blocks->min_mm, (double)table->depth_mm[i]);
        blocks->deepest_mm = MAX(blocks->deepest_mm, (double)table->depth_mm[i]);
    }
    for (int view = 0; view < blocks->n_views; view++)
        mdf_blocks_encode(table->depth_mm + (gsize)view * n, table->width, table->height,
                          blocks->min_mm, blocks->deepest_mm, view_of(blocks, view));
    g_autoptr(MdfTable) is = mdf_blocks_table(blocks);
    blocks->error_mm = mdf_table_difference(table, table->n_views, is, NULL);
    return blocks;
}

struct mdf_table *mdf_blocks_table(const struct mdf_blocks *blocks) {
    const gsize n = (gsize)blocks->width * (gsize)blocks->height;
    struct mdf_table *table = mdf_table_new(blocks->width, blocks->height, blocks->n_views,
                                            blocks->texel_mm, blocks->theta_deg, blocks->phi_deg);
    table->deepest_mm = blocks->deepest_mm;
    for (int view = 0; view < blocks->n_views; view++)
        mdf_blocks_decode(view_of(blocks, view), blocks->width, blocks->height, blocks->min_mm,
                          blocks->deepest_mm, table->depth_mm + (gsize)view * n);
    return table;
}

/* Byte k of block i is pixel i of channel Bk. The first part has the attributes that are the same
 * for all views. */
gboolean mdf_blocks_write(const char *path, const struct mdf_blocks *blocks, GError **error) {
    struct exr_file *file = exr_file_new();
    for (int view = 0; view < blocks->n_views; view++) {
        g_autofree char *name = g_strdup_printf("view_%04d", view);
        struct exr_part *part = exr_part_new(name, mdf_blocks_across(blocks->width),
                                             mdf_blocks_across(blocks->height), channels, EXR_HALF);
        const guint8 *from = view_of(blocks, view);
        for (gsize i = 0; i < mdf_blocks_bytes(blocks->width, blocks->height); i++)
            part->planes[i % MDF_BLOCK_BYTES][i / MDF_BLOCK_BYTES] = from[i];
        exr_set_double(part, "view.theta_deg", blocks->theta_deg[view]);
        exr_set_double(part, "view.phi_deg", blocks->phi_deg[view]);
        if (view == 0) {
            exr_set_string(part, "mesorig.kind", KIND);
            exr_set_int(part, "mesorig.width", blocks->width);
            exr_set_int(part, "mesorig.height", blocks->height);
            exr_set_double(part, "texel_mm", blocks->texel_mm);
            exr_set_double(part, "least_mm", blocks->min_mm);
            exr_set_double(part, "deepest_mm", blocks->deepest_mm);
            exr_set_double(part, "mesorig.error_mm", blocks->error_mm);
        }
        exr_file_add(file, part);
    }
    const gboolean ok = exr_write(path, file, EXR_ZIP, TRUE, error);
    exr_file_free(file);
    return ok;
}

/* Reads the attributes of the first part. Returns a text that says what is wrong with them, or NULL
 * if they are valid. */
static const char *read_head(struct mdf_blocks *blocks, const struct exr_file *file) {
    const struct exr_part *part = file->parts->len > 0 ? file->parts->pdata[0] : NULL;
    const char *kind = NULL;
    if (!part)
        return "it has no parts";
    if (!exr_get_string(part, "mesorig.kind", &kind, NULL) || strcmp(kind, KIND) != 0)
        return "mesorig.kind of the first part is not " KIND;
    if (!exr_get_int(part, "mesorig.width", &blocks->width, NULL) ||
        !exr_get_int(part, "mesorig.height", &blocks->height, NULL) || blocks->width < 1 ||
        blocks->height < 1 || blocks->width > G_MAXINT - MDF_BLOCK_SIDE ||
        blocks->height > G_MAXINT - MDF_BLOCK_SIDE)
        return "mesorig.width or mesorig.height is missing or not a number of texels";
    if (mdf_blocks_across(blocks->width) != part->width ||
        mdf_blocks_across(blocks->height) != part->height)
        return "the size of the first part does not fit mesorig.width and mesorig.height";
    if ((gint64)blocks->width * blocks->height * file->parts->len > MDF_TABLE_MAX_TEXELS)
        return "the views have more texels than an MDF may have";
    if (!exr_get_double(part, "texel_mm", &blocks->texel_mm, NULL) ||
        !(blocks->texel_mm > 0 && blocks->texel_mm < MAX_MM) ||
        !exr_get_double(part, "least_mm", &blocks->min_mm, NULL) ||
        !exr_get_double(part, "deepest_mm", &blocks->deepest_mm, NULL) ||
        !(blocks->min_mm >= 0 && blocks->min_mm <= blocks->deepest_mm) ||
        !(blocks->deepest_mm < MAX_MM) ||
        !exr_get_double(part, "mesorig.error_mm", &blocks->error_mm, NULL) ||
        !(blocks->error_mm >= 0))
        return "texel_mm, least_mm, deepest_mm or mesorig.error_mm is missing or out of range";
    return NULL;
}

/* Reads a view: its direction, and its blocks from the channels B0 … B7. Returns NULL or a text, as
 * read_head() does. */
static const char *read_view(struct mdf_blocks *blocks, int view, const struct exr_part *part) {
    guint8 *to = view_of(blocks, view);
    double theta, phi;
    if (mdf_blocks_across(blocks->width) != part->width ||
        mdf_blocks_across(blocks->height) != part->height)
        return "its size does not fit mesorig.width and mesorig.height of the first part";
    if (!exr_get_double(part, "view.theta_deg", &theta, NULL) ||
        !exr_get_double(part, "view.phi_deg", &phi, NULL) || !(theta >= 0 && theta <= 90) ||
        !(fabs(phi) <= 720))
        return "view.theta_deg is not a number from 0 to 90, or view.phi_deg not from −720 to 720";
    blocks->theta_deg[view] = (float)theta;
    blocks->phi_deg[view] = (float)phi;
    for (gsize c = 0; c < MDF_BLOCK_BYTES; c++) {
        const float *from = exr_part_plane(part, channels[c]);
        if (!from)
            return "a channel from B0 to B7 is missing";
        for (gsize i = 0; i < (gsize)part->width * (gsize)part->height; i++) {
            if (!(from[i] >= 0 && from[i] <= MOST) || from[i] != floorf(from[i]))
                return "a block has a value that is not a whole number from 0 to 255";
            to[i * MDF_BLOCK_BYTES + c] = (guint8)from[i];
        }
    }
    return NULL;
}

struct mdf_blocks *mdf_blocks_read(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    if (!file)
        return NULL;
    g_autoptr(MdfBlocks) blocks = g_new0(struct mdf_blocks, 1);
    const char *what = read_head(blocks, file);
    if (!what) {
        const gsize n = file->parts->len;
        blocks->n_views = (int)n;
        blocks->theta_deg = g_new0(float, n);
        blocks->phi_deg = g_new0(float, n);
        blocks->blocks = g_new0(guint8, n * mdf_blocks_bytes(blocks->width, blocks->height));
    }
    g_autofree char *where = NULL;
    for (int view = 0; !what && view < blocks->n_views; view++) {
        const struct exr_part *part = file->parts->pdata[view];
        what = read_view(blocks, view, part);
        where = what ? g_strdup_printf("part %s: ", part->name) : NULL;
    }
    exr_file_free(file);
    if (!what)
        return g_steal_pointer(&blocks);
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: this is not a valid file of MDF blocks: %s%s; compress the MDF again", path,
                where ? where : "", what);
    return NULL;
}

/* Recognises the kind by the attribute mesorig.kind of the first part. Files of measured views do
 * not have this attribute. */
enum mdf_kind mdf_kind(const char *path) {
    struct exr_file *file = exr_read_headers(path, NULL);
    const struct exr_part *part = file && file->parts->len > 0 ? file->parts->pdata[0] : NULL;
    const char *kind = "";
    if (part)
        exr_get_string(part, "mesorig.kind", &kind, NULL);
    const enum mdf_kind ret = strcmp(kind, MDF_FACTORS_KIND) == 0 ? MDF_KIND_FACTORS
                              : strcmp(kind, KIND) == 0           ? MDF_KIND_BLOCKS
                                                                  : MDF_KIND_VIEWS;
    exr_file_free(file);
    return ret;
}
