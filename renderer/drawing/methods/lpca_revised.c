#include "lpca_revised.h"

#include "btf/direction_grid.h"
#include "codecs/lpca/lpca_volumes.h"
#include "drawing/gl/cube_map.h"
#include "drawing/gl/gpu.h"
#include "lpca_texels.h"

#include <epoxy/gl.h>
#include <math.h>
#include <string.h>

#define MOST       16
#define VIEW_SIZE  256
#define LIGHT_SIZE 512
#define HALF_MAX   65504.0f

struct LpcaRevised {
    struct lpca_texels texels;
    guint means, brdfs, view_map, light_map; /* textures of lpca_revised.glsl */
    /* n: number of samples of the grid in each direction
     * n_columns: number of clusters in a row of a 3D texture */
    int n, n_columns;
};

/* Returns the largest number of samples in each direction, at most MOST, that fits into
 * LPCA_REVISED_BYTES. A card stores RGB bytes as 4 bytes, and RGB half floats as 8 bytes. */
static int fitting(const struct lpca *lpca) {
    int n = MOST;
    while (n > DIRECTION_GRID_MIN &&
           lpca->n_clusters * (8.0 + 4.0 * lpca->n_components) * n * n * (n * n + 1.0) >
               (double)LPCA_REVISED_BYTES)
        n--;
    return n;
}

static guint volume(int format, int width, int height, int depth) {
    GLuint texture;
    glGenTextures(1, &texture);
    glBindTexture(GL_TEXTURE_3D, texture);
    glTexImage3D(GL_TEXTURE_3D, 0, format, width, height, depth, 0, GL_RGB, GL_FLOAT, NULL);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MAX_LEVEL, 0);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_WRAP_R, GL_CLAMP_TO_EDGE);
    return texture;
}

static gboolean fits(LpcaRevised *r, const struct lpca *grid, GError **error) {
    GLint size = 0;
    glGetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &size);
    const int columns = MIN(grid->n_clusters, size / grid->n_grid);
    const int rows = columns > 0 ? (grid->n_clusters + columns - 1) / columns : G_MAXINT16;
    r->n = grid->n_grid;
    r->n_columns = columns;
    if ((gint64)rows * MAX(1, grid->n_components) * r->n <= size && r->n * r->n + 1 <= size)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "%d clusters of %d components on a grid of %d samples in each direction do not fit "
                "into a 3D texture: %s supports %d texels in each direction; compress with fewer "
                "clusters or components, or draw with --method lpca-grid",
                grid->n_clusters, grid->n_components, r->n, gpu_renderer(), size);
    return FALSE;
}

static gboolean make_volumes(LpcaRevised *r, const struct lpca *grid, GError **error) {
    const int width = r->n_columns * r->n, depth = r->n * r->n + 1;
    const int rows = (grid->n_clusters + r->n_columns - 1) / r->n_columns;
    r->means = volume(GL_RGBA16F, width, rows * r->n, depth);
    r->brdfs = volume(GL_RGBA8_SNORM, width, rows * MAX(1, grid->n_components) * r->n, depth);
    return gpu_check("the eigen-BRDFs' 3D textures", error);
}

static void put_table(const LpcaRevised *r, struct lpca *grid, int cluster, int i, float *block,
                      gint8 *steps) {
    const gsize samples = (gsize)r->n * r->n, size = 3 * samples * samples;
    const int table = cluster * (grid->n_components + 1) + i;
    const int x = cluster % r->n_columns * r->n, row = cluster / r->n_columns;
    const int y = (i == 0 ? row : row * grid->n_components + i - 1) * r->n;
    lpca_volumes_block(r->n, grid->brdfs + size * table, block);
    glBindTexture(GL_TEXTURE_3D, i == 0 ? r->means : r->brdfs);
    if (i > 0)
        grid->scales[table] = lpca_volumes_quantise(block, size + 3 * samples, steps);
    else
        for (gsize k = 0; k < size + 3 * samples; k++)
            block[k] = CLAMP(block[k], -HALF_MAX, HALF_MAX);
    glTexSubImage3D(GL_TEXTURE_3D, 0, x, y, 0, r->n, r->n, (int)samples + 1, GL_RGB,
                    i == 0 ? GL_FLOAT : GL_BYTE, i == 0 ? (void *)block : (void *)steps);
}

static gboolean upload(LpcaRevised *r, struct lpca *grid, GError **error) {
    const gsize samples = grid->layout.views.n, values = 3 * samples * (samples + 1);
    if (!fits(r, grid, error) || !make_volumes(r, grid, error))
        return FALSE;
    g_autofree float *block = g_new(float, values);
    g_autofree gint8 *steps = g_new(gint8, values);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    for (int k = 0; k < grid->n_clusters; k++)
        for (int i = 0; i <= grid->n_components; i++)
            put_table(r, grid, k, i, block, steps);
    return gpu_check("the eigen-BRDFs' 3D textures", error);
}

static void square_of(struct vec3 d, double ret[2]) {
    const float at[3] = {(float)d.x, (float)d.y, (float)d.z};
    direction_grid_square(at, &ret[0], &ret[1]);
}

