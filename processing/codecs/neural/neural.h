/*
 * Neural planes: a small network computes the colour of a BTF from channels of each texel, from two
 * planes over directions, and from what a height map says of the ray and of the light. The height
 * map is made from the MDF, so that the network need not learn parallax and shadows. The planes are
 * those of Fan et al. 2023 (“Neural Biplane Representation for BTF Rendering and Acquisition”) and
 * Xu et al. 2024; docs/lab/compression.md compares forms of such networks.
 *
 * This comment defines the evaluation. neural_evaluate() computes it on the CPU. A shader that
 * follows it gives the same colours.
 *
 * Coordinates. Places are in texels: x to the right, y downwards, texel (i, j) is centred at (i +
 * ½, j + ½). v and l are unit vectors to view and light in the sample frame, where y is upwards.
 * Hence a vector (x, y, z) moves a place by (x, −y). Heights z are in texels as well: z = (mm above
 * the reference plane) / texel_mm. They are usually negative.
 *
 * Numbers. All arrays are bytes 0 … 255, which stand for value = minimum + step · byte.
 *
 * Reads. Every read of `surface`, `heights`, `halves` and `differences` is bilinear between the
 * centres of the elements and clamped to the edge, as GL_LINEAR with GL_CLAMP_TO_EDGE:
 *   surface at a place (x, y)        texture coordinates (x / width, y / height)
 *   H(x, y), the height              the same coordinates; the map has 2 width × 2 height cells
 *   halves, differences at (a, b)    texture coordinates ((a + 1) / 2, (b + 1) / 2)
 * For points, surface and heights repeat, as with GL_REPEAT.
 *
 * 1. Rays. The colour at (x, y) is computed from four rays, which meet the reference plane z = 0 at
 *    (x ± ¼, y ± ¼). For each ray, with w = (v.x, −v.y) / max(v.z, 0.05), q(z) = (x ± ¼, y ± ¼) + w
 *    z is the ray's place at the height z. `top` and `bottom` are the heights of the bytes 255 and
 *    0 of the map.
 *      n = ⌈4 (top − bottom) max(1, |w|)⌉, at least 1, at most NEURAL_MAX_STEPS
 *      z_k = top − (top − bottom) k / n,  k = 0 … n
 *    The ray ends between z_{k−1} and z_k for the smallest k with H(q(z_k)) ≥ z_k. If k = 0, it
 *    ends at z_0. Otherwise NEURAL_HALVINGS steps of bisection follow: with m the middle of the
 *    interval, the lower end becomes m if H(q(m)) ≥ m, else the upper end does. The ray's end p is
 *    q(z) at the lower end of the interval.
 * 2. Light at the end p of each ray. With e = ¾ of a cell = ⅜ texel and H±± = H(p + (±e, ±e)):
 *      slope x  s = (H++ + H+− − H−+ − H−−) / (4 e)   (first sign: x; second sign: y)
 *      slope y  t = (H++ + H−+ − H+− − H−−) / (4 e)
 *      normal   N = (−s, t, 1) / |(−s, t, 1)|         (in the sample frame, y upwards)
 *    The horizon is scanned from p towards the light. d is the direction of the light in the plane
 *    and r is its slope: d = (l.x, −l.y) / c, r = l.z / c, c = max(|(l.x, l.y)|, 10⁻⁴). z = H(p) is
 *    the height at p, t is the distance, and h becomes the slope of the horizon. The scan ends at
 *    reach = (top − bottom) / max(r, 0.05) + ½.
 *      h = r − 1;  t = ⅜
 *      at most NEURAL_MAX_STEPS times, while t ≤ reach and top − z > h t:
 *        h = max(h, (H(p + d t) − z) / t);  t = t + max(¼, t / 16)
 *    clear = clamp(r − h, −1, 1) is how far the light is above the horizon, as a difference of
 *    slopes. lit = clamp(½ + 10 clear, 0, 1). shade = max(N · l, 0) · lit.
 * 3. Directions. g = (v + l) / |v + l| is the half vector. (g.x, g.y) is the place in `halves`. The
 *    light in the frame whose z axis is g, after the shortest rotation, is
 *      f = (l.x, l.y) − (g.x, g.y) ((l.x g.x + l.y g.y) / (1 + g.z) + l.z)
 *    and f is the place in `differences` (Rusinkiewicz 1998, without the jump at the pole).
 * 4. Network. The inputs are, in this order: the n_channels of `surface`, each the mean of the four
 *    values at the rays' ends; the NEURAL_PLANE_CHANNELS of `halves`; those of `differences`; the
 *    means over the four rays of shade, lit and clear. Layers: 32, 32, 6 rows. The output of a row
 *    is its bias plus Σ weight · input, and after the first two layers y becomes max(y, 0.01 y).
 * 5. Colour. With S(y) = log(1 + exp(4 y)) / 4, o_0 … o_5 the outputs, and c = 0, 1, 2 for R, G, B:
 *      B(c) = S(o_c) · shade + 0.3 · S(o_{3+c} − 1)
 *    where shade is the input of the network, the mean over the rays. B contains n·l, as all values
 *    of a BTF do, and is never negative.
 * Points. The formulas above give the colours of texels, to which the model is fitted. A renderer
 * evaluates points instead. The colour of a point (x, y) follows from the same formulas with one
 * ray, which meets the reference plane at (x, y). A pixel that is smaller than a texel gets the
 * colour of the point at its middle. A larger pixel gets the colour of this point in a mip level.
 * docs/lab/rendering.md compares points and texels with captures.
 *
 * Mip levels. A level has half the texels of the level before in each dimension, and the same
 * minimum and step of each channel. Its bytes are the rounded means of the bytes of the level
 * before. All formulas hold with the texels of the level. Halves, differences and the network are
 * those of level 0.
 *
 * On disk, one EXR "neural.exr". All bytes are half floats 0 … 255.
 *   parts "surface1" … "surface<n>"  channels A B G R, width × height; n is n_channels / 4. Channel
 *                            4 (k − 1) + 0, 1, 2, 3 of `surface` is R, G, B, A of part k
 *   part "heights"           channel Z, 2 width × 2 height
 *   parts "halves1", "halves2", "differences1", "differences2"
 *                            channels A B G R, NEURAL_PLANE × NEURAL_PLANE; order as in surface
 *   parts "weights1", "weights2", "weights3"   channel W, width inputs × height outputs of a layer
 *   part "rows"              channels BIAS MINIMUM STEP, float, NEURAL_ROWS × 1
 *   part "scales"            channels MINIMUM STEP, float, n_channels + 1 + 16 × 1: those of the
 *                            channels of surface, of heights (mm), halves and differences
 *   parts "views", "lights"  channels "phi_deg", "theta_deg", width n, height 1, float
 *   parts "cameras", "lamps" channels X Y Z, width n, height 1, float: camera_mm and lamp_mm; both
 *                            are missing if they are not known
 * Attributes of the first part: mesorig.kind ("neural"), mesorig.name (string); mesorig.channels,
 * mesorig.slices (always 1), mesorig.width, mesorig.height (int); mesorig.error,
 * mesorig.exact_error, mesorig.luminance_error, texel_mm, reference_mm (double). Parts of mip level
 * n have the prefix "mip<n>." (exr/mip_parts.h).
 */
