#include <cblas.h>
#include <math.h>
#include <string.h>

#include "codecs/lpca/lpca_private.h"
#include "eigenmaps_private.h"

#define CHUNK    EIGENMAPS_CHUNK
#define SKETCH   16384 /* number of rows of the sketch S A */
#define WORD     64    /* number of signs that are drawn at a time */
#define LANES    8
#define SEGMENTS 8 /* number of parts into which the rows are divided for threads */
/* Maximum oversampling: A is projected onto this many directions more than terms are requested. */
#define SPARE 8
#define SEED  0x6d65736f72696721u

struct eigenmaps_randomised {
    const struct eigenmaps_job *job;
    gsize rows;
    int n_views;
    float *columns; /* slots × rows: columns of A */
    int slots;
    /* SEGMENTS × SKETCH: a column of S A; each segment has its own sums */
    double *buckets;
    double squares[SEGMENTS]; /* Σ of the squares of the column in each segment */
    float *sketch;            /* n_views × SKETCH: (S A)ᵀ */
    double all;               /* ‖A‖² */
    /* n_views × n_views: a right singular vector of S A in each row, by descending values */
    double *directions;
    double *values; /* n_views: squared singular values of S A */
    int found;      /* number of directions onto which A is projected */
    float *z;       /* found × rows: A times the first directions */
    /* First found × slots: the entries of the directions for the columns in memory. Later terms ×
     * found: F of rotate_segment(). */
    float *factors;
    int loaded; /* number of columns of A in memory */
    /* First SEGMENTS × found²: ZᵀZ of each segment. Later the eigenvectors of the sum of these
     * matrices, in columns. */
    double *gram;
    /* found: eigenvalues of ZᵀZ, descending. Each is the part of ‖A‖² along one of the best
     * directions */
    double *squares_of;
    ScratchFile *file; /* Z, found × job->rows, if it is in a file; otherwise NULL */
};

