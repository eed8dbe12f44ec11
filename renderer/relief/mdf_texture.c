#include "mdf_texture.h"

#include "gl/direction_table.h"
#include "gl/gpu.h"
#include "mdf_codecs/mdf_tabulated.h"

#include <epoxy/gl.h>
#include <string.h>

struct MdfTexture {
    guint depths; /* views: a layer each, and one for the pole; factors: four maps a layer */
    struct direction_textures views; /* of views; 0 for factors */
    guint factors; /* W_1 … W_c by direction, four a layer, and W_0 in the last layer */
    int n_terms;   /* c, see mdf_factors.h; 0: views */
    double scale_mm, least_mm; /* depth of views = least_mm + scale_mm · value */
    double width_mm, height_mm, deepest_mm;
};

static gboolean mdf_texture_check(int width, int height, int n_layers, GError **error) {
    GLint layers = 0, size = 0;
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    if (n_layers <= layers && width <= size && height <= size)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "an MDF of %d × %d texels in %d layers is too large: %s takes %d texels each way "
                "in %d layers; "
                "process the material with fewer texels or views",
                width, height, n_layers, gpu_renderer(), size, layers);
    return FALSE;
}

/* Number of layers of an MDF in factors: the channels of one layer hold four maps. */
static int n_map_layers(int n_terms) {
    return mdf_factors_layers(n_terms);
}

/* The depths at the pole: the mean of the topmost ring of views, height × width. */
static float *pole_view(const struct mdf_table *t, const Directions *directions) {
    gsize n = (gsize)t->width * t->height;
    g_autofree float *shares = g_new0(float, t->n_views);
    float *mean = g_new0(float, n);
    direction_table_pole_shares(directions, shares, t->n_views);
    for (int k = 0; k < t->n_views; k++)
        for (gsize i = 0; shares[k] > 0.0f && i < n; i++)
            mean[i] += t->depth_mm[k * n + i] * shares[k];
    return mean;
}

static void upload_views(MdfTexture *texture, const struct mdf_table *t,
                         const Directions *directions) {
    g_autofree float *mean = pole_view(t, directions);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_R16F, t->width, t->height, t->n_views + 1, 0, GL_RED,
                 GL_FLOAT, NULL);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, 0, t->width, t->height, t->n_views, GL_RED,
                    GL_FLOAT, t->depth_mm);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, t->n_views, t->width, t->height, 1, GL_RED,
                    GL_FLOAT, mean);
    glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    texture->scale_mm = 1.0;
}

/* The next mip level: the mean of each 2 × 2 texels, in place. */
static void halve(float *depth, int w, int h) {
    int to_w = MAX(w / 2, 1), to_h = MAX(h / 2, 1);
    for (int j = 0; j < to_h; j++)
        for (int i = 0; i < to_w; i++) {
            float sum = 0.0f;
            for (int k = 0; k < 4; k++)
                sum += depth[(gsize)MIN(2 * j + k / 2, h - 1) * w + MIN(2 * i + k % 2, w - 1)];
            depth[(gsize)j * to_w + i] = 0.25f * sum;
        }
}

/* glGenerateMipmap() does not take compressed formats: each mip level is averaged and encoded
 * here. */
static void upload_blocks(MdfTexture *texture, const struct mdf_table *t,
                          const struct mdf_blocks *blocks, const Directions *directions) {
    gsize n = (gsize)t->width * t->height;
    double least = blocks->least_mm, deepest = blocks->deepest_mm;
    g_autofree float *mean = pole_view(t, directions), *views = g_new(float, n *(t->n_views + 1));
    memcpy(views, t->depth_mm, sizeof(float) * n * t->n_views);
    memcpy(views + n * t->n_views, mean, sizeof(float) * n);
    int w = t->width, h = t->height, level = 0;
    for (;; level++) {
        gsize size = mdf_blocks_bytes(w, h);
        g_autofree guint8 *bytes = g_new(guint8, size * (t->n_views + 1));
        for (int k = 0; k <= t->n_views; k++)
            mdf_blocks_encode(views + n * k, w, h, least, deepest, bytes + size * k);
        if (level == 0)
            memcpy(bytes, blocks->blocks, size * blocks->n_views);
        glCompressedTexImage3D(GL_TEXTURE_2D_ARRAY, level, GL_COMPRESSED_RED_RGTC1, w, h,
                               t->n_views + 1, 0, size * (t->n_views + 1), bytes);
        if (w == 1 && h == 1)
            break;
        for (int k = 0; k <= t->n_views; k++)
            halve(views + n * k, w, h);
        w = MAX(w / 2, 1);
        h = MAX(h / 2, 1);
    }
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAX_LEVEL, level);
    texture->least_mm = least;
    texture->scale_mm = deepest - least;
}

