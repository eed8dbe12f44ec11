#include "lpca_grid.h"

#include "gpu.h"
#include "lpca_texels.h"

#include <epoxy/gl.h>

#define LEAST 2
#define MOST  16

struct LpcaGrid {
    struct lpca_texels texels;
    struct lpca_stack stack; /* a row a view cell; columns are light cells and the sky, each with
                                all components */
    guint brdfs;
    int n;
};

/* Some directions and how much of each. */
struct share {
    int direction;
    float weight;
};

/* What each cell of the grid is mixed from, a GArray of struct share each; the pole is shared out.
 */
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

static GArray *sky_shares(const float *sky, int n) {
    GArray *shares = g_array_new(FALSE, FALSE, sizeof(struct share));
    for (int k = 0; k < n; k++) {
        const struct share share = {k, sky[k]};
        g_array_append_val(shares, share);
    }
    return shares;
}

static void mix(const float *values, gsize step, const GArray *shares, float ret[3]) {
    ret[0] = ret[1] = ret[2] = 0;
    for (guint k = 0; k < shares->len; k++) {
        const struct share *share = &g_array_index(shares, struct share, k);
        for (int c = 0; c < 3; c++)
            ret[c] += share->weight * values[step * share->direction + c];
    }
}

/* One component, first over the lights and then over the views; half holds n_views × (n² + 1). */
struct resampling {
    const struct lpca *lpca;
    GPtrArray *views, *lights; /* of the lights the last is the sky */
    float *half;
};

static void resample(const struct resampling *r, const float *component, int i, float *block) {
    const struct lpca *lpca = r->lpca;
    const gsize n_columns = r->lights->len, n_components = lpca->n_components + 1;
    for (int v = 0; v < lpca->n_views; v++)
        for (gsize cell = 0; cell < n_columns; cell++)
            mix(component + 3 * (gsize)lpca->n_lights * v, 3, r->lights->pdata[cell],
                r->half + 3 * (n_columns * v + cell));
    for (gsize row = 0; row < r->views->len; row++)
        for (gsize cell = 0; cell < n_columns; cell++)
            mix(r->half + 3 * cell, 3 * n_columns, r->views->pdata[row],
                block + 3 * ((row * n_columns + cell) * n_components + i));
}

static gboolean upload(LpcaGrid *grid, const struct lpca *lpca,
                       const struct lpca_directions *directions, GError **error) {
    const struct lpca_stack *stack = &grid->stack;
    g_autoptr(GPtrArray) views = cell_shares(directions->views, lpca->n_views, grid->n, FALSE);
    g_autoptr(GPtrArray) lights = cell_shares(directions->lights, lpca->n_lights, grid->n, TRUE);
    g_autofree float *half = g_new(float, 3 * (gsize)lpca->n_views * (grid->n * grid->n + 1));
    g_autofree float *block = g_new0(float, 3 * (gsize)stack->n_columns * stack->n_rows);
    const struct resampling r = {lpca, views, lights, half};
    const gsize size = 3 * (gsize)lpca->n_views * lpca->n_lights;
    g_ptr_array_add(lights, sky_shares(directions->sky, lpca->n_lights));
    grid->brdfs = lpca_stack_texture(stack, error);
    if (!grid->brdfs)
        return FALSE;
    for (int k = 0; k < lpca->n_clusters; k++) {
        for (int i = 0; i <= lpca->n_components; i++)
            resample(&r, lpca->brdfs + size * ((gsize)k * (lpca->n_components + 1) + i), i, block);
        lpca_stack_put(stack, k, block);
    }
    return gpu_check("the eigen-BRDFs' texture", error);
}

/* As fine as LPCA_GRID_BYTES allow; three halves are stored as four. */
static int fitting(const struct lpca *lpca) {
    int n = MOST;
    while (n > LEAST && 8.0 * lpca->n_clusters * (lpca->n_components + 1) * n * n * (n * n + 1.0) >
                            (double)LPCA_GRID_BYTES)
        n--;
    return n;
}

static gboolean make(LpcaGrid *grid, const struct lpca_pyramid *pyramid, int n_grid,
                     GError **error) {
    const struct lpca *lpca = pyramid->lpca;
    struct lpca_directions directions;
    grid->n = n_grid ? n_grid : fitting(lpca);
    if (grid->n < LEAST || grid->n > 1000) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED, "a grid of %d samples each way: 2 … 1000",
                    grid->n);
        return FALSE;
    }
    const int cells = grid->n * grid->n;
    if (!lpca_stack_init(&grid->stack, lpca->n_clusters, (cells + 1) * (lpca->n_components + 1),
                         cells, "compress with fewer components or clusters, or draw with lpca",
                         error) ||
        !lpca_directions_init(&directions, lpca, error))
        return FALSE;
    const gboolean ok = lpca_texels_init(&grid->texels, pyramid, NULL, error) &&
                        upload(grid, lpca, &directions, error);
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
    lpca_texels_clear(&grid->texels);
    g_free(grid);
}

static void bind_all(gpointer material, guint program, const struct method_style *style) {
    const LpcaGrid *grid = material;
    lpca_texels_bind(&grid->texels, program, style->nearest);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D_ARRAY, grid->brdfs);
    glUniform1i(glGetUniformLocation(program, "brdfs"), 0);
    glUniform1i(glGetUniformLocation(program, "n_grid"), grid->n);
    glUniform1i(glGetUniformLocation(program, "clusters_a_layer"), grid->stack.clusters_a_layer);
}

static gpointer open_levels(struct lpca *const *levels, int n, GError **error) {
    return lpca_grid_new(levels, n, 0, error);
}

static gpointer open_file(const char *path, GError **error) {
    return lpca_open_levels(path, open_levels, error);
}

static void free_grid(gpointer material) {
    lpca_grid_free(material);
}

static const char *const shader_names[] = {"directions.glsl", "lpca_texel.glsl", "lpca_grid.glsl",
                                           NULL};

const struct method method_lpca_grid = {
    .name = "lpca-grid",
    .title = "local PCA on a grid of directions",
    .product = "lpca.exr",
    .made_by = "mesorig compress",
    .shaders = shader_names,
    .open = open_file,
    .free = free_grid,
    .bind = bind_all,
};
