#include "lobes_view.h"

#include "direction_table.h"
#include "gpu.h"
#include "processing/resample.h"

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
    int n_pages, n_slices, n_lobes;
};

/* Which values of lobes.h lie in a page, four a page; −1: none. */
static int value_at(const struct lobes *lobes, int page, int k) {
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

static gboolean check(const struct lobes *lobes, int n_pages, GError **error) {
    const gsize n = (gsize)lobes->width * lobes->height * lobes->n_slices * lobes->n_values;
    GLint size = 0, layers = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    if (lobes->width > size || lobes->height > size || lobes->n_slices * n_pages > layers ||
        lobes->n_views + 1 > layers) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "%d × %d texels in %d layers are more than %s takes (%d each way, %d layers); "
                    "compress with fewer lobes, or another model",
                    lobes->width, lobes->height, lobes->n_slices * n_pages, gpu_renderer(), size,
                    layers);
        return FALSE;
    }
    for (gsize k = 0; k < n; k++)
        if (!isfinite(lobes->values[k])) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "value number %" G_GSIZE_FORMAT " of the %s is not a finite number", k,
                        lobes_model_name(lobes->model));
            return FALSE;
        }
    return TRUE;
}

static guint array_texture(const struct lobes *lobes, int layers) {
    const guint texture = gpu_texture(GL_RGBA16F, lobes->width, lobes->height, layers);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    return texture;
}

static void put_layer(const struct lobes *lobes, int layer, const float *rgba) {
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, layer, lobes->width, lobes->height, 1, GL_RGBA,
                    GL_FLOAT, rgba);
}

static gboolean upload_values(LobesView *view, const struct lobes *lobes, GError **error) {
    const gsize texels = (gsize)lobes->width * lobes->height;
    g_autofree float *layer = g_new(float, PAGE *texels);
    view->values = array_texture(lobes, lobes->n_slices * view->n_pages);
    if (!gpu_check("the texture of the lobes", error))
        return FALSE;
    for (int n = 0; n < lobes->n_slices * view->n_pages; n++) {
        const float *values = lobes->values + n / view->n_pages * texels * lobes->n_values;
        for (gsize k = 0; k < PAGE * texels; k++) {
            const int at = value_at(lobes, n % view->n_pages, (int)(k % PAGE));
            layer[k] = at < 0 ? 0 : values[k / PAGE * lobes->n_values + at];
        }
        put_layer(lobes, n, layer);
    }
    return gpu_check("the texture of the lobes", error);
}

/* Of one texel under an even sky: each of the lights has 2π/n of it, 1/π of that counts. */
static void add_sky(const struct lobes *lobes, int slice, int texel, const float view[3],
                    float ret[3]) {
    for (int k = 0; k < SKY * SKY; k++) {
        const int row = k / SKY;
        float light[3], rgb[3];
        resample_direction((k % SKY + 0.5) / SKY, (row + 0.5) / SKY, light);
        lobes_evaluate(lobes, slice, texel, view, light, rgb);
        for (int c = 0; c < COLOURS; c++)
            ret[c] += CLAMP(rgb[c], 0, HALF_MAX / 2) * 2 / (SKY * SKY);
    }
}

static void direction_of(float theta_deg, float phi_deg, float ret[3]) {
    const double theta = theta_deg * G_PI / 180, phi = phi_deg * G_PI / 180;
    ret[0] = (float)(sin(theta) * cos(phi));
    ret[1] = (float)(sin(theta) * sin(phi));
    ret[2] = (float)cos(theta);
}

