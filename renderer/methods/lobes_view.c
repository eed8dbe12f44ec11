#include "lobes_view.h"

#include "base/direction.h"
#include "btf/direction_grid.h"
#include "gl/direction_table.h"
#include "gl/gpu.h"

#include <epoxy/gl.h>
#include <math.h>
#include <string.h>

#define COLOURS  3
#define PAGE     4
#define SKY      4 /* lights each way */
#define HALF_MAX 65504.0f

struct LobesView {
    guint values, ambients, pole; /* textures */
    struct direction_textures views;
    int n_levels, n_pages, n_slices, n_lobes;
};

/* Which values of lobes.h lie in a page, four a page; −1: none. */
static int lobes_view_value_at(const struct lobes *lobes, int page, int k) {
    static const int facets[4][PAGE] = {
        {0, 1, 2, 12}, {3, 4, 5, 13}, {6, 7, 8, -1}, {9, 10, 11, -1}};
    if (lobes->model == LOBES_WARD || lobes->model == LOBES_ASHIKHMIN)
        return facets[page][k];
    const gboolean lafortune = lobes->model == LOBES_LAFORTUNE;
    const int first = COLOURS + (lafortune ? 1 : 0);
    if (page == 0)
        return k < COLOURS || lafortune ? k : -1;
    const int value = first + PAGE * (page - 1) + k;
    return value < lobes->n_values ? value : -1;
}

static int count_pages(const struct lobes *lobes) {
    if (lobes->model == LOBES_WARD || lobes->model == LOBES_ASHIKHMIN)
        return 4;
    return 1 + (lobes->model == LOBES_PTM ? 2 : lobes->n_lobes);
}

static gboolean lobes_view_all_finite(const struct lobes *lobes, GError **error) {
    const gsize n = btf_layout_texels(&lobes->layout) * lobes->n_slices * lobes->n_values;
    for (gsize k = 0; k < n; k++)
        if (!isfinite(lobes->values[k])) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "value number %" G_GSIZE_FORMAT " of the %s is not a finite number", k,
                        lobes_model_name(lobes->model));
            return FALSE;
        }
    return TRUE;
}

static gboolean lobes_view_fits(const struct lobes *lobes, int n_pages, GError **error) {
    GLint size = 0, layers = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    if (lobes->layout.width <= (gsize)size && lobes->layout.height <= (gsize)size &&
        lobes->n_slices * n_pages <= layers && lobes->layout.views.n + 1 <= (gsize)layers)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "%zu × %zu texels in %d layers are more than %s takes (%d each way, %d layers); "
                "compress with fewer lobes, or another model",
                lobes->layout.width, lobes->layout.height, lobes->n_slices * n_pages,
                gpu_renderer(), size, layers);
    return FALSE;
}

/* Whether it can be level number of what first is level 0 of. */
static gboolean belongs(const struct lobes *first, const struct lobes *lobes, int number) {
    const gsize views = sizeof(float) * first->layout.views.n;
    return lobes->model == first->model && lobes->n_lobes == first->n_lobes &&
           lobes->layout.width == MAX(1, first->layout.width >> number) &&
           lobes->layout.height == MAX(1, first->layout.height >> number) &&
           lobes->layout.views.n == first->layout.views.n &&
           memcmp(lobes->layout.views.theta_deg, first->layout.views.theta_deg, views) == 0 &&
           memcmp(lobes->layout.views.phi_deg, first->layout.views.phi_deg, views) == 0;
}

static gboolean lobes_view_check(struct lobes *const *levels, int n, int n_pages, GError **error) {
    if (!lobes_view_fits(levels[0], n_pages, error))
        return FALSE;
    for (int k = 0; k < n; k++) {
        if (k > 0 && !belongs(levels[0], levels[k], k)) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "mip level %d is %s of %zu × %zu texels, which does not fit level 0; "
                        "compress the material anew",
                        k, lobes_model_name(levels[k]->model), levels[k]->layout.width,
                        levels[k]->layout.height);
            return FALSE;
        }
        if (!lobes_view_all_finite(levels[k], error)) {
            if (k > 0)
                g_prefix_error(error, "mip level %d: ", k);
            return FALSE;
        }
    }
    return TRUE;
}

static void lobes_view_put_layer(const struct lobes *lobes, int level, int layer,
                                 const float *rgba) {
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, level, 0, 0, layer, lobes->layout.width,
                    lobes->layout.height, 1, GL_RGBA, GL_FLOAT, rgba);
}

