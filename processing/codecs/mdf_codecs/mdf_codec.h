/* The contract of a codec of mesostructure distances (MDF), and the table of all such codecs.
 * codec/codec.h is the corresponding contract for BTFs. */
#pragma once

#include "base/options.h"
#include "base/work.h"
#include "exr/exr.h"
#include "mdf/mdf_table.h"

struct mdf_codec_job {
    const char *from; /* the file from which table was read */
    const char *to;   /* the file to write */
    /* the views of `from`; encode() may add views after the first n_measured */
    struct mdf_table *table;
    int n_measured;
    gconstpointer options; /* the struct that the codec's option table describes */
    const struct work *work;
};

struct mdf_codec_result {
    /* n_terms: number of maps, 0 if the codec makes no maps
     * n_traced: number of views that were added and traced along the surface, 0 without maps */
    int n_terms, n_traced;
    gint64 bytes;       /* bytes in the memory of a renderer */
    double error_mm;    /* RMS error over the visible texels of the measured views */
    double error_99_mm; /* 99th percentile of the absolute error over the same texels */
};

struct mdf_codec {
    const char *name;             /* argument of --method */
    const char *help;             /* one sentence without a full stop that describes the method */
    const char *kind;             /* mesorig.kind of files that describe_file() takes */
    const struct option *options; /* as in struct codec */
    gsize options_size;
    /* Writes the file. All members of the result are 0 when it is called. */
    gboolean (*encode)(const struct mdf_codec_job *job, struct mdf_codec_result *ret,
                       GError **error);
    /* Describes the result of encode(), as in "81 views in 4 bit". g_free() */
    char *(*describe)(const struct mdf_codec_job *job, const struct mdf_codec_result *result);
    /* Returns one line about a file of which only the headers were read, or NULL if parts are
     * missing. g_free() */
    char *(*describe_file)(const struct exr_file *file);
};

extern const struct mdf_codec *const mdf_codecs[]; /* NULL-ended */