/* Returns 64 random bits for a counter (SplitMix64, Steele, Lea and Flood 2014). */
static guint64 draw(guint64 counter) {
    guint64 z = SEED + counter * 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

/* Adds value i of `from` to to[i], negated if bit i of signs is 1. Also adds the squares of the
 * values to squares. squares has LANES sums, so that compilers can vectorise. */
static void add_signed(const float *from, int n, guint64 signs, double *to, double *squares) {
    int i = 0;
    for (; i + LANES <= n; i += LANES, signs >>= LANES)
        for (int lane = 0; lane < LANES; lane++) {
            const double value = from[i + lane];
            to[i + lane] += (signs & 1u << lane) ? -value : value;
            squares[lane] += value * value;
        }
    for (; i < n; i++, signs >>= 1) {
        to[i] += (signs & 1) ? -from[i] : from[i];
        squares[0] += (double)from[i] * from[i];
    }
}

/* Computes the share of one segment in a column of S A. The segment has every SEGMENTS-th group of
 * SKETCH rows. Row i of a group is added, with a random sign, to bucket (i + offset) mod SKETCH.
 * Each group has its own random offset. */
static void sketch_segment(int segment, gpointer data) {
    struct eigenmaps_randomised *r = data;
    double *buckets = r->buckets + (gsize)segment * SKETCH, squares[LANES] = {0};
    memset(buckets, 0, sizeof(double) * SKETCH);
    for (gsize from = (gsize)segment * SKETCH; from < r->rows; from += (gsize)SEGMENTS * SKETCH) {
        const gsize end = MIN(from + SKETCH, r->rows);
        const gsize offset = draw(2 * from + 1) % SKETCH;
        for (gsize i = from; i < end; i += WORD) {
            const int n = (int)MIN(WORD, end - i);
            const gsize bucket = (i - from + offset) % SKETCH;
            const int before = (int)MIN((gsize)n, SKETCH - bucket);
            const guint64 signs = draw(2 * i);
            add_signed(r->columns + i, before, signs, buckets + bucket, squares);
            if (before < n)
                add_signed(r->columns + i + before, n - before, signs >> before, buckets, squares);
        }
    }
    r->squares[segment] = 0;
    for (int lane = 0; lane < LANES; lane++)
        r->squares[segment] += squares[lane];
}

/* First pass: computes (S A)ᵀ, n_views × SKETCH, and ‖A‖². */
static gboolean make_sketch(struct eigenmaps_randomised *r, GError **error) {
    r->buckets = g_new(double, SEGMENTS *SKETCH);
    r->sketch = g_new(float, (gsize)r->n_views *SKETCH);
    for (int view = 0; view < r->n_views; view++) {
        float *to = r->sketch + (gsize)view * SKETCH;
        if (!eigenmaps_get_column(r->job, view, r->columns, error))
            return FALSE;
        work_for_each(0, SEGMENTS, sketch_segment, r);
        for (gsize i = 0; i < SKETCH; i++) {
            double sum = 0;
            for (gsize segment = 0; segment < SEGMENTS; segment++)
                sum += r->buckets[segment * SKETCH + i];
            to[i] = (float)sum;
        }
        for (int segment = 0; segment < SEGMENTS; segment++)
            r->all += r->squares[segment];
    }
    g_clear_pointer(&r->buckets, g_free);
    return TRUE;
}

/* Finds the right singular vectors of the sketch, which are the eigenvectors of (S A)ᵀ S A. */
static gboolean find_directions(struct eigenmaps_randomised *r, GError **error) {
    const int n = r->n_views;
    g_autofree double *wide = g_new(double, (gsize)n *CHUNK), *ascending = g_new(double, n);
    g_autofree double *gram = g_new0(double, (gsize)n *n);
    for (gsize from = 0; from < SKETCH; from += CHUNK) {
        eigenmaps_widen(r->sketch, SKETCH, n, from, wide);
        cblas_dsyrk(CblasRowMajor, CblasUpper, CblasNoTrans, n, CHUNK, 1, wide, CHUNK, 1, gram, n);
    }
    g_clear_pointer(&r->sketch, g_free);
    if (!eigenmaps_eigenvectors(gram, n, ascending, error))
        return FALSE;
    r->directions = g_new(double, (gsize)n *n);
    r->values = g_new(double, n);
    for (int i = 0; i < n; i++) {
        r->values[i] = MAX(ascending[n - 1 - i], 0);
        for (int view = 0; view < n; view++)
            r->directions[(gsize)i * n + view] = gram[(gsize)view * n + (n - 1 - i)];
    }
    return TRUE;
}

/* Gives the first row of a segment and the row after its last one. */
static void segment_rows(const struct eigenmaps_randomised *r, int segment, gsize *ret_from,
                         gsize *ret_end) {
    const gsize chunks = (r->rows + CHUNK - 1) / CHUNK;
    *ret_from = MIN(r->rows, chunks * (gsize)segment / SEGMENTS * CHUNK);
    *ret_end = MIN(r->rows, chunks * (gsize)(segment + 1) / SEGMENTS * CHUNK);
}

static void project_segment(int segment, gpointer data) {
    struct eigenmaps_randomised *r = data;
    gsize from, end;
    segment_rows(r, segment, &from, &end);
    for (; from < end; from += CHUNK)
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, r->found,
                    (int)MIN(CHUNK, end - from), r->loaded, 1, r->factors, r->slots,
                    r->columns + from, (int)r->rows, 1, r->z + from, (int)r->rows);
}

/* Second pass: computes Z = A times the first `found` directions. Reads as many columns at a time
 * as fit into memory. */