static void upload_values(const LobesView *view, const struct lobes *lobes, int level) {
    const gsize texels = btf_layout_texels(&lobes->layout);
    g_autofree float *layer = g_new(float, PAGE *texels);
    for (int n = 0; n < lobes->n_slices * view->n_pages; n++) {
        const float *values = lobes->values + n / view->n_pages * texels * lobes->n_values;
        for (gsize k = 0; k < PAGE * texels; k++) {
            const int at = lobes_view_value_at(lobes, n % view->n_pages, (int)(k % PAGE));
            layer[k] = at < 0 ? 0 : values[k / PAGE * lobes->n_values + at];
        }
        lobes_view_put_layer(lobes, level, n, layer);
    }
}

/* Reflectance of a texel under an even sky, (1/π) ∫ BTF dω, as the sum over SKY² lights of solid
 * angle 2π / SKY² each. */
static void add_sky(const struct lobes *lobes, int slice, int texel, const float view[3],
                    float ret[3]) {
    for (int k = 0; k < SKY * SKY; k++) {
        const int row = k / SKY;
        float light[3], rgb[3];
        direction_grid_direction((k % SKY + 0.5) / SKY, (row + 0.5) / SKY, light);
        lobes_evaluate(lobes, slice, texel, view, light, rgb);
        for (int c = 0; c < COLOURS; c++)
            ret[c] += CLAMP(rgb[c], 0, HALF_MAX / 2) * 2 / (SKY * SKY);
    }
}

/* A layer a view, and one of their pole. */
static void upload_ambients(const struct lobes *lobes, int level, const float *pole_share) {
    const int texels = btf_layout_texels(&lobes->layout);
    g_autofree float *layer = g_new(float, PAGE *(gsize)texels);
    g_autofree float *pole = g_new0(float, PAGE *(gsize)texels);
    for (gsize v = 0; v < lobes->layout.views.n; v++) {
        float direction[3];
        direction_from_deg(lobes->layout.views.theta_deg[v], lobes->layout.views.phi_deg[v],
                           direction);
        memset(layer, 0, sizeof(float) * PAGE * texels);
        for (int k = 0; k < texels; k++)
            add_sky(lobes, lobes->n_slices > 1 ? v : 0, k, direction, layer + PAGE * (gsize)k);
        for (int k = 0; k < PAGE * texels; k++)
            pole[k] += pole_share[v] * layer[k];
        lobes_view_put_layer(lobes, level, v, layer);
    }
    lobes_view_put_layer(lobes, level, lobes->layout.views.n, pole);
}

static gboolean lobes_view_upload(LobesView *view, struct lobes *const *levels,
                                  const float *pole_share, GError **error) {
    const struct lobes *first = levels[0];
    const int n = view->n_levels;
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    view->values = gpu_texture_levels(GL_RGBA16F, first->layout.width, first->layout.height,
                                      view->n_slices * view->n_pages, n);
    if (!gpu_check("the texture of the lobes", error))
        return FALSE;
    for (int k = 0; k < n; k++)
        upload_values(view, levels[k], k);
    if (!gpu_check("the texture of the lobes", error))
        return FALSE;
    view->ambients = gpu_texture_levels(GL_RGBA16F, first->layout.width, first->layout.height,
                                        first->layout.views.n + 1, n);
    for (int k = 0; k < n; k++)
        upload_ambients(levels[k], k, pole_share);
    return gpu_check("the texture of the ambient light", error);
}

/* Which views the pole is the mean of. */
static void upload_pole(LobesView *view, Directions *views) {
    int n;
    const int *members = directions_pole(views, &n);
    g_autofree guint16 *indices = g_new0(guint16, MAX(1, n));
    for (int k = 0; k < n; k++)
        indices[k] = (guint16)members[k];
    view->pole = gpu_texture(GL_R16UI, MAX(1, n), 1, 0);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, MAX(1, n), 1, GL_RED_INTEGER, GL_UNSIGNED_SHORT,
                    indices);
}

LobesView *lobes_view_new(struct lobes *const *levels, int n, GError **error) {
    const struct lobes *lobes = levels[0];
    const int n_pages = count_pages(lobes);
    if (!lobes_view_check(levels, n, n_pages, error))
        return NULL;
    g_autoptr(Directions) views = directions_new(
        lobes->layout.views.theta_deg, lobes->layout.views.phi_deg, lobes->layout.views.n, error);
    if (views == NULL) {
        g_prefix_error(error, "views: ");
        return NULL;
    }
    g_autoptr(LobesView) view = g_new0(LobesView, 1);
    g_autofree float *shares = g_new0(float, lobes->layout.views.n);
    view->n_levels = n;
    view->n_pages = n_pages;
    view->n_slices = lobes->n_slices;
    view->n_lobes = lobes->n_lobes;
    view->views = direction_table_new(views, FALSE);
    upload_pole(view, views);
    direction_table_pole_shares(views, shares, lobes->layout.views.n);
    return lobes_view_upload(view, levels, shares, error) ? g_steal_pointer(&view) : NULL;
}

