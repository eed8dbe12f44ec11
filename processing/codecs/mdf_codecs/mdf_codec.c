#include "mdf_codec.h"
#include "base/plural.h"

#include "mdf_blocks.h"
#include "mdf_factors.h"
#include "mdf_packed.h"

#define TERMS 8 /* number of maps without --components and --error */

struct mdf_codec_maps_options {
    int components; /* 0 if not given */
    double error;   /* RMS in texels; 0 if not given */
};

static const struct option mdf_codec_maps_table[] = {
    {.name = "components",
     .type = OPTION_INT,
     .min = 1,
     .max = MDF_FACTORS_MAX_TERMS,
     .offset = offsetof(struct mdf_codec_maps_options, components),
     .help = "number of maps (8 if not given); with --error the maximum"},
    {.name = "error",
     .type = OPTION_SHARE,
     .offset = offsetof(struct mdf_codec_maps_options, error),
     .help = "find the smallest number of maps that reaches this RMS error, in texels"},
    {NULL},
};

/* Adds views at grazing angles, factors all views and writes the maps. --error is in texels.
 * ret->error_mm is over the measured views. */
static gboolean maps_encode(const struct mdf_codec_job *job, struct mdf_codec_result *ret,
                            GError **error) {
    const struct mdf_codec_maps_options *asked = job->options;
    const int most = asked->components > 0 ? asked->components
                     : asked->error > 0    ? MDF_FACTORS_MAX_TERMS
                                           : TERMS;
    const gint64 begun_us = g_get_monotonic_time();
    mdf_table_add_grazing(job->table);
    if (!work_tell(job->work, "maps", 1, 3, begun_us, error))
        return FALSE;
    g_autoptr(MdfFactors) factors =
        mdf_factors_compute(job->table, job->n_measured, most, asked->error * job->table->texel_mm,
                            job->work->cancellable, error);
    if (!factors)
        return FALSE;
    g_autoptr(MdfTable) is = mdf_factors_table(factors);
    ret->n_terms = factors->n_terms;
    ret->n_traced = factors->n_views - factors->n_measured;
    ret->bytes = mdf_factors_bytes(factors);
    ret->error_mm = mdf_table_difference(job->table, job->n_measured, is, &ret->error_99_mm);
    return work_tell(job->work, "maps", 2, 3, begun_us, error) &&
           mdf_factors_write(job->to, factors, error);
}

static char *maps_describe(const struct mdf_codec_job *job, const struct mdf_codec_result *result) {
    return g_strdup_printf("%d maps for %d %s and %d views traced along the surface",
                           result->n_terms, PLURAL(job->n_measured, "view"), result->n_traced);
}

static char *maps_describe_file(const struct exr_file *file) {
    const struct exr_part *maps = exr_file_part(file, "maps");
    const struct exr_part *views = exr_file_part(file, "views");
    double error_mm = 0, texel_mm = 0;
    int measured = 0;
    if (!maps || !views)
        return NULL;
    exr_get_int(maps, "mesorig.measured", &measured, NULL);
    exr_get_double(maps, "mesorig.error_mm", &error_mm, NULL);
    exr_get_double(maps, "texel_mm", &texel_mm, NULL);
    return g_strdup_printf("distances (MDF): %d maps of %d × %d texels of %.3g mm, for %d %s "
                           "measured and %d traced; off by %.3f mm RMS",
                           maps->n_channels, maps->width, maps->height, texel_mm,
                           PLURAL(measured, "view"), views->width - measured, error_mm);
}

/* Values of --quantise for --method=views. */
enum mdf_codec_bits { MDF_CODEC_HALF, MDF_CODEC_8BIT, MDF_CODEC_4BIT };
static const char *const mdf_codec_bits_choices[] = {"half", "8bit", "4bit", NULL};
static const char *const mdf_codec_bits_names[] = {"half floats", "8 bit", "4 bit"};

struct mdf_codec_views_options {
    int quantise; /* enum mdf_codec_bits */
};

static const struct option mdf_codec_views_table[] = {
    {.name = "quantise",
     .type = OPTION_CHOICE,
     .fallback = "4bit",
     .choices = mdf_codec_bits_choices,
     .offset = offsetof(struct mdf_codec_views_options, quantise),
     .help = "format of each view's numbers in the file: half, 8bit or 4bit"},
    {NULL},
};

/* Encodes each view separately: as blocks of 4 bits, or as distances of 8 or 16 bits. The error is
 * that of the values in the file. */
static gboolean views_encode(const struct mdf_codec_job *job, struct mdf_codec_result *ret,
                             GError **error) {
    const struct mdf_codec_views_options *asked = job->options;
    const struct mdf_table *table = job->table;
    g_autoptr(MdfTable) is = NULL;
    gboolean ok;
    if (asked->quantise == MDF_CODEC_4BIT) {
        g_autoptr(MdfBlocks) blocks = mdf_blocks_new(table);
        ret->bytes = (gint64)mdf_blocks_bytes(table->width, table->height) * table->n_views;
        ok = mdf_blocks_write(job->to, blocks, error);
        is = mdf_blocks_table(blocks);
    } else {
        ok = mdf_pack(job->from, job->to,
                      asked->quantise == MDF_CODEC_HALF ? MDF_PACKED_HALF : MDF_PACKED_8BIT,
                      &ret->bytes, error);
        is = ok ? mdf_table_read(job->to, error) : NULL;
    }
    if (is)
        ret->error_mm = mdf_table_difference(table, job->n_measured, is, &ret->error_99_mm);
    return ok && is != NULL;
}

static char *views_describe(const struct mdf_codec_job *job,
                            const struct mdf_codec_result *result G_GNUC_UNUSED) {
    const struct mdf_codec_views_options *asked = job->options;
    return g_strdup_printf("%d views in %s", job->n_measured,
                           mdf_codec_bits_names[asked->quantise]);
}

/* Gives the size of the views in texels. A pixel of the file is not a texel but a block of
 * texels. */
static char *blocks_describe_file(const struct exr_file *file) {
    const struct exr_part *first = file->parts->pdata[0];
    double error_mm = 0, texel_mm = 0;
    int width = 0, height = 0;
    exr_get_int(first, "mesorig.width", &width, NULL);
    exr_get_int(first, "mesorig.height", &height, NULL);
    exr_get_double(first, "mesorig.error_mm", &error_mm, NULL);
    exr_get_double(first, "texel_mm", &texel_mm, NULL);
    return g_strdup_printf("distances (MDF): %u views of %d × %d texels of %.3g mm in 4 bit; off "
                           "by %.3f mm RMS",
                           file->parts->len, width, height, texel_mm, error_mm);
}

static const struct mdf_codec mdf_codec_maps = {
    .name = "mdf",
    .help = "the distances (MDF) as a few maps in 8 bit that all views share",
    .kind = MDF_FACTORS_KIND,
    .options = mdf_codec_maps_table,
    .options_size = sizeof(struct mdf_codec_maps_options),
    .encode = maps_encode,
    .describe = maps_describe,
    .describe_file = maps_describe_file,
};

static const struct mdf_codec mdf_codec_views = {
    .name = "mdf-views",
    .help = "the distances (MDF), each view separately (Wang et al. 2005)",
    .kind = "mdf-blocks",
    .options = mdf_codec_views_table,
    .options_size = sizeof(struct mdf_codec_views_options),
    .encode = views_encode,
    .describe = views_describe,
    .describe_file = blocks_describe_file,
};

const struct mdf_codec *const mdf_codecs[] = {&mdf_codec_maps, &mdf_codec_views, NULL};