static gboolean project(struct eigenmaps_randomised *r, GError **error) {
    g_free(r->z);
    g_free(r->factors);
    r->factors = g_new(float, (gsize)r->found *(gsize)r->slots);
    r->z = eigenmaps_new_columns(r->job, r->found, error);
    if (!r->z)
        return FALSE;
    memset(r->z, 0, sizeof(float) * r->rows * (gsize)r->found);
    for (int view = 0; view < r->n_views; view += r->loaded) {
        r->loaded = MIN(r->slots, r->n_views - view);
        for (int i = 0; i < r->loaded; i++) {
            if (!eigenmaps_get_column(r->job, view + i, r->columns + r->rows * (gsize)i, error))
                return FALSE;
            for (int j = 0; j < r->found; j++)
                r->factors[j * r->slots + i] =
                    (float)r->directions[(gsize)j * r->n_views + view + i];
        }
        work_for_each(0, SEGMENTS, project_segment, r);
    }
    return TRUE;
}

static void gram_segment(int segment, gpointer data) {
    struct eigenmaps_randomised *r = data;
    g_autofree double *wide = g_new(double, (gsize)r->found *CHUNK);
    double *to = r->gram + (gsize)segment * (gsize)r->found * (gsize)r->found;
    gsize from, end;
    segment_rows(r, segment, &from, &end);
    for (; from < end; from += CHUNK) {
        const gsize n = eigenmaps_widen(r->z, r->rows, r->found, from, wide);
        cblas_dsyrk(CblasRowMajor, CblasUpper, CblasNoTrans, r->found, (int)n, 1, wide, CHUNK, 1,
                    to, r->found);
    }
}

static void new_gram(struct eigenmaps_randomised *r) {
    g_free(r->gram);
    r->gram = g_new0(double, SEGMENTS *(gsize)r->found *(gsize)r->found);
}

/* Finds the best directions within the span of the first `found` directions: the eigenvectors of
 * ZᵀZ, in columns. */
static gboolean solve_gram(struct eigenmaps_randomised *r, GError **error) {
    const int n = r->found;
    const gsize square = (gsize)n * (gsize)n;
    g_autofree double *ascending = g_new(double, n);
    g_free(r->squares_of);
    r->squares_of = g_new(double, n);
    for (gsize segment = 1; segment < SEGMENTS; segment++)
        for (gsize i = 0; i < square; i++)
            r->gram[i] += r->gram[segment * square + i];
    if (!eigenmaps_eigenvectors(r->gram, n, ascending, error))
        return FALSE;
    for (int i = 0; i < n; i++)
        r->squares_of[i] = MAX(ascending[n - 1 - i], 0);
    return TRUE;
}

static gboolean solve(struct eigenmaps_randomised *r, GError **error) {
    new_gram(r);
    work_for_each(0, SEGMENTS, gram_segment, r);
    return solve_gram(r, error);
}

#define IN_BLOCK 16 /* maximum number of columns of a block that are in memory together */

/* Computes the block of Z of n lights or n texels from `first` on, adds its products to ZᵀZ, and
 * writes it to the file. */
static gboolean project_block(struct eigenmaps_randomised *r, gsize first, gsize n,
                              GError **error) {
    const struct eigenmaps_job *job = r->job;
    const gboolean by_lights = job->options->lights;
    const gsize lights = job->maps->layout.lights.n, texels = job->rows / lights / 3;
    memset(r->z, 0, sizeof(float) * r->rows * (gsize)r->found);
    for (int view = 0; view < r->n_views; view += r->loaded) {
        r->loaded = MIN(r->slots, r->n_views - view);
        for (int i = 0; i < r->loaded; i++) {
            if (!job->options->part(view + i, first, n, r->columns + r->rows * (gsize)i, job->data,
                                    error))
                return FALSE;
            for (int j = 0; j < r->found; j++)
                r->factors[j * r->slots + i] =
                    (float)r->directions[(gsize)j * r->n_views + view + i];
        }
        work_for_each(0, SEGMENTS, project_segment, r);
    }
    work_for_each(0, SEGMENTS, gram_segment, r);
    for (int j = 0; j < r->found; j++)
        for (gsize light = 0; light < (by_lights ? 1 : lights); light++) {
            const gsize at = by_lights ? first * texels * 3 : (light * texels + first) * 3;
            const gsize some = by_lights ? r->rows : n * 3;
            if (!scratch_file_write(r->file, ((gsize)j * job->rows + at) * sizeof *r->z,
                                    r->z + (gsize)j * r->rows + light * some, some * sizeof *r->z,
                                    error))
                return FALSE;
        }
    return TRUE;
}