void lobes_view_free(LobesView *view) {
    if (view == NULL)
        return;
    const GLuint textures[] = {view->values, view->ambients, view->pole};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    direction_textures_clear(&view->views);
    g_free(view);
}

static gint64 lobes_view_bytes(gconstpointer material) {
    const LobesView *view = material;
    return gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->values) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->ambients) +
           gpu_texture_bytes(GL_TEXTURE_2D, view->pole) + direction_textures_bytes(&view->views);
}

static void lobes_view_bind_all(gpointer material, guint program,
                                const struct method_style *style) {
    const LobesView *view = material;
    gpu_bind_texture(program, "values", 0, GL_TEXTURE_2D_ARRAY, view->values);
    gpu_bind_texture(program, "ambients", 1, GL_TEXTURE_2D_ARRAY, view->ambients);
    gpu_bind_texture(program, "pole", 2, GL_TEXTURE_2D, view->pole);
    direction_textures_bind(&view->views, program, "view", 3);
    glUniform1i(glGetUniformLocation(program, "n_pages"), view->n_pages);
    glUniform1i(glGetUniformLocation(program, "n_slices"), view->n_slices);
}

static char *lobes_view_constants(gconstpointer material, const struct method_style *style) {
    const LobesView *view = material;
    return g_strdup_printf("#define N_LEVELS %d\n#define NEAREST %d\n#define SLICED %d\n"
                           "#define N_LOBES %d\n#define ROTATION %d\n",
                           view->n_levels, style->nearest != 0, view->n_slices > 1, view->n_lobes,
                           (int)style->rotation);
}

static gpointer open_model(enum lobes_model model, const char *path, GError **error) {
    struct lobes *levels[LOBES_MAX_LEVELS];
    const int n = lobes_read_levels(path, levels, error);
    LobesView *view = NULL;
    if (n > 0 && levels[0]->model != model)
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "%s holds %s, not %s; draw it with --method %s", path,
                    lobes_model_name(levels[0]->model), lobes_model_name(model),
                    lobes_model_name(levels[0]->model));
    else if (n > 0)
        view = lobes_view_new(levels, n, error);
    for (int k = 0; k < n; k++)
        lobes_free(levels[k]);
    return view;
}

static gpointer open_fields(const char *path, GError **error) {
    return open_model(LOBES_FIELDS, path, error);
}

static gpointer open_ptm(const char *path, GError **error) {
    return open_model(LOBES_PTM, path, error);
}

static gpointer open_lafortune(const char *path, GError **error) {
    return open_model(LOBES_LAFORTUNE, path, error);
}

static gpointer open_ward(const char *path, GError **error) {
    return open_model(LOBES_WARD, path, error);
}

static gpointer open_ashikhmin(const char *path, GError **error) {
    return open_model(LOBES_ASHIKHMIN, path, error);
}

static void lobes_view_free_view(gpointer material) {
    lobes_view_free(material);
}

#define SHARED "directions.glsl", "levels.glsl", "lobes.glsl"
static const char *const fields[] = {SHARED, "fields.glsl", NULL};
static const char *const ptm[] = {SHARED, "ptm.glsl", NULL};
static const char *const lafortune[] = {SHARED, "lafortune.glsl", NULL};
static const char *const ward[] = {SHARED, "ward.glsl", "microfacet.glsl", "facets.glsl", NULL};
static const char *const ashikhmin[] = {SHARED, "ashikhmin.glsl", "microfacet.glsl", "facets.glsl",
                                        NULL};

#define MODEL(model, text)                                                                         \
    {                                                                                              \
        .name = #model, .title = (text), .product = #model ".exr",                                 \
        .made_by = "mesorig compress --method " #model, .shaders = (model), .open = open_##model,  \
        .free = lobes_view_free_view, .constants = lobes_view_constants,                           \
        .bytes = lobes_view_bytes, .bind = lobes_view_bind_all,                                    \
    }

const struct method methods_lobes[LOBES_MODELS] = {
    MODEL(fields, "reflectance fields"),
    MODEL(ptm, "polynomials of each view"),
    MODEL(lafortune, "Lafortune lobes"),
    MODEL(ward, "Ward's model with normals"),
    MODEL(ashikhmin, "Ashikhmin and Shirley's model with normals"),
};
