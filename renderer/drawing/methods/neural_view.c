#include "neural_view.h"

#include "codecs/neural/neural_drawing.h"
#include "drawing/gl/gpu.h"

#include <epoxy/gl.h>

#define GROUP 4 /* channels of a texture */

struct NeuralView {
    int width, height, n_channels, n_levels;
    guint surface, heights, planes, skies; /* textures of neural.glsl */
    /* [0]: height of the byte 0; [1]: height of one step; in texels of level 0 */
    float height_scale[2];
    char *network; /* neural_shader_network() */
};

static void filter(GLenum target, gboolean mipped, GLint wrap) {
    glTexParameteri(target, GL_TEXTURE_MIN_FILTER, mipped ? GL_LINEAR_MIPMAP_LINEAR : GL_LINEAR);
    glTexParameteri(target, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(target, GL_TEXTURE_WRAP_S, wrap);
    glTexParameteri(target, GL_TEXTURE_WRAP_T, wrap);
}

static gboolean upload_planes(NeuralView *view, const struct neural *neural, GError **error) {
    float values[2 * NEURAL_PLANE_VALUES];
    neural_shader_planes(neural, values);
    view->planes = gpu_texture(GL_RGBA32F, NEURAL_PLANE, NEURAL_PLANE, NEURAL_PLANE_LAYERS);
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, 0, NEURAL_PLANE, NEURAL_PLANE,
                    NEURAL_PLANE_LAYERS, GL_RGBA, GL_FLOAT, values);
    filter(GL_TEXTURE_2D_ARRAY, FALSE, GL_CLAMP_TO_EDGE);
    return gpu_check("the textures of directions", error);
}

static void upload_surface_level(const struct neural *neural, int level) {
    const gsize texels = btf_layout_texels(&neural->layout), n = (gsize)neural->n_channels;
    g_autofree guint8 *layer = g_new(guint8, texels * GROUP);
    for (gsize first = 0; first < n; first += GROUP) {
        for (gsize i = 0; i < texels * GROUP; i++)
            layer[i] = neural->surface[i / GROUP * n + first + i % GROUP];
        glTexSubImage3D(GL_TEXTURE_2D_ARRAY, level, 0, 0, (GLint)(first / GROUP),
                        (GLsizei)neural->layout.width, (GLsizei)neural->layout.height, 1, GL_RGBA,
                        GL_UNSIGNED_BYTE, layer);
    }
}

static gboolean upload_texels(NeuralView *view, struct neural *const *levels, int n,
                              GError **error) {
    const int width = view->width, height = view->height;
    view->n_levels = (int)g_bit_storage((gulong)MAX(width, height));
    view->surface =
        gpu_texture_levels(GL_RGBA8, width, height, view->n_channels / GROUP, view->n_levels);
    if (!gpu_check("the surface's texture", error))
        return FALSE;
    for (int k = 0; k < n; k++)
        upload_surface_level(levels[k], k);
    if (n < view->n_levels)
        glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    filter(GL_TEXTURE_2D_ARRAY, TRUE, GL_REPEAT);
    const gsize cells = 4 * btf_layout_texels(&levels[0]->layout);
    g_autofree float *bytes = g_new(float, cells);
    for (gsize i = 0; i < cells; i++)
        bytes[i] = levels[0]->heights[i];
    view->heights = gpu_texture(GL_R16F, 2 * width, 2 * height, 0);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, 2 * width, 2 * height, GL_RED, GL_FLOAT, bytes);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, view->n_levels - 1);
    glGenerateMipmap(GL_TEXTURE_2D);
    filter(GL_TEXTURE_2D, TRUE, GL_REPEAT);
    return gpu_check("the surface's textures", error);
}

static gboolean upload_skies(NeuralView *view, const struct neural *neural, GError **error) {
    int width, height;
    g_autofree float *values = neural_shader_sky(neural, &width, &height);
    const int views = NEURAL_SKY * NEURAL_SKY, longest = MAX(width, height);
    view->skies = gpu_texture_levels(GL_R11F_G11F_B10F, width, height, views,
                                     (int)g_bit_storage((gulong)longest));
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, 0, width, height, views, GL_RGB, GL_FLOAT,
                    values);
    glGenerateMipmap(GL_TEXTURE_2D_ARRAY);
    filter(GL_TEXTURE_2D_ARRAY, TRUE, GL_REPEAT);
    return gpu_check("the texture of the even sky", error);
}

/* Returns whether a model can be mip level `number` of a material. first is level 0 of the
 * material. */