/* Does the work of project() and solve() with Z in a file. The blocks have as many lights or texels
 * as fit into memory. r->rows is the number of rows of a block. */
static gboolean project_to_file(struct eigenmaps_randomised *r, GError **error) {
    const struct eigenmaps_job *job = r->job;
    const struct eigenmaps_options *options = job->options;
    const gsize lights = job->maps->layout.lights.n, texels = job->rows / lights / 3;
    const gsize n = options->lights ? lights : texels, unit = job->rows / n;
    const gsize memory = options->memory > 0 ? options->memory : EIGENMAPS_MEMORY;
    gboolean ok = TRUE;
    r->slots = MIN(IN_BLOCK, r->n_views);
    const gsize each = sizeof(float) * unit * (gsize)(r->slots + r->found);
    const gsize block = CLAMP(memory / each, 1, n);
    g_clear_pointer(&r->file, scratch_file_free);
    r->file = scratch_file_new(options->folder, sizeof *r->z * job->rows * (gsize)r->found,
                               "the eigen-maps", error);
    g_free(r->columns);
    g_free(r->z);
    g_free(r->factors);
    r->columns = g_new(float, unit *block *(gsize)r->slots);
    r->z = g_new(float, unit *block *(gsize)r->found);
    r->factors = g_new(float, (gsize)r->found *(gsize)r->slots);
    new_gram(r);
    for (gsize first = 0; r->file && ok && first < n; first += block) {
        const gsize some = MIN(block, n - first);
        r->rows = some * unit;
        ok = project_block(r, first, some, error);
    }
    return r->file && ok && solve_gram(r, error);
}

/* Replaces Z by the maps: E = F Z, where F are the factors, terms × found. */
static void rotate_segment(int segment, gpointer data) {
    struct eigenmaps_randomised *r = data;
    const int terms = r->job->maps->n_terms;
    g_autofree float *rotated = g_new(float, (gsize)terms *CHUNK);
    gsize from, end;
    segment_rows(r, segment, &from, &end);
    for (; from < end; from += CHUNK) {
        const gsize n = MIN(CHUNK, end - from);
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, terms, (int)n, r->found, 1,
                    r->factors, r->found, r->z + from, (int)r->rows, 0, rotated, CHUNK);
        for (int i = 0; i < terms; i++)
            memcpy(r->z + (gsize)i * r->rows + from, rotated + (gsize)i * CHUNK, sizeof(float) * n);
    }
}

/* Does rotate_segment() for all of Z in the file, CHUNK · IN_BLOCK rows at a time. */
static gboolean rotate_file(struct eigenmaps_randomised *r, GError **error) {
    const gsize all = r->job->rows, terms = (gsize)r->job->maps->n_terms;
    g_free(r->z);
    r->z = g_new(float, (gsize)r->found *CHUNK *IN_BLOCK);
    for (gsize from = 0; from < all; from += r->rows) {
        r->rows = MIN(CHUNK * IN_BLOCK, all - from);
        for (gsize i = 0; i < (gsize)r->found; i++)
            if (!scratch_file_read(r->file, (i * all + from) * sizeof *r->z, r->z + i * r->rows,
                                   r->rows * sizeof *r->z, error))
                return FALSE;
        work_for_each(0, SEGMENTS, rotate_segment, r);
        for (gsize i = 0; i < terms; i++)
            if (!scratch_file_write(r->file, (i * all + from) * sizeof *r->z, r->z + i * r->rows,
                                    r->rows * sizeof *r->z, error))
                return FALSE;
    }
    r->job->maps->file = g_steal_pointer(&r->file);
    return TRUE;
}

