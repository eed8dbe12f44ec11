#include "eigenmaps_view.h"

#include "drawing/gl/direction_table.h"
#include "drawing/gl/gpu.h"

#include <epoxy/gl.h>
#include <math.h>
#include <string.h>

#define VIEW_TABLE 256
#define HALF_MAX   65504.0f
#define FINE_BYTES ((gsize)128 << 20) /* maximum size of the finer level; see make_maps() */
#define ANISOTROPY 4.0f

struct EigenmapsView {
    int n_terms, n_layers;    /* n_layers is the number of layers per term */
    gboolean refined;         /* level 0 has twice the resolution of the material */
    guint maps, view_weights; /* textures of eigenmaps.glsl */
    float *means;             /* mean R, G, B of each layer */
    struct direction_textures lights;
};

gboolean eigenmaps_view_check(const struct eigenmaps *maps, GError **error) {
    const struct btf_layout *layout = &maps->layout;
    const gsize n_views = layout->views.n;
    const char *missing = n_views < 1                     ? "views"
                          : layout->lights.n < 1          ? "lights"
                          : maps->n_terms < 1             ? "terms"
                          : btf_layout_texels(layout) < 1 ? "texels"
                                                          : NULL;
    if (missing != NULL) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "the eigen-maps have no %s: the file is damaged; process the session again",
                    missing);
        return FALSE;
    }
    if (!method_check_size(layout, error))
        return FALSE;
    for (gsize k = 0; k < (gsize)maps->n_terms * n_views; k++)
        if (!isfinite(maps->weights[k])) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "the weight of term %zu for view %zu (counted from 0) is not finite: the "
                        "file is damaged; process the session again",
                        k / n_views, k % n_views);
            return FALSE;
        }
    return TRUE;
}

static gboolean check_layers(const struct eigenmaps *maps, GError **error) {
    const gsize n_lights = maps->layout.lights.n, needed = (gsize)maps->n_terms * (n_lights + 2);
    GLint layers = 0;
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    if (needed <= (gsize)layers)
        return TRUE;
    const gsize most = (gsize)layers / (n_lights + 2);
    g_autofree char *fewer = most > 0 ? g_strdup_printf(", or to eigen-maps of at most %zu %s",
                                                        most, most == 1 ? "term" : "terms")
                                      : g_strdup("");
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "eigen-maps of %d terms and %zu lights need %zu texture layers, but %s supports "
                "%d; compress the material with another method, such as lpca, which has no layer "
                "for each light%s",
                maps->n_terms, n_lights, needed, gpu_renderer(), layers, fewer);
    return FALSE;
}

/* Doubles the n samples along one axis of a repeating texture, by Catmull–Rom interpolation a
 * quarter of a texel before and after each sample. step and to_step are the distances from one
 * sample to the next in from and to, in floats. */
static void refine(const float *from, int n, gsize step, float *to, gsize to_step) {
    static const float weights[4] = {-9.0f / 128, 111.0f / 128, 29.0f / 128, -3.0f / 128};
    for (int k = 0; k < n; k++)
        for (int half = 0; half < 2; half++)
            for (int c = 0; c < 3; c++) {
                float sum = 0.0f;
                for (int tap = 0; tap < 4; tap++) {
                    int at = half ? k + tap - 1 : k + 1 - tap;
                    sum += weights[tap] * from[step * ((at + 2 * n) % n) + c];
                }
                to[to_step * (2 * k + half) + c] = sum;
            }
}

/* Clamps the texels of a layer to the range of half floats, stores their mean, and uploads the
 * layer. If view->refined is TRUE, also uploads a level with twice the resolution of the material.
 * Bilinear filtering of this level is about as sharp as bicubic filtering, without more fetches. */
static void put_layer(const EigenmapsView *view, const struct eigenmaps *maps, int layer,
                      float *texels) {
    const gsize w = maps->layout.width, h = maps->layout.height;
    double sums[3] = {0};
    for (gsize k = 0; k < 3 * w * h; k++) {
        texels[k] = CLAMP(texels[k], -HALF_MAX, HALF_MAX);
        sums[k % 3] += texels[k];
    }
    for (int c = 0; c < 3; c++)
        view->means[3 * layer + c] = (float)(sums[c] / (double)(w * h));
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, view->refined ? 1 : 0, 0, 0, layer, (int)w, (int)h, 1,
                    GL_RGB, GL_FLOAT, texels);
    if (!view->refined)
        return;
    g_autofree float *wide = g_new0(float, 2 * 3 * w * h), *fine = g_new0(float, 4 * 3 * w * h);
    for (gsize j = 0; j < h; j++)
        refine(texels + 3 * w * j, (int)w, 3, wide + 6 * w * j, 3);
    for (gsize i = 0; i < 2 * w; i++)
        refine(wide + 3 * i, (int)h, 6 * w, fine + 3 * i, 6 * w);
    for (gsize k = 0; k < 4 * 3 * w * h; k++)
        fine[k] = CLAMP(fine[k], -HALF_MAX, HALF_MAX);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, layer, (int)(2 * w), (int)(2 * h), 1, GL_RGB,
                    GL_FLOAT, fine);
}

