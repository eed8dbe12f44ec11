/* The interface of a codec, which stores a BTF in less space. Each codec fills one constant struct
 * codec in its own folder. The array codecs[] (codecs/codecs.h) lists all codecs. The command line,
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
    /* name that distinguishes the material from others: the name of its file, session or method */
    char *label;
    const char *kind; /* "btf", or the name of the material's codec */
    const struct btf_layout *layout;
    /* bytes in a renderer's memory; for a BTF, the bytes of its values as half floats */
    gint64 bytes;
};

struct codec_geometry;

/* The input of encode(). */
struct codec_job {
    /* the BTF to encode; if memory is 0, its values are in memory */
    const struct btf_matrix *btf;
    /* values of the options, in the struct that the codec's option table describes */
    gconstpointer options;
    /* maximum number of bytes for the BTF's values and the work; 0 if not limited. Only codecs with
     * `bounded` keep to the maximum */
    gint64 memory;
    const struct work *work; /* never NULL */
    /* keeps the state of the work, so that a later call can continue; NULL if no state is kept.
     * Only codecs with `resumable` use the checkpoint */
    Checkpoint *checkpoint;
    /* the geometry of the BTF, for codecs with `geometric`. If it is NULL, these codecs read the
     * geometry of the session btf->directory (codec_geometry.h) */
    const struct codec_geometry *geometry;
};

/* The result of encode(). The caller sets all members to 0 before the call, and frees levels, also
 * after a failure. */
struct codec_result {
    /* the model of the BTF, then the models of its mip levels; the array frees them */
    GPtrArray *levels;
    /* Numbers of clusters and of components (terms, lobes, …). Each is 0 if the model has none.
     * grid is n if the directions are an n × n grid, otherwise 0. */
    int clusters, components, grid;
    /* ‖A − Â‖_F / ‖A‖_F of R, G, B, where A is the BTF and Â the model as the file stores it */
    double error;
    /* the same ratio for the model before its numbers were rounded for the file */
    double exact_error;
    /* mean of |Y − Ŷ|, where Y and Ŷ are the luminances of A and Â; −1 if the codec does not
     * compute this mean */
    double luminance_error;
    /* whether the file is much smaller than the model in a renderer's memory, so that users are
     * told the size of the file */
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
    /* relative RMS error of the model against the BTF; −1 if the CodecPoint function must measure
     * it */
    double error;
    gconstpointer model;
};
typedef gboolean (*CodecPoint)(const struct codec *codec, const struct codec_point *point,
                               gpointer data, GError **error);

/* A view and a light between the measured directions, prepared once for all texels. */
struct codec_query {
    float view[3], light[3]; /* unit vectors above the horizon */
    /* The measured views around the view and the measured lights around the light, by index, with
     * weights above 0. The weights of the views sum to 1, and the weights of the lights sum to
     * directions_fade(). If the model has a grid(), the indices are those of its samples, and the
     * weights are those of direction_grid_weights(). */
    int n_views, n_lights;
    const int *views, *lights;
    const float *view_weights, *light_weights;
};

#define CODEC_MAX_TEXELS 512
/* The texels over which evaluate() sums. share[k] is the weight of the texel index[k]. */
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
    /* Returns NULL, or a sentence without a full stop that says how the options contradict each
     * other. The function pointer is NULL if no options contradict each other. */
    const char *(*check)(gconstpointer options, gint64 memory);

    gboolean bounded; /* whether encode() keeps within --memory */
    /* whether encode() stores its state in a checkpoint, from which it can continue */
    gboolean resumable;
    /* whether “mesorig process” writes products/NAME.exr with this codec. “mesorig compress” then
     * needs -o for its own file */
    gboolean from_process;
    /* whether models know where cameras and lamps were. evaluate() then expects the directions from
     * the texel to camera and lamp. Other codecs expect the directions from the centre of the
     * sample, like the directions in the layout */
    gboolean geometric;

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
     * directions. If the model is a formula, B is the value of the formula, at least 0. */
    void (*evaluate)(gconstpointer model, const struct codec_query *query,
                     const struct codec_texels *texels, float ret[3]);
    /* Optional. Returns n if the model's views and lights are the n × n samples of
     * direction_grid.h, or 0 if they are the measured directions. */
    int (*grid)(gconstpointer model);
    gsize error; /* offset of the relative RMS error (double) in a model; 0 if there is none */
    /* Optional. Reads all mip levels of a file: models from level 0 on, with a free function. It
     * may compute levels that the file lacks. NULL if the files of the codec have only level 0. */
    GPtrArray *(*read_levels)(const char *path, GError **error);

    /* Encodes the BTF of a job as models of several sizes, and calls tell() for each. Stops when
     * tell() fails. The job has no options, memory or checkpoint. */
    gboolean (*curve)(const struct codec *codec, const struct codec_job *job, CodecPoint tell,
                      gpointer data, GError **error);

    /* Optional. Adds share · B(x, y, view, light) to ret (R, G, B), where B is the value of a point
     * as renderers draw it. Texel (i, j) has its centre at (i + ½, j + ½), and the material
     * repeats. If NULL, the value of a point is mixed from those of the four texels around it. */
    void (*evaluate_point)(gconstpointer model, const struct codec_query *query, double x, double y,
                           float share, float ret[3]);
};