#pragma once

#include "btf/btf_matrix.h"
#include "exr/checkpoint.h"

#define NEURAL_MAX_CHANNELS   16 /* maximum number of channels of a texel; a multiple of 4 */
#define NEURAL_PLANE          8  /* rows and columns of halves and differences */
#define NEURAL_PLANE_CHANNELS 8
#define NEURAL_PLANE_VALUES   (NEURAL_PLANE * NEURAL_PLANE * NEURAL_PLANE_CHANNELS)
#define NEURAL_HIDDEN         32 /* rows of each of the first two layers */
#define NEURAL_OUTPUTS        6  /* rows of the last layer */
#define NEURAL_LAYERS         3
#define NEURAL_ROWS           (2 * NEURAL_HIDDEN + NEURAL_OUTPUTS)
#define NEURAL_LIGHT_INPUTS   3 /* shade, lit, clear */
#define NEURAL_MAX_INPUTS     (NEURAL_MAX_CHANNELS + 2 * NEURAL_PLANE_CHANNELS + NEURAL_LIGHT_INPUTS)
#define NEURAL_MAX_WEIGHTS    (NEURAL_HIDDEN * (NEURAL_MAX_INPUTS + NEURAL_HIDDEN + NEURAL_OUTPUTS))
#define NEURAL_RAYS           4
#define NEURAL_MAX_STEPS      64
#define NEURAL_HALVINGS       5
#define NEURAL_MAX_LEVELS     16

struct neural_scale {
    float minimum, step; /* value = minimum + step · byte */
};

struct neural_numbers; /* the bytes of a model as floats (neural_private.h) */

struct neural {
    char *name;
    struct btf_layout layout; /* of this level */
    int level;                /* 0, or the number of the mip level */
    int n_channels;           /* 4, 8, 12 or 16 */
    guint8 *surface;          /* height × width × n_channels */
    guint8 *heights;          /* 2 height × 2 width */
    /* rows (b) × columns (a) × channels */
    guint8 halves[NEURAL_PLANE_VALUES], differences[NEURAL_PLANE_VALUES];
    /* Layer after layer: outputs × inputs. The first layer is NEURAL_HIDDEN × neural_inputs(), the
     * second NEURAL_HIDDEN × NEURAL_HIDDEN, the third NEURAL_OUTPUTS × NEURAL_HIDDEN. */
    guint8 weights[NEURAL_MAX_WEIGHTS];
    struct neural_scale rows[NEURAL_ROWS]; /* scale of the weights of each row */
    float biases[NEURAL_ROWS];
    struct neural_scale surface_scales[NEURAL_MAX_CHANNELS];
    struct neural_scale height_scale; /* mm above the reference plane */
    struct neural_scale half_scales[NEURAL_PLANE_CHANNELS];
    struct neural_scale difference_scales[NEURAL_PLANE_CHANNELS];
    /* Positions in the sample frame, n_views × 3 and n_lights × 3. The model was fitted to the
     * directions from each texel to these positions. Either both are set, or both are NULL. NULL
     * means that all texels have the directions of the layout. */
    float *camera_mm, *lamp_mm;
    double error, luminance_error, exact_error; /* as in struct hsh (hsh/hsh.h) */
    struct neural_numbers *numbers;             /* made by neural_prepare() */
};

