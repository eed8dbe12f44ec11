#include "hsh_view.h"

#include "gl/direction_table.h"
#include "gl/gpu.h"

#include <epoxy/gl.h>
#include <math.h>

#define COLOURS 3
#define PAGE    4 /* numbers of a texel in a layer */

struct HshView {
    guint values, ambients, pole; /* textures */
    struct direction_textures views;
    int n_levels, n_pages, n_views, n_terms;
};

/* Layers of a view: for each four terms one a colour, then one of R G B for a term that is left. */
static int hsh_view_pages(int n_terms) {
    return COLOURS * (n_terms / PAGE) + n_terms % PAGE;
}

/* Which value of a texel (term × COLOURS + colour) is number k of a page; −1: none. */
static int hsh_view_value_at(int n_terms, int page, int k) {
    const int whole = n_terms / PAGE, term = page / COLOURS * PAGE + k;
    if (page < COLOURS * whole)
        return term * COLOURS + page % COLOURS;
    return k < COLOURS ? (whole * PAGE + page - COLOURS * whole) * COLOURS + k : -1;
}

static gboolean hsh_view_check(const struct hsh *hsh, GError **error) {
    const int n_layers = hsh->layout.views.n * hsh_view_pages(hsh->n_terms);
    const gsize n = (gsize)(hsh_bytes(hsh) / 2);
    GLint size = 0, layers = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    if (hsh->layout.width > (gsize)size || hsh->layout.height > (gsize)size || n_layers > layers) {
        g_set_error(
            error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
            "%zu × %zu texels in %d layers are more than %s takes (%d each way, %d layers); "
            "compress with fewer --terms, or with another method",
            hsh->layout.width, hsh->layout.height, n_layers, gpu_renderer(), size, layers);
        return FALSE;
    }
    for (gsize k = 0; k < n; k++)
        if (!isfinite(hsh->values[k])) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "value number %" G_GSIZE_FORMAT " of the hemispherical harmonics is not a "
                        "finite number; compress the material again",
                        k);
            return FALSE;
        }
    return TRUE;
}

static void hsh_view_put_layer(const struct hsh *hsh, int layer, const float *rgba) {
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, layer, hsh->layout.width, hsh->layout.height, 1,
                    GL_RGBA, GL_FLOAT, rgba);
}

static gboolean hsh_view_upload_values(HshView *view, const struct hsh *hsh, GError **error) {
    const gsize texels = btf_layout_texels(&hsh->layout), n_values = (gsize)hsh->n_terms * COLOURS;
    g_autofree float *layer = g_new(float, PAGE *texels);
    view->values = gpu_texture_levels(GL_RGBA16F, hsh->layout.width, hsh->layout.height,
                                      hsh->layout.views.n * view->n_pages, view->n_levels);
    if (!gpu_check("the texture of the hemispherical harmonics", error))
        return FALSE;
    for (gsize n = 0; n < hsh->layout.views.n * view->n_pages; n++) {
        const float *values = hsh->values + n / view->n_pages * texels * n_values;
        for (gsize k = 0; k < PAGE * texels; k++) {
            const int at = hsh_view_value_at(hsh->n_terms, n % view->n_pages, (int)(k % PAGE));
            layer[k] = at < 0 ? 0 : values[k / PAGE * n_values + at];
        }
        hsh_view_put_layer(hsh, n, layer);
    }
    glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    return gpu_check("the texture of the hemispherical harmonics", error);
}

/* √(2/π) c_0: a layer a view, and one of their pole. pole_share: n_views. */
static gboolean hsh_view_upload_ambients(HshView *view, const struct hsh *hsh,
                                         const float *pole_share, GError **error) {
    const gsize texels = btf_layout_texels(&hsh->layout), n_values = (gsize)hsh->n_terms * COLOURS;
    g_autofree float *layer = g_new0(float, PAGE *texels), *pole = g_new0(float, PAGE *texels);
    view->ambients = gpu_texture_levels(GL_RGBA16F, hsh->layout.width, hsh->layout.height,
                                        hsh->layout.views.n + 1, view->n_levels);
    if (!gpu_check("the texture of the ambient light", error))
        return FALSE;
    for (gsize v = 0; v < hsh->layout.views.n; v++) {
        for (gsize k = 0; k < PAGE * texels; k++) {
            const float *values = hsh->values + (v * texels + k / PAGE) * n_values;
            const float sum = k % PAGE < COLOURS ? (float)sqrt(2 / G_PI) * values[k % PAGE] : 0;
            layer[k] = fmaxf(sum, 0);
            pole[k] += pole_share[v] * layer[k];
        }
        hsh_view_put_layer(hsh, v, layer);
    }
    hsh_view_put_layer(hsh, hsh->layout.views.n, pole);
    glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    return gpu_check("the texture of the ambient light", error);
}

