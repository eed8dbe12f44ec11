#include "lpca_grid.h"

#include "drawing/gl/gpu.h"
#include "lpca_texels.h"

#include <epoxy/gl.h>
#include <math.h>
#include <string.h>

#define LEAST    2
#define MOST     16
#define TEXEL    16 /* bytes per texel of the buffer texture */
#define MEAN_MAX 65408.0f

#define STEPS 127
/* Words per texel: one for the mean, and three for R, G and B of four components. The mean is
 * used only in the first texel of a sample. */
#define WORDS 4

struct LpcaGrid {
    struct lpca_texels texels;
    /* buffer has the texels of the samples in the order cluster × view cell × (light cells, then
     * the sky). brdfs is the buffer texture that reads buffer. */
    guint buffer, brdfs;
    int n; /* samples of the grid in each direction */
};

static int pages_of(const struct lpca *lpca) {
    return MAX(1, (lpca->n_components + 3) / 4);
}

static double texels_of(const struct lpca *lpca, int n) {
    return (double)lpca->n_clusters * pages_of(lpca) * n * n * (n * n + 1.0);
}

/* Returns the largest number of samples in each direction, from LEAST to MOST, that LPCA_GRID_BYTES
 * and the graphics card allow. If even LEAST samples are too many, returns LEAST. */
static int fitting(const struct lpca *lpca) {
    GLint most = 0;
    int n = MOST;
    glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &most);
    while (n > LEAST &&
           (TEXEL * texels_of(lpca, n) > (double)LPCA_GRID_BYTES || texels_of(lpca, n) > most))
        n--;
    return n;
}

/* A measured direction and its weight. */
struct share {
    int direction;
    float weight;
};

/* Returns, for each cell of the grid, the measured directions from which the cell is mixed, as a
 * GArray of struct share. If the pole was not measured, the mean of some directions stands for it,
 * and its weight is divided among these directions. If fade is TRUE, the weights are multiplied by
 * directions_fade(). */
static GPtrArray *cell_shares(Directions *directions, int n_directions, int n, gboolean fade) {
    GPtrArray *cells = g_ptr_array_new_with_free_func((GDestroyNotify)g_array_unref);
    for (int cell = 0; cell < n * n; cell++) {
        const int i = cell / n, j = cell % n;
        const struct vec3 d =
            directions_from_square(-1 + 2.0 * i / (n - 1), -1 + 2.0 * j / (n - 1));
        const double faded = fade ? directions_fade(directions, d) : 1;
        GArray *shares = g_array_new(FALSE, FALSE, sizeof(struct share));
        struct direction_weights w;
        int n_pole;
        const int *pole = directions_pole(directions, &n_pole);
        directions_weights(directions, d, &w);
        for (int k = 0; k < 4; k++) {
            const gboolean is_pole = w.index[k] >= n_directions;
            for (int m = 0; w.weight[k] > 0 && m < (is_pole ? n_pole : 1); m++) {
                const struct share share = {is_pole ? pole[m] : w.index[k],
                                            (float)(faded * w.weight[k] / (is_pole ? n_pole : 1))};
                g_array_append_val(shares, share);
            }
        }
        g_ptr_array_add(cells, shares);
    }
    return cells;
}

static void mix(const float *values, gsize step, const GArray *shares, float ret[3]) {
    ret[0] = ret[1] = ret[2] = 0;
    for (guint k = 0; k < shares->len; k++) {
        const struct share *share = &g_array_index(shares, struct share, k);
        for (int c = 0; c < 3; c++)
            ret[c] += share->weight * values[step * share->direction + c];
    }
}

/* The data of resample(). */
struct resampling {
    const struct lpca *lpca;
    GPtrArray *views, *lights; /* the last element of lights is the sky */
    /* Values that are resampled over the lights, but not over the views: measured view × (n² light
     * cells, then the sky) × RGB. */
    float *half;
};

/* Resamples one component, first over the lights and then over the views. */
static void resample(const struct resampling *r, const float *component, float *ret) {
    const struct lpca *lpca = r->lpca;
    const gsize n_columns = r->lights->len;
    for (gsize v = 0; v < lpca->layout.views.n; v++)
        for (gsize cell = 0; cell < n_columns; cell++)
            mix(component + 3 * lpca->layout.lights.n * v, 3, r->lights->pdata[cell],
                r->half + 3 * (n_columns * v + cell));
    for (gsize row = 0; row < r->views->len; row++)
        for (gsize cell = 0; cell < n_columns; cell++, ret += 3)
            mix(r->half + 3 * cell, 3 * n_columns, r->views->pdata[row], ret);
}