void neural_free(struct neural *neural); /* NULL is ignored */

int neural_inputs(int n_channels); /* inputs of the first layer */
int neural_weights(int n_channels);

/* Makes `numbers` from all other members. To be called when these are set or have changed, before
 * the functions below. */
void neural_prepare(struct neural *neural);

/* Returns the bytes of the arrays of struct neural in a renderer's memory. For a mip level, only
 * surface and heights count. Positions do not count. */
gint64 neural_bytes(const struct neural *neural);

/* A colour to evaluate: its place in texels, and unit vectors to view and light. */
struct neural_sample {
    float x, y;
    float view[3], light[3];
};

/* Evaluates n colours: n × R, G, B. Consecutive samples with the same place and view share their
 * rays, which is faster. Several threads may call the function. */
void neural_evaluate(const struct neural *neural, const struct neural_sample *samples, gsize n,
                     float *ret);
/* Evaluates n colours of points, for renderers. A point has one ray, which meets the reference
 * plane at (x, y), and the material repeats. neural_evaluate() gives the colours of texels. */
void neural_evaluate_points(const struct neural *neural, const struct neural_sample *samples,
                            gsize n, float *ret);

/* Give the unit vectors from the centre of a texel to the camera of a view and to a lamp. They
 * follow from camera_mm and lamp_mm, or, if these are NULL, from the directions of the layout. view
 * and light are indices of the layout. */
void neural_view(const struct neural *neural, int view, int texel, float ret[3]);
void neural_light(const struct neural *neural, int light, int texel, float ret[3]);

/* Reconstructs one texel at the measured directions, neural_view() and neural_light(): n_views ×
 * n_lights × 3. */
void neural_reconstruct(const struct neural *neural, int texel, float *ret);

/* Makes the next mip level. Returns NULL if the level has one texel. The errors of the new level
 * are copied from `neural`. neural_free() */
struct neural *neural_halved(const struct neural *neural);

/* Writes all levels into one file. n is 1 … NEURAL_MAX_LEVELS. */
gboolean neural_write(const char *path, struct neural *const *levels, int n, GError **error);
/* Reads level 0, or all levels. The error is EXR_ERROR_FORMAT if the file is damaged. The models
 * are prepared. neural_read_levels() returns the number of levels, or 0 with an error. */
struct neural *neural_read(const char *path, GError **error);
int neural_read_levels(const char *path, struct neural *ret_levels[NEURAL_MAX_LEVELS],
                       GError **error);

struct codec_geometry;

struct neural_options {
    int n_channels;   /* 4, 8, 12 or 16; 0 means 12 */
    double per_texel; /* samples of the training for each texel; 0 means 3000 */
    guint32 seed;     /* seed of the initial numbers and of the samples */
    struct work work;
    /* NULL, or a checkpoint. The checkpoint is saved at intervals and when the work is cancelled. A
     * later call for the same BTF and options continues from the checkpoint and gives the same
     * result as without an interruption. */
    Checkpoint *checkpoint;
    /* Positions of cameras and lamps, and the points of the surface. NULL means that all texels
     * have the directions of the layout, and that the surface is flat. */
    const struct codec_geometry *geometry;
};

/* Fits the model to a BTF whose values are in memory. Values that are NaN are left out. A cell of
 * the height map is the median of the points in the cell. A cell without points is filled from the
 * cells around it.
 *
 * The training minimises the squared difference of colours after the curve log(1 + 60 x) / log 61.
 * The method is Adam (Kingma & Ba 2015; β 0.9 and 0.99). Each step has NEURAL_STEP samples, which
 * are drawn at random. The learning rate is 0.02 for channels and planes and 0.01 for the network.
 * Both rates rise during the first 50 steps, and then fall to a fiftieth. There are at least
 * NEURAL_MIN_STEPS steps. Then all numbers are rounded to bytes.
 *
 * The result does not depend on the number of threads. It depends on the seed, and in the last
 * digits on the kind of processor. The progress stages are "train" and "errors". Fails if an option
 * is out of range, if the BTF is empty, too large or has an infinite value, or if the work is
 * cancelled. */
#define NEURAL_STEP      1024
#define NEURAL_MIN_STEPS 256
struct neural *neural_compute(const struct btf_matrix *btf, const struct neural_options *options,
                              GError **error);