/* Which views the pole is the mean of. */
static void hsh_view_upload_pole(HshView *view, Directions *views) {
    int n;
    const int *members = directions_pole(views, &n);
    g_autofree guint16 *indices = g_new0(guint16, MAX(1, n));
    for (int k = 0; k < n; k++)
        indices[k] = (guint16)members[k];
    view->pole = gpu_texture(GL_R16UI, MAX(1, n), 1, 0);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, MAX(1, n), 1, GL_RED_INTEGER, GL_UNSIGNED_SHORT,
                    indices);
}

HshView *hsh_view_new(const struct hsh *hsh, GError **error) {
    if (!hsh_view_check(hsh, error))
        return NULL;
    g_autoptr(Directions) views = directions_new(
        hsh->layout.views.theta_deg, hsh->layout.views.phi_deg, hsh->layout.views.n, error);
    if (views == NULL) {
        g_prefix_error(error, "views: ");
        return NULL;
    }
    g_autoptr(HshView) view = g_new0(HshView, 1);
    g_autofree float *shares = g_new0(float, hsh->layout.views.n);
    view->n_levels = (int)g_bit_storage((gulong)MAX(hsh->layout.width, hsh->layout.height));
    view->n_pages = hsh_view_pages(hsh->n_terms);
    view->n_views = hsh->layout.views.n;
    view->n_terms = hsh->n_terms;
    view->views = direction_table_new(views, FALSE);
    hsh_view_upload_pole(view, views);
    direction_table_pole_shares(views, shares, hsh->layout.views.n);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    return hsh_view_upload_values(view, hsh, error) &&
                   hsh_view_upload_ambients(view, hsh, shares, error)
               ? g_steal_pointer(&view)
               : NULL;
}

void hsh_view_free(HshView *view) {
    if (view == NULL)
        return;
    const GLuint textures[] = {view->values, view->ambients, view->pole};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    direction_textures_clear(&view->views);
    g_free(view);
}

static gpointer hsh_view_open(const char *path, GError **error) {
    struct hsh *hsh = hsh_read(path, error);
    HshView *view = hsh ? hsh_view_new(hsh, error) : NULL;
    hsh_free(hsh);
    return view;
}

static void hsh_view_free_material(gpointer material) {
    hsh_view_free(material);
}

static gint64 hsh_view_bytes(gconstpointer material) {
    const HshView *view = material;
    return gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->values) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->ambients) +
           gpu_texture_bytes(GL_TEXTURE_2D, view->pole) + direction_textures_bytes(&view->views);
}

static char *hsh_view_constants(gconstpointer material, const struct method_style *style) {
    const HshView *view = material;
    return g_strdup_printf("#define N_LEVELS %d\n#define NEAREST %d\n#define SLICED 1\n"
                           "#define N_LOBES 0\n#define N_TERMS %d\n",
                           view->n_levels, style->nearest != 0, view->n_terms);
}

static void hsh_view_bind_texture(guint program, const char *name, int unit, GLenum target,
                                  guint texture) {
    glActiveTexture(GL_TEXTURE0 + unit);
    glBindTexture(target, texture);
    glUniform1i(glGetUniformLocation(program, name), unit);
}

static void hsh_view_bind(gpointer material, guint program, const struct method_style *style) {
    const HshView *view = material;
    hsh_view_bind_texture(program, "values", 0, GL_TEXTURE_2D_ARRAY, view->values);
    hsh_view_bind_texture(program, "ambients", 1, GL_TEXTURE_2D_ARRAY, view->ambients);
    hsh_view_bind_texture(program, "pole", 2, GL_TEXTURE_2D, view->pole);
    direction_textures_bind(&view->views, program, "view", 3);
    glUniform1i(glGetUniformLocation(program, "n_pages"), view->n_pages);
    glUniform1i(glGetUniformLocation(program, "n_slices"), view->n_views);
}

static const char *const hsh_view_shaders[] = {"directions.glsl", "levels.glsl", "lobes.glsl",
                                               "hsh.glsl", NULL};

const struct method method_hsh = {
    .name = "hsh",
    .title = "Hemispherical harmonics",
    .product = "hsh.exr",
    .made_by = "mesorig compress --method hsh",
    .shaders = hsh_view_shaders,
    .open = hsh_view_open,
    .free = hsh_view_free_material,
    .constants = hsh_view_constants,
    .bytes = hsh_view_bytes,
    .bind = hsh_view_bind,
};
