/* The contract of a codec, which stores a BTF in less space. Each codec fills one constant struct
 * codec in its own folder. The array codecs[] (codecs/codecs.h) lists them all. The command line,
 * material_open() and the comparisons find codecs only in that array.
 *
 * A model is the compressed form of a BTF in memory. The functions that take a const model may be
 * called from several threads at the same time. */
#pragma once

#include "base/options.h"
#include "btf/btf_matrix.h"
#include "exr/checkpoint.h"
#include "exr/exr.h"

/* Properties of every material. Arrays belong to the material or its model. */
struct material_info {
    /* name that distinguishes the material from others: that of its file or session, or of a
     * method */
    char *label;
    const char *kind; /* "btf", or the name of the material's codec */
    const struct btf_layout *layout;
    gint64 bytes; /* bytes in a renderer's memory; for a BTF those of its values as halves */
};

/* The input of encode(). */
struct codec_job {
    /* the BTF to encode; its values are in memory unless memory > 0 */
    const struct btf_matrix *btf;
    /* values of the options, in the struct that the codec's option table describes */
    gconstpointer options;
    /* maximum bytes for values and work; 0 if not limited. Only for bounded codecs */
    gint64 memory;
    const struct work *work; /* never NULL */
    /* stores the state of the work, or NULL. Only for resumable codecs */
    Checkpoint *checkpoint;
};

/* The result of encode(). The caller sets all members to 0, and frees levels. */
struct codec_result {
    /* models with a free function: that of the BTF, then those of its mip levels */
    GPtrArray *levels;
    /* numbers of clusters and of components (terms, lobes, …), and n of an n × n grid; 0 if
     * there are none */
    int clusters, components, grid;
    double error; /* ‖A − Â‖_F / ‖A‖_F of R, G, B, after the numbers were rounded for the file */
    double exact_error; /* ‖A − Â‖_F / ‖A‖_F before the numbers were rounded for the file */
    double luminance_error; /* mean |Y − Ŷ| of the luminance; −1 if the codec does not compute it */
    /* whether the size of the result is that of its file, not that in a renderer's memory */
    gboolean packed;
};

struct codec;

/* One point of a curve that shows error against size. */
struct codec_point {
    const char *series; /* name of the curve; a codec may have several curves */
    /* distinguishes the points of a curve, as in "8 clusters"; the CodecPoint function frees the
     * label */
    char *label;
    gint64 bytes; /* bytes in a renderer's memory */
    double error; /* relative RMS error of the BTF; −1 if the CodecPoint function must measure it */
    gconstpointer model;
};
typedef gboolean (*CodecPoint)(const struct codec *codec, const struct codec_point *point,
                               gpointer data, GError **error);

/* A view and a light between the measured directions, prepared once for all texels. */
struct codec_query {
    float view[3], light[3]; /* unit vectors above the horizon */
    /* The measured views around the view, the measured lights around the light, and their weights,
     * which are above 0. The weights of the views sum to 1, those of the lights to
     * directions_fade(). */
    int n_views, n_lights;
    const int *views, *lights;
    const float *view_weights, *light_weights;
};

#define CODEC_MAX_TEXELS 512
/* Texels of a model, and the weight of each in the requested sum. */
struct codec_texels {
    int n; /* at most CODEC_MAX_TEXELS */
    const int *index;
    const float *share;
};

struct codec {
    const char *name;  /* argument of --method, and mesorig.kind in the codec's files */
    const char *title; /* name for people, as in "local PCA" */
    const char *help;  /* one sentence without a full stop that describes the codec */
    int variant;       /* distinguishes codecs that share their functions */

    /* The options of --method=name besides --memory and -o. Their names are those of the command
     * line's options, without "--". An option that is not given has its fallback, or 0 if it has no
     * fallback. */
    const struct option *options;
    gsize options_size;
    /* Checks whether options contradict each other. Returns a sentence without a full stop that
     * says how, or NULL if they do not. The member may be NULL. */
    const char *(*check)(gconstpointer options, gint64 memory);

    gboolean bounded; /* whether encode() keeps within --memory */
    /* whether encode() stores its state in a checkpoint, from which it can continue */
    gboolean resumable;
    /* “mesorig process” writes products/NAME.exr, so that “mesorig compress” needs -o */
    gboolean from_process;

    gboolean (*encode)(const struct codec *codec, const struct codec_job *job,
                       struct codec_result *ret, GError **error);
    /* Describes the result of encode(), as in "3 clusters of 2 components". g_free() */
    char *(*describe)(const struct codec *codec, const struct codec_result *result);
    gboolean (*write)(const char *path, gpointer const *levels, int n_levels, GError **error);

    /* Reads the model of level 0. The caller has checked that mesorig.kind is the codec's name. */
    gpointer (*read)(const char *path, GError **error);
    /* Returns one line about a file of which only the headers were read, or NULL if parts are
     * missing. g_free() */
    char *(*describe_file)(const struct exr_file *file);

    void (*free)(gpointer model);         /* NULL is ignored */
    gsize layout;                         /* offset of the struct btf_layout in a model */
    gint64 (*bytes)(gconstpointer model); /* bytes of a model in a renderer's memory */
    /* Reconstructs one texel at the measured directions: n_views × n_lights × 3 (R, G, B). */
    void (*reconstruct)(gconstpointer model, int texel, float *ret);
    /* Adds Σ_k share_k B(texel_k, view, light) to ret (R, G, B). Evaluates only these values and
     * reconstructs no whole texel. If the model is a table, B is interpolated between the measured
     * directions. If it is a formula, B is the value of the formula, at least 0. */
    void (*evaluate)(gconstpointer model, const struct codec_query *query,
                     const struct codec_texels *texels, float ret[3]);
    /* Optional. Returns n if the model's views and lights are the n × n samples of
     * direction_grid.h, or 0 if they are the measured directions. */
    int (*grid)(gconstpointer model);
    gsize error; /* offset of the relative RMS error (double) in a model; 0 if there is none */
    /* Optional. Reads all mip levels of a file: models from level 0 on, with a free function. NULL
     * if the files of the codec have only level 0. */
    GPtrArray *(*read_levels)(const char *path, GError **error);

    /* Encodes the BTF at several sizes and reports each by calling tell(). */
    gboolean (*curve)(const struct codec *codec, const struct btf_matrix *btf,
                      const struct work *work, CodecPoint tell, gpointer data, GError **error);
};