/* Encodes a mean as GL_RGB9_E5: nine bits per colour and a common exponent. */
static guint32 word_of_mean(const float rgb[3]) {
    const float largest = CLAMP(fmaxf(rgb[0], fmaxf(rgb[1], rgb[2])), 0, MEAN_MAX);
    int exponent;
    (void)frexpf(largest, &exponent);
    exponent = MAX(exponent, -15);
    if (lrintf(ldexpf(largest, 9 - exponent)) > 511)
        exponent++;
    guint32 word = (guint32)(exponent + 15) << 27;
    for (int c = 0; c < 3; c++)
        word |= (guint32)lrintf(ldexpf(CLAMP(rgb[c], 0, MEAN_MAX), 9 - exponent)) << 9 * c;
    return word;
}

/* Quantises a component to signed bytes (Schneider 2004 §6.3). Returns the value of one step. */
static float put_component(const float *values, gsize n_samples, int i, int n_pages,
                           guint32 *words) {
    const int page = (i - 1) / 4, shift = 8 * ((i - 1) % 4);
    float largest = 0;
    for (gsize k = 0; k < 3 * n_samples; k++)
        largest = fmaxf(largest, fabsf(values[k]));
    for (gsize k = 0; largest > 0 && k < 3 * n_samples; k++) {
        const guint8 step = (guint8)(gint8)lrintf(values[k] / largest * STEPS);
        words[WORDS * (k / 3 * n_pages + page) + 1 + k % 3] |= (guint32)step << shift;
    }
    return largest / STEPS;
}

static void put_cluster(const struct resampling *r, int cluster, int n_pages, float *values,
                        guint32 *words, float *ret_scales) {
    const struct lpca *lpca = r->lpca;
    const gsize size = 3 * lpca->layout.views.n * lpca->layout.lights.n;
    const gsize n_samples = (gsize)r->views->len * r->lights->len;
    memset(words, 0, sizeof(guint32) * WORDS * n_pages * n_samples);
    for (int i = 0; i <= lpca->n_components; i++) {
        const gsize table = (gsize)cluster * (lpca->n_components + 1) + i;
        resample(r, lpca->brdfs + size * table, values);
        ret_scales[table] = 1;
        if (i > 0)
            ret_scales[table] = put_component(values, n_samples, i, n_pages, words);
        else
            for (gsize k = 0; k < n_samples; k++)
                words[WORDS * n_pages * k] = word_of_mean(values + 3 * k);
    }
    const gsize bytes = sizeof(guint32) * WORDS * n_pages * n_samples;
    glBufferSubData(GL_TEXTURE_BUFFER, (GLintptr)(bytes * cluster), (GLsizeiptr)bytes, words);
}

static gboolean upload(LpcaGrid *grid, const struct lpca *lpca,
                       const struct lpca_directions *directions, float *ret_scales,
                       GError **error) {
    const int n_pages = pages_of(lpca), cells = grid->n * grid->n;
    const gsize n_samples = (gsize)cells * (cells + 1);
    g_autoptr(GPtrArray) views =
        cell_shares(directions->views, lpca->layout.views.n, grid->n, FALSE);
    g_autoptr(GPtrArray) lights =
        cell_shares(directions->lights, lpca->layout.lights.n, grid->n, TRUE);
    g_autofree float *half = g_new(float, 3 * lpca->layout.views.n * (cells + 1));
    g_autofree float *values = g_new(float, 3 * n_samples);
    g_autofree guint32 *words = g_new(guint32, WORDS * n_pages * n_samples);
    const struct resampling r = {lpca, views, lights, half};
    GArray *sky = g_array_new(FALSE, FALSE, sizeof(struct share));
    for (int k = 0; k < (int)lpca->layout.lights.n; k++) {
        const struct share share = {k, directions->sky[k]};
        g_array_append_val(sky, share);
    }
    g_ptr_array_add(lights, sky);
    glGenBuffers(1, &grid->buffer);
    glBindBuffer(GL_TEXTURE_BUFFER, grid->buffer);
    glBufferData(GL_TEXTURE_BUFFER, (GLsizeiptr)(n_samples * lpca->n_clusters * n_pages * TEXEL),
                 NULL, GL_STATIC_DRAW);
    if (!gpu_check("the eigen-BRDFs' buffer", error))
        return FALSE;
    for (int k = 0; k < lpca->n_clusters; k++)
        put_cluster(&r, k, n_pages, values, words, ret_scales);
    glGenTextures(1, &grid->brdfs);
    glBindTexture(GL_TEXTURE_BUFFER, grid->brdfs);
    glTexBuffer(GL_TEXTURE_BUFFER, GL_RGBA32UI, grid->buffer);
    return gpu_check("the eigen-BRDFs' buffer", error);
}

