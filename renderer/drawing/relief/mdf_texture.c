#include "mdf_texture.h"

#include "base/direction.h"
#include "codecs/mdf_codecs/mdf_tabulated.h"
#include "drawing/gl/direction_table.h"
#include "drawing/gl/gpu.h"
#include "drawing/gl/ring_slices.h"
#include "mdf/mdf_shell.h"

#include <epoxy/gl.h>
#include <math.h>
#include <string.h>

struct MdfTexture {
    /* Texture of the depths. An MDF of views has one layer per view, and one for the pole. An MDF
     * of factors has layers of four maps. */
    guint depths;
    struct direction_textures views; /* directions of views; 0 for factors */
    /* Texture of the weights of the factors (mdf_factors.h) by direction: W_1 … W_c, four per
     * layer, and W_0 in the last layer. 0 for an MDF of views. */
    guint factors;
    int n_terms;             /* c, see mdf_factors.h; 0 for views */
    double scale_mm, min_mm; /* depth of a view = min_mm + scale_mm · value */
    double width_mm, height_mm, deepest_mm;
    int width, height, n_views;
    float *theta_deg, *phi_deg; /* n_views elements */
    struct mdf_table *measured; /* copy of the measured views */
    guint shell;                /* texture; 0 before it is first used */
    /* For along.glsl; all are 0 before they are first used.
     * along_views: directions of the measured views
     * along_depths: depths of these views, as shares of the largest depth
     * along: triangulation of these views */
    guint along_views, along_depths;
    struct direction_textures along;
    double most_per_mm, top_mm; /* as in mdf_shell.h */
    guint volume;               /* texture; 0 before it is first used */
    double longest_mm;          /* scale of the volume */
    struct ring_slices rings;   /* of the volume */
};

static gboolean check(int width, int height, int n_layers, GError **error) {
    GLint layers = 0, size = 0;
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    if (n_layers <= layers && width <= size && height <= size)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "an MDF of %d × %d texels in %d layers is too large: %s supports %d texels in each "
                "direction in %d layers; capture or import the material with fewer texels or views",
                width, height, n_layers, gpu_renderer(), size, layers);
    return FALSE;
}

/* Returns the number of layers of an MDF in factors. The channels of one layer hold four maps. */
static int n_map_layers(int n_terms) {
    return mdf_factors_layers(n_terms);
}

/* Returns the depths at the pole, the mean of the topmost ring of views: height × width. */
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

/* Computes the next mip level in place: the mean of each 2 × 2 texels. */
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

/* Uploads blocks. glGenerateMipmap() does not accept compressed formats, so each mip level is
 * averaged and encoded here. */
static void upload_blocks(MdfTexture *texture, const struct mdf_table *t,
                          const struct mdf_blocks *blocks, const Directions *directions) {
    gsize n = (gsize)t->width * t->height;
    double least = blocks->min_mm, deepest = blocks->deepest_mm;
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
    texture->min_mm = least;
    texture->scale_mm = deepest - least;
}