/* A layer a view, and one of their pole. */
static gboolean upload_ambients(LobesView *view, const struct lobes *lobes, const float *pole_share,
                                GError **error) {
    const int texels = lobes->width * lobes->height;
    g_autofree float *layer = g_new(float, PAGE *(gsize)texels);
    g_autofree float *pole = g_new0(float, PAGE *(gsize)texels);
    view->ambients = array_texture(lobes, lobes->n_views + 1);
    for (int v = 0; v < lobes->n_views; v++) {
        float direction[3];
        direction_of(lobes->view_theta_deg[v], lobes->view_phi_deg[v], direction);
        memset(layer, 0, sizeof(float) * PAGE * texels);
        for (int k = 0; k < texels; k++)
            add_sky(lobes, lobes->n_slices > 1 ? v : 0, k, direction, layer + PAGE * (gsize)k);
        for (int k = 0; k < PAGE * texels; k++)
            pole[k] += pole_share[v] * layer[k];
        put_layer(lobes, v, layer);
    }
    put_layer(lobes, lobes->n_views, pole);
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

LobesView *lobes_view_new(const struct lobes *lobes, GError **error) {
    const int n_pages = count_pages(lobes);
    if (!check(lobes, n_pages, error))
        return NULL;
    g_autoptr(Directions) views =
        directions_new(lobes->view_theta_deg, lobes->view_phi_deg, lobes->n_views, error);
    if (views == NULL) {
        g_prefix_error(error, "views: ");
        return NULL;
    }
    g_autoptr(LobesView) view = g_new0(LobesView, 1);
    g_autofree float *shares = g_new0(float, lobes->n_views);
    view->n_pages = n_pages;
    view->n_slices = lobes->n_slices;
    view->n_lobes = lobes->n_lobes;
    view->views = direction_table_new(views, FALSE);
    upload_pole(view, views);
    direction_table_pole_shares(views, shares, lobes->n_views);
    if (!upload_values(view, lobes, error) || !upload_ambients(view, lobes, shares, error))
        return NULL;
    return g_steal_pointer(&view);
}

void lobes_view_free(LobesView *view) {
    if (view == NULL)
        return;
    const GLuint textures[] = {view->values, view->ambients, view->pole};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    direction_textures_clear(&view->views);
    g_free(view);
}

static void bind(guint program, const char *name, int unit, GLenum target, guint texture) {
    glActiveTexture(GL_TEXTURE0 + unit);
    glBindTexture(target, texture);
    glUniform1i(glGetUniformLocation(program, name), unit);
}

static gint64 bytes(gconstpointer material) {
    const LobesView *view = material;
    return gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->values) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->ambients) +
           gpu_texture_bytes(GL_TEXTURE_2D, view->pole) + direction_textures_bytes(&view->views);
}

static void bind_all(gpointer material, guint program, const struct method_style *style) {
    const LobesView *view = material;
    bind(program, "values", 0, GL_TEXTURE_2D_ARRAY, view->values);
    bind(program, "ambients", 1, GL_TEXTURE_2D_ARRAY, view->ambients);
    bind(program, "pole", 2, GL_TEXTURE_2D, view->pole);
    direction_textures_bind(&view->views, program, "view", 3);
    glUniform1i(glGetUniformLocation(program, "n_pages"), view->n_pages);
    glUniform1i(glGetUniformLocation(program, "n_slices"), view->n_slices);
    glUniform1i(glGetUniformLocation(program, "n_lobes"), view->n_lobes);
    glUniform1i(glGetUniformLocation(program, "nearest"), style->nearest);
    glUniform1i(glGetUniformLocation(program, "rotation"), (int)style->rotation);
}

static gpointer open_model(enum lobes_model model, const char *path, GError **error) {
    struct lobes *lobes = lobes_read(path, error);
    LobesView *view = NULL;
    if (lobes != NULL && lobes->model != model)
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "%s holds %s, not %s; draw it with --method %s", path,
                    lobes_model_name(lobes->model), lobes_model_name(model),
                    lobes_model_name(lobes->model));
    else if (lobes != NULL)
        view = lobes_view_new(lobes, error);
    lobes_free(lobes);
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

static void free_view(gpointer material) {
    lobes_view_free(material);
}

static const char *const fields[] = {"directions.glsl", "lobes.glsl", "fields.glsl", NULL};
static const char *const ptm[] = {"directions.glsl", "lobes.glsl", "ptm.glsl", NULL};
static const char *const lafortune[] = {"directions.glsl", "lobes.glsl", "lafortune.glsl", NULL};
static const char *const ward[] = {"directions.glsl", "lobes.glsl",  "ward.glsl",
                                   "microfacet.glsl", "facets.glsl", NULL};
static const char *const ashikhmin[] = {"directions.glsl", "lobes.glsl",  "ashikhmin.glsl",
                                        "microfacet.glsl", "facets.glsl", NULL};

#define MODEL(model, text)                                                                         \
    {                                                                                              \
        .name = #model, .title = (text), .product = #model ".exr",                                 \
        .made_by = "mesorig compress --model " #model, .shaders = (model), .open = open_##model,   \
        .free = free_view, .bytes = bytes, .bind = bind_all,                                       \
    }

const struct method methods_lobes[LOBES_MODELS] = {
    MODEL(fields, "reflectance fields"),
    MODEL(ptm, "polynomials of each view"),
    MODEL(lafortune, "Lafortune lobes"),
    MODEL(ward, "Ward's model with normals"),
    MODEL(ashikhmin, "Ashikhmin and Shirley's model with normals"),
};