static gboolean check(const LpcaGrid *grid, const struct lpca *lpca, GError **error) {
    GLint most = 0;
    glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &most);
    if (grid->n < LEAST || grid->n > 1000) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "a grid of %d samples in each direction is not possible; give %d to 1000",
                    grid->n, LEAST);
        return FALSE;
    }
    if (texels_of(lpca, grid->n) <= most)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "%d clusters of %d components on a grid of %d samples in each direction need %.0f "
                "texels of a buffer, but %s supports %d; compress with fewer components or "
                "clusters, or draw with --method lpca",
                lpca->n_clusters, lpca->n_components, grid->n, texels_of(lpca, grid->n),
                gpu_renderer(), most);
    return FALSE;
}

static gboolean make(LpcaGrid *grid, const struct lpca_pyramid *pyramid, int n_grid,
                     GError **error) {
    const struct lpca *lpca = pyramid->lpca;
    struct lpca_directions directions;
    g_autofree float *scales = g_new(float, (gsize)lpca->n_clusters *(lpca->n_components + 1));
    grid->n = n_grid ? n_grid : fitting(lpca);
    if (!lpca_pyramid_is_linear(pyramid, error) || !check(grid, lpca, error) ||
        !lpca_directions_init(&directions, lpca, FALSE, error))
        return FALSE;
    const gboolean ok = upload(grid, lpca, &directions, scales, error) &&
                        lpca_texels_init(&grid->texels, pyramid, scales, error);
    lpca_directions_clear(&directions);
    return ok;
}

LpcaGrid *lpca_grid_new(struct lpca *const *levels, int n, int n_grid, GError **error) {
    g_autoptr(LpcaGrid) grid = g_new0(LpcaGrid, 1);
    struct lpca_pyramid pyramid;
    const gboolean ok =
        lpca_pyramid_init(&pyramid, levels, n, error) && make(grid, &pyramid, n_grid, error);
    lpca_pyramid_clear(&pyramid);
    return ok ? g_steal_pointer(&grid) : NULL;
}

void lpca_grid_free(LpcaGrid *grid) {
    if (grid == NULL)
        return;
    glDeleteTextures(1, &grid->brdfs);
    glDeleteBuffers(1, &grid->buffer);
    lpca_texels_clear(&grid->texels);
    g_free(grid);
}

static char *constants(gconstpointer material, const struct method_style *style) {
    const LpcaGrid *grid = material;
    return lpca_texels_constants(&grid->texels, style);
}

static void bind_all(gpointer material, guint program, const struct method_style *style) {
    const LpcaGrid *grid = material;
    lpca_texels_bind(&grid->texels, program);
    gpu_bind_texture(program, "brdfs", 0, GL_TEXTURE_BUFFER, grid->brdfs);
    glUniform1i(glGetUniformLocation(program, "n_grid"), grid->n);
}

static gboolean lpca_grid_texels(gconstpointer material, int ret[2]) {
    return lpca_texels_size(&((const struct LpcaGrid *)material)->texels, ret);
}

static gint64 lpca_grid_bytes(gconstpointer material) {
    const LpcaGrid *grid = material;
    return lpca_texels_bytes(&grid->texels) + gpu_texture_bytes(GL_TEXTURE_BUFFER, grid->brdfs);
}

static gpointer open_levels(struct lpca *const *levels, int n, GError **error) {
    return lpca_grid_new(levels, n, 0, error);
}

static gpointer open_file(const char *path, GError **error) {
    return lpca_open_levels(path, open_levels, error);
}

static const char *const shader_names[] = {"levels.glsl", "lpca_texel.glsl", "lpca_grid.glsl",
                                           NULL};

const struct method method_lpca_grid = {
    .name = "lpca-grid",
    .title = "local PCA on a grid of directions",
    .product = "lpca.exr",
    .made_by = "mesorig compress",
    .shaders = shader_names,
    .open = open_file,
    .free = (GDestroyNotify)lpca_grid_free,
    .constants = constants,
    .bytes = lpca_grid_bytes,
    .texels = lpca_grid_texels,
    .bind = bind_all,
};