static void upload_maps(MdfTexture *texture, const struct mdf_factors *f) {
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

/* Computes the next mip level in place. A texel is the root of the mean square of g (mdf_shell.h)
 * over 2 × 2 voxels of a layer. This is a compromise: the mean of g makes grass too thin, and the
 * mean of σ ∝ g⁴ makes a weave too thick. */
static void halve_shell(guint8 *values, int w, int h, int depth) {
    const int to_w = MAX(w / 2, 1), to_h = MAX(h / 2, 1);
    for (int l = 0; l < depth; l++)
        for (int j = 0; j < to_h; j++)
            for (int i = 0; i < to_w; i++) {
                double sum = 0.0;
                for (int k = 0; k < 4; k++) {
                    const int x = MIN(2 * i + k % 2, w - 1), y = MIN(2 * j + k / 2, h - 1);
                    const double g = values[((gsize)l * h + y) * w + x];
                    sum += g * g;
                }
                values[((gsize)l * to_h + j) * to_w + i] = (guint8)lrint(sqrt(sum / 4.0));
            }
}

gboolean mdf_texture_make_shell(MdfTexture *texture, GError **error) {
    GLint most = 0;
    if (texture->shell != 0)
        return TRUE;
    g_autoptr(MdfShell) shell = mdf_shell_new(texture->measured);
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &most);
    if (MAX(shell->width, shell->height) > most) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "the shell of an MDF has %d × %d voxels in a layer: %s supports %d in each "
                    "direction; use --mdf-views",
                    shell->width, shell->height, gpu_renderer(), most);
        return FALSE;
    }
    texture->most_per_mm = shell->most_per_mm;
    texture->top_mm = shell->top_mm;
    glGenTextures(1, &texture->shell);
    glBindTexture(GL_TEXTURE_2D_ARRAY, texture->shell);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_NEAREST);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    int w = shell->width, h = shell->height;
    for (int level = 0;; level++) {
        glTexImage3D(GL_TEXTURE_2D_ARRAY, level, GL_R8, w, h, shell->depth, 0, GL_RED,
                     GL_UNSIGNED_BYTE, shell->values);
        if (w == 1 && h == 1)
            break;
        halve_shell(shell->values, w, h, shell->depth);
        w = MAX(w / 2, 1);
        h = MAX(h / 2, 1);
    }
    return gpu_check("uploading the shell of the MDF", error);
}

gboolean mdf_texture_make_along(MdfTexture *texture, GError **error) {
    const struct mdf_table *t = texture->measured;
    const gsize n = (gsize)t->width * t->height * t->n_views;
    if (texture->along_depths != 0)
        return TRUE;
    if (!check(t->width, t->height, t->n_views, error))
        return FALSE;
    g_autoptr(Directions) triangles =
        directions_new_triangulated(t->theta_deg, t->phi_deg, t->n_views, error);
    if (triangles == NULL) {
        g_prefix_error(error, "views of the MDF: ");
        return FALSE;
    }
    g_autofree float *views = g_new(float, 4 * (gsize)t->n_views);
    g_autofree guint8 *depths = g_new(guint8, n);
    const double scale = texture->deepest_mm > 0.0 ? 255.0 / texture->deepest_mm : 0.0;
    for (int k = 0; k < t->n_views; k++) {
        direction_from_deg(t->theta_deg[k], t->phi_deg[k], views + 4 * k);
        views[4 * k + 3] = 0.0f;
    }
    for (gsize i = 0; i < n; i++)
        depths[i] = (guint8)lrint(CLAMP(t->depth_mm[i] * scale, 0.0, 255.0));
    texture->along = direction_table_new(triangles, FALSE);
    texture->along_views = gpu_texture(GL_RGBA32F, t->n_views, 1, 0);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, t->n_views, 1, GL_RGBA, GL_FLOAT, views);
    glGenTextures(1, &texture->along_depths);
    glBindTexture(GL_TEXTURE_2D_ARRAY, texture->along_depths);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_NEAREST);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_R8, t->width, t->height, t->n_views, 0, GL_RED,
                 GL_UNSIGNED_BYTE, depths);
    glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    return gpu_check("uploading the depths of the MDF's views", error);
}