/* Allocates the texture. It has a level of twice the resolution (refined) if that level fits into
 * FINE_BYTES and its sides are within the limit of the graphics card. */
static void make_maps(EigenmapsView *view, const struct eigenmaps *maps) {
    int layers = view->n_terms * view->n_layers;
    gsize fine = 4 * 8 * btf_layout_texels(&maps->layout) * layers;
    GLint size = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    view->refined =
        fine <= FINE_BYTES && 2 * MAX(maps->layout.width, maps->layout.height) <= (gsize)size;
    int scale = view->refined ? 2 : 1;
    view->maps =
        gpu_texture(GL_RGBA16F, scale * maps->layout.width, scale * maps->layout.height, layers);
    if (view->refined)
        glTexImage3D(GL_TEXTURE_2D_ARRAY, 1, GL_RGBA16F, maps->layout.width, maps->layout.height,
                     layers, 0, GL_RGB, GL_FLOAT, NULL);
}

/* Uploads one layer: the sum of the maps of a term, each multiplied by the share of its light.
 * Fails if a map with a share has a value that is not finite. texels is scratch memory for one
 * layer. */
static gboolean mix_layer(const EigenmapsView *view, const struct eigenmaps *maps, int term,
                          gsize layer, const float *shares, float *texels, GError **error) {
    const gsize n = 3 * btf_layout_texels(&maps->layout), width = maps->layout.width;
    memset(texels, 0, sizeof(float) * n);
    for (gsize light = 0; light < maps->layout.lights.n; light++) {
        const float *map = maps->maps + n * ((gsize)term * maps->layout.lights.n + light);
        for (gsize k = 0; shares[light] != 0.0f && k < n; k++) {
            if (!isfinite(map[k])) {
                g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                            "the value of term %d and light %zu at texel (%zu, %zu) (counted from "
                            "0) is not finite: the file is damaged; process the session again",
                            term, light, k / 3 % width, k / 3 / width);
                return FALSE;
            }
            texels[k] += shares[light] * map[k];
        }
    }
    put_layer(view, maps, (int)layer, texels);
    return TRUE;
}

/* Uploads the means of the layers as the mip level that has one texel. This is needed because
 * drivers compute this texel from only a part of the texels if a side is not a power of two. */
static void put_means(const EigenmapsView *view, const struct eigenmaps *maps) {
    const gsize side = MAX(maps->layout.width, maps->layout.height) * (view->refined ? 2 : 1);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, (int)g_bit_storage(side) - 1, 0, 0, 0, 1, 1,
                    view->n_terms * view->n_layers, GL_RGB, GL_FLOAT, view->means);
}

static gboolean upload_maps(EigenmapsView *view, const struct eigenmaps *maps, const float *pole,
                            const float *ambient, GError **error) {
    g_autofree float *texels = g_new(float, 3 * btf_layout_texels(&maps->layout));
    g_autofree float *one = g_new0(float, maps->layout.lights.n);
    make_maps(view, maps);
    if (!gpu_check("the material's texture", error)) {
        g_prefix_error(error, "%zu × %zu texels in %d layers: ", maps->layout.width,
                       maps->layout.height, view->n_terms * view->n_layers);
        return FALSE;
    }
    for (int term = 0; term < view->n_terms; term++) {
        int base = term * view->n_layers;
        for (gsize light = 0; light < maps->layout.lights.n; light++) {
            one[light] = 1.0f;
            if (!mix_layer(view, maps, term, base + light, one, texels, error))
                return FALSE;
            one[light] = 0.0f;
        }
        if (!mix_layer(view, maps, term, base + maps->layout.lights.n, pole, texels, error) ||
            !mix_layer(view, maps, term, base + maps->layout.lights.n + 1, ambient, texels, error))
            return FALSE;
    }
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAX_LEVEL, 1000);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_WRAP_S, GL_REPEAT);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_WRAP_T, GL_REPEAT);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_BASE_LEVEL, view->refined ? 1 : 0);
    glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    put_means(view, maps);
    /* Anisotropic filtering is not used with software renderers, because it takes them many times
     * as long. Supersampling gives the same quality there. */
    gboolean software = strstr(gpu_renderer(), "llvmpipe") || strstr(gpu_renderer(), "softpipe");
    if (!software && epoxy_has_gl_extension("GL_EXT_texture_filter_anisotropic")) {
        GLfloat most = 1.0f;
        glGetFloatv(GL_MAX_TEXTURE_MAX_ANISOTROPY_EXT, &most);
        glTexParameterf(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAX_ANISOTROPY_EXT, MIN(most, ANISOTROPY));
    }
    return gpu_check("the material's texture", error);
}

static float weight_at(const struct eigenmaps *maps, const Directions *views, int term,
                       const struct direction_weights *at) {
    const float *w = maps->weights + (gsize)term * maps->layout.views.n;
    double sum = 0.0;
    int n;
    const int *members = directions_pole(views, &n);
    for (int k = 0; k < 4; k++)
        if ((gsize)at->index[k] < maps->layout.views.n)
            sum += at->weight[k] * w[at->index[k]];
        else
            for (int m = 0; m < n; m++)
                sum += at->weight[k] * w[members[m]] / n;
    return sum;
}