static gboolean belongs(const struct neural *first, const struct neural *neural, int number) {
    return neural->n_channels == first->n_channels &&
           neural->layout.width == MAX(1, first->layout.width >> number) &&
           neural->layout.height == MAX(1, first->layout.height >> number);
}

static gboolean check(struct neural *const *levels, int n, GError **error) {
    const struct btf_layout *layout = &levels[0]->layout;
    GLint size = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    if (2 * MAX(layout->width, layout->height) > (gsize)size) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "the heights of %zu × %zu texels have %zu × %zu cells, but %s supports %d in "
                    "each direction; compress a smaller sample",
                    layout->width, layout->height, 2 * layout->width, 2 * layout->height,
                    gpu_renderer(), size);
        return FALSE;
    }
    for (int k = 1; k < n; k++)
        if (!belongs(levels[0], levels[k], k)) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "mip level %d (%zu × %zu texels of %d channels) does not belong to level 0 "
                        "(%zu × %zu texels of %d channels): the file is damaged; compress the "
                        "material again",
                        k, levels[k]->layout.width, levels[k]->layout.height, levels[k]->n_channels,
                        layout->width, layout->height, levels[0]->n_channels);
            return FALSE;
        }
    return TRUE;
}

NeuralView *neural_view_new(struct neural *const *levels, int n, GError **error) {
    const struct neural *neural = levels[0];
    const double texel_mm = neural->layout.texel_mm;
    g_autoptr(NeuralView) view = g_new0(NeuralView, 1);
    view->width = (int)neural->layout.width;
    view->height = (int)neural->layout.height;
    view->n_channels = neural->n_channels;
    view->height_scale[0] = (float)((double)neural->height_scale.minimum / texel_mm);
    view->height_scale[1] = (float)((double)neural->height_scale.step / texel_mm);
    view->network = neural_shader_network(neural);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    return check(levels, n, error) && upload_texels(view, levels, n, error) &&
                   upload_planes(view, neural, error) && upload_skies(view, neural, error)
               ? g_steal_pointer(&view)
               : NULL;
}

void neural_view_free(NeuralView *view) {
    if (view == NULL)
        return;
    const GLuint textures[] = {view->surface, view->heights, view->planes, view->skies};
    glDeleteTextures(G_N_ELEMENTS(textures), textures);
    g_free(view->network);
    g_free(view);
}

static gpointer neural_view_open(const char *path, GError **error) {
    struct neural *levels[NEURAL_MAX_LEVELS];
    const int n = neural_read_levels(path, levels, error);
    NeuralView *view = n > 0 ? neural_view_new(levels, n, error) : NULL;
    for (int k = 0; k < n; k++)
        neural_free(levels[k]);
    return view;
}

static gboolean texels(gconstpointer material, int ret[2]) {
    const NeuralView *view = material;
    ret[0] = view->width;
    ret[1] = view->height;
    return TRUE;
}

static gint64 bytes(gconstpointer material) {
    const NeuralView *view = material;
    return gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->surface) +
           gpu_texture_bytes(GL_TEXTURE_2D, view->heights) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->planes) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, view->skies);
}

static char *constants(gconstpointer material, const struct method_style *style) {
    const NeuralView *view = material;
    return g_strdup_printf("#define N_CHANNELS %d\n#define N_LEVELS %d\n#define N_RAYS %d\n"
                           "#define NEAREST %d\n%s",
                           view->n_channels, view->n_levels, style->nearest ? NEURAL_RAYS : 1,
                           style->nearest != 0, view->network);
}

static void bind_all(gpointer material, guint program, const struct method_style *style) {
    const NeuralView *view = material;
    gpu_bind_texture(program, "surface", 0, GL_TEXTURE_2D_ARRAY, view->surface);
    gpu_bind_texture(program, "heights", 1, GL_TEXTURE_2D, view->heights);
    gpu_bind_texture(program, "planes", 2, GL_TEXTURE_2D_ARRAY, view->planes);
    gpu_bind_texture(program, "skies", 3, GL_TEXTURE_2D_ARRAY, view->skies);
    glUniform2fv(glGetUniformLocation(program, "height_scale"), 1, view->height_scale);
}

static const char *const shader_names[] = {"levels.glsl", "neural.glsl", NULL};

const struct method method_neural = {
    .name = "neural",
    .title = "Neural planes",
    .product = "neural.exr",
    .made_by = "mesorig compress --method neural",
    .shaders = shader_names,
    .open = neural_view_open,
    .free = (GDestroyNotify)neural_view_free,
    .constants = constants,
    .bytes = bytes,
    .texels = texels,
    .bind = bind_all,
};