/* The values that all three forms of an MDF (views, blocks, factors) have in common. */
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
    if (!check(e.width, e.height, f != NULL ? n_map_layers(f->n_terms) : e.n_views + 1, error))
        return NULL;
    g_autoptr(Directions) directions = directions_new(e.theta_deg, e.phi_deg, e.n_views, error);
    if (directions == NULL) {
        g_prefix_error(error, "views of the MDF: ");
        return NULL;
    }
    g_autoptr(MdfTexture) texture = g_new0(MdfTexture, 1);
    /* The object must be valid from here on, because it is freed on an error, although there may be
     * no textures yet. */
    texture->views.target = texture->along.target = GL_TEXTURE_2D;
    texture->width_mm = e.width * e.texel_mm;
    texture->height_mm = e.height * e.texel_mm;
    texture->deepest_mm = e.deepest_mm;
    texture->width = e.width;
    texture->height = e.height;
    texture->n_views = e.n_views;
    texture->theta_deg = g_memdup2(e.theta_deg, sizeof(float) * e.n_views);
    texture->phi_deg = g_memdup2(e.phi_deg, sizeof(float) * e.n_views);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glGenTextures(1, &texture->depths);
    glBindTexture(GL_TEXTURE_2D_ARRAY, texture->depths);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_NEAREST);
    if (f != NULL) {
        upload_maps(texture, f);
        upload_factors(texture, f, directions);
    } else {
        if (source->blocks != NULL)
            upload_blocks(texture, t, source->blocks, directions);
        else
            upload_views(texture, t, directions);
        texture->views = direction_table_new(directions, FALSE);
    }
    texture->measured = f != NULL ? mdf_factors_table(f) : mdf_table_copy_measured(t);
    return gpu_check("uploading the MDF", error) ? g_steal_pointer(&texture) : NULL;
}

void mdf_texture_free(MdfTexture *texture) {
    if (texture == NULL)
        return;
    glDeleteTextures(1, &texture->depths);
    glDeleteTextures(1, &texture->factors);
    glDeleteTextures(1, &texture->volume);
    glDeleteTextures(1, &texture->shell);
    glDeleteTextures(1, &texture->along_views);
    glDeleteTextures(1, &texture->along_depths);
    direction_textures_clear(&texture->along);
    mdf_table_free(texture->measured);
    g_free(texture->theta_deg);
    g_free(texture->phi_deg);
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
                                 gpu_texture_bytes(GL_TEXTURE_3D, texture->volume) +
                                 gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, texture->shell) +
                                 gpu_texture_bytes(GL_TEXTURE_2D, texture->along_views) +
                                 gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, texture->along_depths) +
                                 direction_textures_bytes(&texture->along) +
                                 direction_textures_bytes(&texture->views);
}

/* Returns the distance along the ray at texel i of a view. values are the values of the texels of
 * the view. */
static double distance_mm(const MdfTexture *texture, const float *values, int view, gsize i) {
    return (texture->min_mm + texture->scale_mm * values[i]) /
           cos(texture->theta_deg[view] * (G_PI / 180.0));
}

static void upload_volume(MdfTexture *texture) {
    gsize n = (gsize)texture->width * texture->height;
    const struct ring_slices *rings = &texture->rings;
    const int slices = rings->n_slices;
    g_autofree float *values = g_new(float, n *(texture->n_views + 1)); /* includes the pole */
    g_autofree guint8 *bytes = g_new(guint8, n * slices);
    glBindTexture(GL_TEXTURE_2D_ARRAY, texture->depths);
    glGetTexImage(GL_TEXTURE_2D_ARRAY, 0, GL_RED, GL_FLOAT, values);
    for (int view = 0; view < texture->n_views; view++)
        for (gsize i = 0; i < n; i++)
            texture->longest_mm =
                MAX(texture->longest_mm, distance_mm(texture, values + n * view, view, i));
    const double scale = texture->longest_mm > 0.0 ? 255.0 / texture->longest_mm : 0.0;
    for (int slice = 0; slice < slices; slice++) {
        const int view = ring_slices_direction(rings, slice);
        for (gsize i = 0; i < n; i++) {
            const double mm = distance_mm(texture, values + n * view, view, i);
            bytes[n * slice + i] = (guint8)lrint(CLAMP(mm * scale, 0.0, 255.0));
        }
    }
    glGenTextures(1, &texture->volume);
    glBindTexture(GL_TEXTURE_3D, texture->volume);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_WRAP_R, GL_CLAMP_TO_EDGE);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexImage3D(GL_TEXTURE_3D, 0, GL_R8, texture->width, texture->height, slices, 0, GL_RED,
                 GL_UNSIGNED_BYTE, bytes);
}