/* The outermost samples of the table lie on the horizon, so filtering needs no values below the
 * horizon. */
guint eigenmaps_view_weights(const struct eigenmaps *maps, GError **error) {
    g_autoptr(Directions) views = method_directions(&maps->layout.views, "views", FALSE, error);
    if (!views)
        return 0;
    int n_pages = (maps->n_terms + 3) / 4;
    gsize page = 4 * VIEW_TABLE * VIEW_TABLE;
    g_autofree float *table = g_new0(float, n_pages *page);
    for (int j = 0; j < VIEW_TABLE; j++)
        for (int i = 0; i < VIEW_TABLE; i++) {
            struct direction_weights w;
            directions_weights(views,
                               directions_from_square(-1.0 + 2.0 * i / (VIEW_TABLE - 1),
                                                      -1.0 + 2.0 * j / (VIEW_TABLE - 1)),
                               &w);
            for (int term = 0; term < maps->n_terms; term++)
                table[term / 4 * page + 4 * ((gsize)j * VIEW_TABLE + i) + term % 4] =
                    weight_at(maps, views, term, &w);
        }
    const guint texture = gpu_texture(GL_RGBA32F, VIEW_TABLE, VIEW_TABLE, n_pages);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, 0, VIEW_TABLE, VIEW_TABLE, n_pages, GL_RGBA,
                    GL_FLOAT, table);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    return texture;
}

EigenmapsView *eigenmaps_view_new(const struct eigenmaps *maps, GError **error) {
    if (!check_layers(maps, error) || !eigenmaps_view_check(maps, error))
        return NULL;
    g_autoptr(Directions) lights = method_directions(&maps->layout.lights, "lights", FALSE, error);
    if (!lights)
        return NULL;
    g_autoptr(EigenmapsView) view = g_new0(EigenmapsView, 1);
    g_autofree float *pole = g_new0(float, maps->layout.lights.n);
    g_autofree float *ambient = g_new0(float, maps->layout.lights.n);
    view->n_terms = maps->n_terms;
    view->n_layers = maps->layout.lights.n + 2;
    view->means = g_new0(float, 3 * (gsize)view->n_terms * (gsize)view->n_layers);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    direction_table_pole_shares(lights, pole, maps->layout.lights.n);
    directions_sky(lights, ambient);
    view->lights = direction_table_new(lights, TRUE);
    view->view_weights = eigenmaps_view_weights(maps, error);
    if (view->view_weights == 0 || !upload_maps(view, maps, pole, ambient, error))
        return NULL;
    return g_steal_pointer(&view);
}

void eigenmaps_view_free(EigenmapsView *view) {
    if (view == NULL)
        return;
    const GLuint textures[] = {view->maps, view->view_weights};
    direction_textures_clear(&view->lights);
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    g_free(view->means);
    g_free(view);
}

static void bind_all(gpointer material, guint program, const struct method_style *style) {
    const EigenmapsView *view = material;
    gpu_bind_texture(program, "view_weights", 1, GL_TEXTURE_2D_ARRAY, view->view_weights);
    direction_textures_bind(&view->lights, program, "light", 2);
    gpu_bind_texture(program, "maps", 0, GL_TEXTURE_2D_ARRAY, view->maps);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_BASE_LEVEL,
                    style->nearest && view->refined ? 1 : 0);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER,
                    style->nearest ? GL_NEAREST : GL_LINEAR_MIPMAP_LINEAR);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER,
                    style->nearest ? GL_NEAREST : GL_LINEAR);
    glUniform1i(glGetUniformLocation(program, "n_terms"), view->n_terms);
    glUniform1i(glGetUniformLocation(program, "n_layers"), view->n_layers);
}

static gint64 bytes(gconstpointer material) {
    const EigenmapsView *view = material;
    return gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->maps) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->view_weights) +
           direction_textures_bytes(&view->lights);
}

static gboolean eigenmaps_view_texels(gconstpointer material, int ret[2]) {
    const EigenmapsView *view = material;
    gpu_texture_size(GL_TEXTURE_2D_ARRAY, view->maps, view->refined ? 1 : 0, ret);
    return TRUE;
}

static gpointer open_file(const char *path, GError **error) {
    struct eigenmaps *maps = eigenmaps_read(path, error);
    EigenmapsView *view = maps != NULL ? eigenmaps_view_new(maps, error) : NULL;
    eigenmaps_free(maps);
    return view;
}

static const char *const shader_names[] = {"eigenmaps.glsl", NULL};

const struct method method_eigenmaps = {
    .name = "eigenmaps",
    .title = "eigen-maps",
    .product = "eigenmaps.exr",
    .made_by = "mesorig process",
    .shaders = shader_names,
    .open = open_file,
    .free = (GDestroyNotify)eigenmaps_view_free,
    .bytes = bytes,
    .texels = eigenmaps_view_texels,
    .bind = bind_all,
};
