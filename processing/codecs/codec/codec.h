/*
 * The contract of a codec: one way to store a BTF in less space. Each codec fills one constant
 * struct codec in its own folder; the array codecs[] (codecs/codecs.h) lists them all. The command
 * line, material_open() and the comparisons know codecs by that array alone.
 *
 * A model is what a codec makes of a BTF, in memory. The functions that take a const model may be
 * called from several threads at once.
 */
#pragma once

#include "base/options.h"
#include "btf/btf_matrix.h"
#include "exr/checkpoint.h"
#include "exr/exr.h"

/* Properties of every material. Arrays belong to the material or its model. */
struct material_info {
    char *label; /* distinguishes it from others: the file's or the session's name, or a method's */
    const char *kind; /* "btf", or the name of its codec */
    const struct btf_layout *layout;
    gint64 bytes; /* as a renderer holds it; the BTF in halves */
};

/* What encode() is given. */
struct codec_job {
    const struct btf_matrix *btf; /* with values in memory unless memory > 0 */
    gconstpointer options;        /* the struct that the codec's option table describes */
    gint64 memory;                /* bytes for values and work; 0: any (only of bounded codecs) */
    const struct work *work;      /* never NULL */
    Checkpoint *checkpoint;       /* where work is kept; NULL: nowhere. Only resumable codecs */
};

/* What encode() found. The caller sets all to 0 and frees levels. */
struct codec_result {
    GPtrArray *levels; /* models, with a free function: the BTF's own, then its mip levels */
    int clusters, components, grid; /* the numbers used; components: terms, lobes, … */
    double error; /* ‖A − Â‖_F / ‖A‖_F of R, G, B, of the values read back from the file */
    double exact_error;     /* the same before numbers were rounded for the file */
    double luminance_error; /* mean |Y − Ŷ|; −1: the codec does not know it */
    gboolean packed;        /* its size is that of the file, not that in a renderer */
};

struct codec;

/* One point of a curve of error against size. */
struct codec_point {
    const char *series; /* a codec may have several */
    char *label;  /* distinguishes the sizes of a codec, as in "8 clusters"; the callee takes it */
    gint64 bytes; /* as a renderer holds it */
    double error; /* relative RMS; −1: the callee measures model */
    gconstpointer model; /* needed for that alone */
};
typedef gboolean (*CodecPoint)(const struct codec *codec, const struct codec_point *point,
                               gpointer data, GError **error);

/* Two directions between the measured ones, prepared once for all texels. */
struct codec_query {
    float view[3], light[3]; /* unit vectors above the horizon */
    /* The views around one and the lights around the other, and their weights, which are above 0;
     * those of views sum to 1, those of lights to directions_fade(). */
    int n_views, n_lights;
    const int *views, *lights;
    const float *view_weights, *light_weights;
};

#define CODEC_MAX_TEXELS 512
/* Texels of a model, and the weight of each in the sum that is asked for. */
struct codec_texels {
    int n; /* at most CODEC_MAX_TEXELS */
    const int *index;
    const float *share;
};

struct codec {
    const char *name;  /* of --method, and mesorig.kind of its files */
    const char *title; /* for people, as in "local PCA" */
    const char *help;  /* what it is, one sentence without a full stop */
    int variant;       /* for codecs that share their functions */

    /* The options that --method=name takes, besides --memory and -o: their names are those of the
     * command line's options, without "--". Options that are not given take their fallback, or 0 if
     * they have none. */
    const struct option *options;
    gsize options_size;
    /* Returns how options contradict each other, as a sentence without a full stop; NULL: they do
     * not. May be NULL. */
    const char *(*check)(gconstpointer options, gint64 memory);

    gboolean bounded;      /* keeps to --memory */
    gboolean resumable;    /* keeps what is done in a checkpoint */
    gboolean from_process; /* products/NAME.exr is written by process, so compress needs -o */

    gboolean (*encode)(const struct codec *codec, const struct codec_job *job,
                       struct codec_result *ret, GError **error);
    /* Describes what encode() made, as in "3 clusters of 2 components". g_free() */
    char *(*describe)(const struct codec *codec, const struct codec_result *result);
    gboolean (*write)(const char *path, gpointer const *levels, int n_levels, GError **error);

    /* Reads the model of level 0. The caller has checked that mesorig.kind is the codec's name. */
    gpointer (*read)(const char *path, GError **error);
    /* One line about a file of which only headers were read; NULL: parts are missing. g_free() */
    char *(*describe_file)(const struct exr_file *file);

    void (*free)(gpointer model);         /* NULL is ignored */
    gsize layout;                         /* offset of a model's struct btf_layout */
    gint64 (*bytes)(gconstpointer model); /* as a renderer holds it */
    /* One texel at the measured directions: n_views × n_lights × 3 (R, G, B). */
    void (*reconstruct)(gconstpointer model, int texel, float *ret);
    /* Adds Σ_k share_k B(texel_k, view, light) to ret (R, G, B). Evaluates only these values and
     * reconstructs no whole texel. If the model is a table, B is interpolated between the measured
     * directions; if it is a formula, B is the formula's value, at least 0. */
    void (*evaluate)(gconstpointer model, const struct codec_query *query,
                     const struct codec_texels *texels, float ret[3]);
    /* Optional: returns n if the model's views and lights are the n × n samples of
     * direction_grid.h; 0: they are the measured ones. */
    int (*grid)(gconstpointer model);
    gsize error; /* offset of a model's relative RMS error, a double; 0: it does not know it */
    /* Optional: all mip levels of a file, models from level 0 on, with a free function; NULL: its
     * files have level 0 alone. */
    GPtrArray *(*read_levels)(const char *path, GError **error);

    /* Encodes the BTF at several sizes and reports each by calling tell(). */
    gboolean (*curve)(const struct codec *codec, const struct btf_matrix *btf,
                      const struct work *work, CodecPoint tell, gpointer data, GError **error);
};