static void fill_view(struct vec3 direction, gpointer data, float ret[4]) {
    double at[2];
    square_of(direction, at);
    ret[0] = (float)at[0];
    ret[1] = (float)at[1];
    ret[2] = ret[3] = 0;
}

static void fill_light(struct vec3 direction, gpointer data, float ret[4]) {
    const LpcaRevised *r = data;
    double at[2];
    square_of(direction, at);
    const double t = at[1] * (r->n - 1), s = 0.5 + at[0] * (r->n - 1), depth = r->n * r->n + 1;
    const int i = MIN((int)t, r->n - 2);
    ret[0] = (float)((i * r->n + s) / depth);
    ret[1] = (float)(((i + 1) * r->n + s) / depth);
    ret[2] = (float)(t - i);
    ret[3] = 0;
}

static gboolean make(LpcaRevised *r, const struct lpca_pyramid *pyramid, int n_grid,
                     GError **error) {
    if (!lpca_pyramid_is_linear(pyramid, error))
        return FALSE;
    struct lpca *grid =
        lpca_volumes_on_grid(pyramid->lpca, n_grid ? n_grid : fitting(pyramid->lpca), error);
    const gboolean ok = grid != NULL && upload(r, grid, error) &&
                        lpca_texels_init(&r->texels, pyramid, grid->scales, error);
    lpca_free(grid);
    if (!ok)
        return FALSE;
    r->view_map = cube_map_new(VIEW_SIZE, TRUE, fill_view, r);
    r->light_map = cube_map_new(LIGHT_SIZE, FALSE, fill_light, r);
    return gpu_check("the cube maps", error);
}

LpcaRevised *lpca_revised_new(struct lpca *const *levels, int n, int n_grid, GError **error) {
    g_autoptr(LpcaRevised) revised = g_new0(LpcaRevised, 1);
    struct lpca_pyramid pyramid;
    const gboolean ok =
        lpca_pyramid_init(&pyramid, levels, n, error) && make(revised, &pyramid, n_grid, error);
    lpca_pyramid_clear(&pyramid);
    return ok ? g_steal_pointer(&revised) : NULL;
}

void lpca_revised_free(LpcaRevised *revised) {
    if (revised == NULL)
        return;
    const GLuint textures[] = {revised->means, revised->brdfs, revised->view_map,
                               revised->light_map};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    lpca_texels_clear(&revised->texels);
    g_free(revised);
}

static void bind_all(gpointer material, guint program, const struct method_style *style) {
    const LpcaRevised *revised = material;
    glEnable(GL_TEXTURE_CUBE_MAP_SEAMLESS);
    lpca_texels_bind(&revised->texels, program);
    gpu_bind_texture(program, "means", 3, GL_TEXTURE_3D, revised->means);
    gpu_bind_texture(program, "brdfs", 4, GL_TEXTURE_3D, revised->brdfs);
    gpu_bind_texture(program, "view_map", 5, GL_TEXTURE_CUBE_MAP, revised->view_map);
    gpu_bind_texture(program, "light_map", 6, GL_TEXTURE_CUBE_MAP, revised->light_map);
    glUniform1i(glGetUniformLocation(program, "n_grid"), revised->n);
    glUniform1i(glGetUniformLocation(program, "n_columns"), revised->n_columns);
}

static char *constants(gconstpointer material, const struct method_style *style) {
    const LpcaRevised *revised = material;
    return lpca_texels_constants(&revised->texels, style);
}

static gboolean lpca_revised_texels(gconstpointer material, int ret[2]) {
    return lpca_texels_size(&((const struct LpcaRevised *)material)->texels, ret);
}

static gint64 bytes(gconstpointer material) {
    const LpcaRevised *revised = material;
    return lpca_texels_bytes(&revised->texels) + gpu_texture_bytes(GL_TEXTURE_3D, revised->means) +
           gpu_texture_bytes(GL_TEXTURE_3D, revised->brdfs) +
           gpu_texture_bytes(GL_TEXTURE_CUBE_MAP, revised->view_map) +
           gpu_texture_bytes(GL_TEXTURE_CUBE_MAP, revised->light_map);
}

static gpointer open_levels(struct lpca *const *levels, int n, GError **error) {
    return lpca_revised_new(levels, n, 0, error);
}

static gpointer open_file(const char *path, GError **error) {
    return lpca_open_levels(path, open_levels, error);
}

static const char *const shader_names[] = {"levels.glsl", "lpca_texel.glsl", "lpca_revised.glsl",
                                           NULL};

const struct method method_lpca_revised = {
    .name = "lpca-revised",
    .title = "local PCA in a 3D texture",
    .product = "lpca.exr",
    .made_by = "mesorig compress",
    .shaders = shader_names,
    .open = open_file,
    .free = (GDestroyNotify)lpca_revised_free,
    .constants = constants,
    .bytes = bytes,
    .texels = lpca_revised_texels,
    .bind = bind_all,
};