static void mdf_texture_upload_maps(MdfTexture *texture, const struct mdf_factors *f) {
    gsize n = (gsize)f->width * f->height;
    g_autofree guint8 *texels = g_new(guint8, MDF_TABULATED_MAPS * n);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_RGBA8, f->width, f->height, n_map_layers(f->n_terms), 0,
                 GL_RGBA, GL_UNSIGNED_BYTE, NULL);
    for (int layer = 0; layer < n_map_layers(f->n_terms); layer++) {
        for (gsize k = 0; k < MDF_TABULATED_MAPS * n; k++) {
            gsize term = (gsize)layer * MDF_TABULATED_MAPS + k % MDF_TABULATED_MAPS;
            texels[k] = term < (gsize)f->n_terms ? f->maps[term * n + k / MDF_TABULATED_MAPS] : 0;
        }
        glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, layer, f->width, f->height, 1, GL_RGBA,
                        GL_UNSIGNED_BYTE, texels);
    }
    glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    texture->n_terms = f->n_terms;
}

static void upload_factors(MdfTexture *texture, const struct mdf_factors *f,
                           const Directions *views) {
    const int size = MDF_TABULATED_SIZE, layers = n_map_layers(f->n_terms) + 1;
    g_autofree float *table = mdf_factors_tabulate(f, views);
    texture->factors = gpu_texture(GL_RGBA16F, size, size, layers);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, 0, size, size, layers, GL_RGBA, GL_FLOAT, table);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
}

/* The part common to the three forms. */
struct extent_mm {
    int width, height, n_views;
    double texel_mm, deepest_mm;
    const float *theta_deg, *phi_deg;
};

MdfTexture *mdf_texture_new(const struct mdf_source *source, GError **error) {
    const struct mdf_table *t = source->table;
    const struct mdf_factors *f = source->factors;
    const struct extent_mm e =
        f != NULL ? (struct extent_mm){f->width,      f->height,    f->n_views, f->texel_mm,
                                       f->deepest_mm, f->theta_deg, f->phi_deg}
                  : (struct extent_mm){t->width,      t->height,    t->n_views, t->texel_mm,
                                       t->deepest_mm, t->theta_deg, t->phi_deg};
    if (!mdf_texture_check(e.width, e.height, f != NULL ? n_map_layers(f->n_terms) : e.n_views + 1,
                           error))
        return NULL;
    g_autoptr(Directions) directions = directions_new(e.theta_deg, e.phi_deg, e.n_views, error);
    if (directions == NULL) {
        g_prefix_error(error, "views of the MDF: ");
        return NULL;
    }
    g_autoptr(MdfTexture) texture = g_new0(MdfTexture, 1);
    texture->views.target = GL_TEXTURE_2D; /* also where factors leave its textures 0 */
    texture->width_mm = e.width * e.texel_mm;
    texture->height_mm = e.height * e.texel_mm;
    texture->deepest_mm = e.deepest_mm;
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glGenTextures(1, &texture->depths);
    glBindTexture(GL_TEXTURE_2D_ARRAY, texture->depths);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_NEAREST);
    if (f != NULL) {
        mdf_texture_upload_maps(texture, f);
        upload_factors(texture, f, directions);
    } else {
        if (source->blocks != NULL)
            upload_blocks(texture, t, source->blocks, directions);
        else
            upload_views(texture, t, directions);
        texture->views = direction_table_new(directions, FALSE);
    }
    return gpu_check("uploading the MDF", error) ? g_steal_pointer(&texture) : NULL;
}

void mdf_texture_free(MdfTexture *texture) {
    if (texture == NULL)
        return;
    glDeleteTextures(1, &texture->depths);
    glDeleteTextures(1, &texture->factors);
    direction_textures_clear(&texture->views);
    g_free(texture);
}

gboolean mdf_texture_is_maps(const MdfTexture *texture) {
    return texture->factors != 0;
}

gint64 mdf_texture_bytes(const MdfTexture *texture) {
    return texture == NULL ? 0
                           : gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, texture->depths) +
                                 gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, texture->factors) +
                                 direction_textures_bytes(&texture->views);
}

void mdf_texture_bind(const MdfTexture *texture, guint program) {
    gpu_bind_texture(program, "mdf_depths", MDF_TEXTURE_UNIT, GL_TEXTURE_2D_ARRAY, texture->depths);
    direction_textures_bind(&texture->views, program, "mdf", MDF_TEXTURE_UNIT + 1);
    gpu_bind_texture(program, "mdf_factors", MDF_FACTORS_UNIT, GL_TEXTURE_2D_ARRAY,
                     texture->factors);
    glUniform2f(glGetUniformLocation(program, "mdf_range"), texture->least_mm, texture->scale_mm);
    glUniform1i(glGetUniformLocation(program, "mdf_layers"), n_map_layers(texture->n_terms));
    glUniform2f(glGetUniformLocation(program, "mdf_size"), texture->width_mm, texture->height_mm);
    glUniform1f(glGetUniformLocation(program, "mdf_deepest"), texture->deepest_mm);
}