gboolean mdf_texture_make_volume(MdfTexture *texture, GError **error) {
    GLint most = 0;
    if (texture->volume != 0)
        return TRUE;
    if (mdf_texture_is_maps(texture)) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "--mdf-volume needs the distances of single views, but the MDF is stored as "
                    "factors: leave --mdf-volume out");
        return FALSE;
    }
    if (!ring_slices_find(texture->theta_deg, texture->phi_deg, texture->n_views,
                          &texture->rings)) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "--mdf-volume needs an MDF whose views are evenly spaced on at most %d rings "
                    "of increasing θ, but this MDF has other views: leave --mdf-volume out",
                    RING_SLICES_MAX);
        return FALSE;
    }
    glGetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &most);
    int longest = MAX(MAX(texture->width, texture->height), texture->rings.n_slices);
    if (longest > most) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "an MDF of %d × %d texels and %d views does not fit into a 3D texture: %s "
                    "supports %d texels in each direction; leave --mdf-volume out",
                    texture->width, texture->height, texture->n_views, gpu_renderer(), most);
        return FALSE;
    }
    upload_volume(texture);
    return gpu_check("uploading the MDF as a volume", error);
}

void mdf_texture_size_mm(const MdfTexture *texture, float ret[2]) {
    ret[0] = (float)texture->width_mm;
    ret[1] = (float)texture->height_mm;
}

void mdf_texture_bind(const MdfTexture *texture, guint program) {
    if (glGetUniformLocation(program, "mdf_shell") >= 0) {
        gpu_bind_texture(program, "mdf_shell", MDF_TEXTURE_UNIT, GL_TEXTURE_2D_ARRAY,
                         texture->shell);
        glUniform1f(glGetUniformLocation(program, "mdf_most_per_mm"), texture->most_per_mm);
        glUniform1f(glGetUniformLocation(program, "mdf_top"), texture->top_mm);
    } else if (glGetUniformLocation(program, "mdf_volume") >= 0) {
        gpu_bind_texture(program, "mdf_volume", MDF_TEXTURE_UNIT, GL_TEXTURE_3D, texture->volume);
        glUniform1f(glGetUniformLocation(program, "mdf_longest"), texture->longest_mm);
        glUniform1i(glGetUniformLocation(program, "mdf_rings"), texture->rings.n_rings);
        glUniform4fv(glGetUniformLocation(program, "mdf_ring"), texture->rings.n_rings,
                     texture->rings.rings[0]);
    } else
        gpu_bind_texture(program, "mdf_depths", MDF_TEXTURE_UNIT, GL_TEXTURE_2D_ARRAY,
                         texture->depths);
    direction_textures_bind(&texture->views, program, "mdf", MDF_TEXTURE_UNIT + 1);
    gpu_bind_texture(program, "mdf_factors", MDF_FACTORS_UNIT, GL_TEXTURE_2D_ARRAY,
                     texture->factors);
    glUniform2f(glGetUniformLocation(program, "mdf_range"), texture->min_mm, texture->scale_mm);
    glUniform1i(glGetUniformLocation(program, "mdf_layers"), n_map_layers(texture->n_terms));
    glUniform2f(glGetUniformLocation(program, "mdf_size"), texture->width_mm, texture->height_mm);
    glUniform1f(glGetUniformLocation(program, "mdf_deepest"), texture->deepest_mm);
}

void mdf_texture_bind_along(const MdfTexture *texture, guint program) {
    if (texture->along_depths == 0)
        return;
    gpu_bind_texture(program, "along_depths", MDF_TEXTURE_UNIT, GL_TEXTURE_2D_ARRAY,
                     texture->along_depths);
    direction_textures_bind(&texture->along, program, "along", MDF_TEXTURE_UNIT + 1);
    gpu_bind_texture(program, "along_views", MDF_FACTORS_UNIT, GL_TEXTURE_2D, texture->along_views);
    glUniform1f(glGetUniformLocation(program, "along_mm"), texture->deepest_mm);
}