static gboolean take(struct eigenmaps_randomised *r, GError **error) {
    struct eigenmaps *maps = r->job->maps;
    const int n = r->found, terms = maps->n_terms;
    g_autofree double *rotation = g_new0(double, (gsize)terms *n), *signs = g_new0(double, terms);
    g_autofree double *weights = g_new(double, (gsize)terms * r->n_views);
    for (int i = 0; i < terms; i++)
        for (int j = 0; j < n; j++)
            rotation[i * n + j] = r->gram[j * n + (n - 1 - i)];
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, terms, r->n_views, n, 1, rotation, n,
                r->directions, r->n_views, 0, weights, r->n_views);
    eigenmaps_take_weights(maps, weights, signs);
    g_free(r->factors);
    r->factors = g_new(float, (gsize)terms *n);
    for (int i = 0; i < terms * n; i++)
        r->factors[i] = (float)(signs[i / n] * rotation[i]);
    if (r->file)
        return rotate_file(r, error);
    work_for_each(0, SEGMENTS, rotate_segment, r);
    maps->maps = g_realloc_n(g_steal_pointer(&r->z), r->rows * (gsize)terms, sizeof(float));
    return TRUE;
}

/* Searches the smallest number of terms whose error is at most the target, and takes this number.
 * If target is 0, takes all terms.
 *
 * The first guess follows from the singular values of the sketch. Each trial projects A onto that
 * many directions of the sketch and up to SPARE more. If the error is still above the target, the
 * next trial takes about a quarter more terms. */
static gboolean search(struct eigenmaps_randomised *r, double *ret_error, GError **error) {
    struct eigenmaps *maps = r->job->maps;
    const double target = r->job->options->target;
    const int most = maps->n_terms;
    double rest = 0, ignored;
    for (int i = r->n_views - 1; i >= most; i--)
        rest += r->values[i];
    int wanted = eigenmaps_fewest(r->values, most, rest, target, &ignored);
    for (;; wanted = MIN(most, wanted + MAX(2, wanted / 4))) {
        const gboolean in_file = r->job->options->folder != NULL;
        r->found = MIN(r->n_views, wanted + (in_file ? SPARE : (int)MIN(SPARE, r->job->fit / 2)));
        if (in_file ? !project_to_file(r, error) : !project(r, error) || !solve(r, error))
            return FALSE;
        rest = r->all;
        const int terms = MIN(most, r->found);
        for (int i = 0; i < terms; i++)
            rest -= r->squares_of[i];
        maps->n_terms = eigenmaps_fewest(r->squares_of, terms, MAX(rest, 0), target, ret_error);
        if (target <= 0 || *ret_error <= target)
            break;
        maps->n_terms = most;
        if (wanted == most)
            return eigenmaps_missed(r->job, *ret_error, error);
    }
    return take(r, error);
}

gboolean eigenmaps_randomised(const struct eigenmaps_job *job, double *ret_error, GError **error) {
    struct eigenmaps_randomised r = {job, job->rows, job->maps->layout.views.n};
    const gsize spare = MIN(SPARE, job->fit / 2);
    r.slots = job->options->folder ? 1 : (int)CLAMP(job->fit - spare, 1, (gsize)r.n_views);
    r.columns = eigenmaps_new_columns(job, r.slots, error);
    const gboolean ok = r.columns && make_sketch(&r, error) && find_directions(&r, error) &&
                        search(&r, ret_error, error);
    g_free(r.columns);
    g_free(r.buckets);
    g_free(r.sketch);
    g_free(r.directions);
    g_free(r.values);
    g_free(r.z);
    g_free(r.factors);
    g_free(r.gram);
    g_free(r.squares_of);
    scratch_file_free(r.file);
    return ok;
}
