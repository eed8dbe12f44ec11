#include "relief.h"

#include "gpu.h"

#include <epoxy/gl.h>
#include <math.h>
#include <string.h>

#define SLACK        1e-4 /* of distances from the eye, in radii */
#define SHADOW_SLACK 2.0  /* in texels of the shadow map */
#define REACH        2.0  /* in radii; see shadow_range in shadow.glsl */
#define RANGE        4.0

/* Whatever a shadow map depends on. */
struct map_key {
    const MdfTexture *mdf;
    guint serial;
    int size;
    float light[3], tiles[2];
    struct visibility_options options;
};

struct Relief {
    MdfTexture *mdf, *smooth;
    Visibility *eye, *lamp; /* each keeps its textures at their size */
    guint map_program, empty_array;
    guint map, map_framebuffer;
    int map_size;
    struct map_key key; /* mdf NULL: there is no map yet */
    /* Of what was prepared. */
    gboolean silhouettes, shadows;
    guint seen;
    float matrix[16], light[3], radius;
};

Relief *relief_new(GError **error) {
    static const char *const map[] = {"screen.vert", "shadow_map.frag", NULL};
    float zero = 0.0f;
    const struct mdf_table flat = {1, 1, 1, 1.0, &zero, &zero, &zero, 0.0, NULL};
    g_autoptr(Relief) relief = g_new0(Relief, 1);
    glGenVertexArrays(1, &relief->empty_array);
    if ((relief->smooth = mdf_texture_new(&flat, error)) == NULL ||
        (relief->eye = visibility_new(error)) == NULL ||
        (relief->lamp = visibility_new(error)) == NULL ||
        (relief->map_program = gpu_program(map, error)) == 0)
        return NULL;
    return g_steal_pointer(&relief);
}

void relief_free(Relief *relief) {
    if (relief == NULL)
        return;
    mdf_texture_free(relief->mdf);
    mdf_texture_free(relief->smooth);
    visibility_free(relief->eye);
    visibility_free(relief->lamp);
    glDeleteProgram(relief->map_program);
    glDeleteVertexArrays(1, &relief->empty_array);
    glDeleteTextures(1, &relief->map);
    glDeleteFramebuffers(1, &relief->map_framebuffer);
    g_free(relief);
}

static gboolean take_texture(Relief *relief, MdfTexture *texture) {
    if (texture == NULL)
        return FALSE;
    mdf_texture_free(relief->mdf);
    relief->mdf = texture;
    relief->key.mdf = NULL;
    return TRUE;
}

gboolean relief_set_mdf(Relief *relief, const struct mdf_table *mdf, GError **error) {
    if (mdf != NULL)
        return take_texture(relief, mdf_texture_new(mdf, error));
    g_clear_pointer(&relief->mdf, mdf_texture_free);
    relief->key.mdf = NULL;
    return TRUE;
}

gboolean relief_set_blocks(Relief *relief, const struct mdf_table *mdf,
                           const struct mdf_blocks *blocks, GError **error) {
    return take_texture(relief, mdf_texture_new_blocks(mdf, blocks, error));
}

gboolean relief_set_factors(Relief *relief, const struct mdf_factors *mdf, GError **error) {
    return take_texture(relief, mdf_texture_new_factors(mdf, error));
}

gint64 relief_mdf_bytes(const Relief *relief) {
    return mdf_texture_bytes(relief->mdf);
}

static gboolean make_map(Relief *relief, int size, GError **error) {
    GLint largest = 0;
    if (relief->map != 0 && relief->map_size == size)
        return TRUE;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &largest);
    if (size > largest) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "a shadow map of %d × %d: %s takes %d each way", size, size, gpu_renderer(),
                    largest);
        return FALSE;
    }
    glDeleteTextures(1, &relief->map);
    if (relief->map_framebuffer == 0)
        glGenFramebuffers(1, &relief->map_framebuffer);
    relief->map = gpu_texture(GL_DEPTH_COMPONENT32F, size, size, 0);
    relief->map_size = size;
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_COMPARE_FUNC, GL_LEQUAL);
    glBindFramebuffer(GL_FRAMEBUFFER, relief->map_framebuffer);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, relief->map, 0);
    glDrawBuffer(GL_NONE);
    return gpu_check("making the shadow map", error);
}

static void cross(const float a[3], const float b[3], float ret[3]) {
    for (int k = 0; k < 3; k++)
        ret[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

/* From far away along light: a sphere of the radius fills the picture. Column-major. */
static void lamp_matrix(const float light[3], double radius, float ret[16]) {
    float right[3], up[3], pole[3] = {0.0f, 0.0f, 1.0f};
    if (fabsf(light[2]) > 0.9f)
        memcpy(pole, (float[3]){0.0f, 1.0f, 0.0f}, sizeof pole);
    cross(pole, light, right);
    float length = sqrtf(right[0] * right[0] + right[1] * right[1] + right[2] * right[2]);
    for (int k = 0; k < 3; k++)
        right[k] /= length;
    cross(light, right, up);
    memset(ret, 0, 16 * sizeof(float));
    for (int k = 0; k < 3; k++) {
        ret[4 * k] = right[k] / radius;
        ret[4 * k + 1] = up[k] / radius;
        ret[4 * k + 2] = -light[k] / radius;
    }
    ret[15] = 1.0f;
}

static void draw_map(const Relief *relief, guint seen) {
    glBindFramebuffer(GL_FRAMEBUFFER, relief->map_framebuffer);
    glViewport(0, 0, relief->map_size, relief->map_size);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_ALWAYS);
    glDepthMask(GL_TRUE);
    glUseProgram(relief->map_program);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, seen);
    glUniform1i(glGetUniformLocation(relief->map_program, "seen"), 0);
    glUniform1f(glGetUniformLocation(relief->map_program, "range"), RANGE * relief->radius);
    glBindVertexArray(relief->empty_array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glBindVertexArray(0);
    glDepthFunc(GL_LESS);
}

static gboolean same_floats(const float *a, const float *b, int n) {
    for (int k = 0; k < n; k++)
        if (a[k] != b[k])
            return FALSE;
    return TRUE;
}

static gboolean same_map(const struct map_key *a, const struct map_key *b) {
    return a->mdf == b->mdf && a->serial == b->serial && a->size == b->size &&
           same_floats(a->light, b->light, 3) && same_floats(a->tiles, b->tiles, 2) &&
           a->options.way == b->options.way && a->options.layers == b->options.layers &&
           a->options.straight == b->options.straight;
}

static gboolean find_shadows(Relief *relief, const struct view_settings *s,
                             struct visibility_scene *scene, const struct relief_scene *from,
                             GError **error) {
    guint seen;
    struct map_key key = {.mdf = scene->mdf,
                          .serial = from->serial,
                          .size = s->shadow_size,
                          .tiles = {scene->tiles[0], scene->tiles[1]},
                          .options = scene->options};
    memcpy(key.light, relief->light, sizeof key.light);
    if (same_map(&key, &relief->key))
        return TRUE;
    relief->key.mdf = NULL;
    lamp_matrix(relief->light, relief->radius, relief->matrix);
    memcpy(scene->projection, relief->matrix, sizeof relief->matrix);
    memcpy(scene->sight, relief->light, sizeof relief->light);
    scene->sight[3] = 0.0f;
    scene->width = scene->height = s->shadow_size;
    scene->n_indices = from->n_casting;
    if (!make_map(relief, s->shadow_size, error) ||
        !visibility_find(relief->lamp, scene, &seen, error))
        return FALSE;
    draw_map(relief, seen);
    relief->key = key;
    return TRUE;
}

static gboolean check(const Relief *relief, const struct view_settings *s, GError **error) {
    if (!s->silhouettes || relief->mdf != NULL)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                "silhouettes need the material's distances, an mdf.exr: “mesorig process” makes it "
                "from a session with laser sweeps");
    return FALSE;
}

gboolean relief_prepare(Relief *relief, const struct view_settings *s,
                        const struct relief_scene *from, GError **error) {
    struct visibility_scene scene = {
        .mdf = s->silhouettes ? relief->mdf : relief->smooth,
        .array = from->array,
        .n_indices = from->n_indices,
        .sight = {from->eye[0], from->eye[1], from->eye[2], 1.0f},
        .reach = REACH * from->radius,
        .tiles = {from->tiles[0], from->tiles[1]},
        .width = from->width,
        .height = from->height,
        .options = s->visibility,
    };
    if (!check(relief, s, error))
        return FALSE;
    memcpy(scene.projection, from->projection, sizeof from->projection);
    memcpy(relief->light, from->light, sizeof from->light);
    relief->radius = from->radius;
    relief->silhouettes = s->silhouettes;
    relief->shadows = s->shadows;
    if (s->silhouettes && !visibility_find(relief->eye, &scene, &relief->seen, error))
        return FALSE;
    return !s->shadows || find_shadows(relief, s, &scene, from, error);
}

void relief_bind(const Relief *relief, guint program) {
    float texel = 2.0f * relief->radius / MAX(relief->map_size, 1);
    glActiveTexture(GL_TEXTURE0 + VISIBILITY_UNIT);
    glBindTexture(GL_TEXTURE_2D, relief->silhouettes ? relief->seen : 0);
    glActiveTexture(GL_TEXTURE0 + VISIBILITY_UNIT + 1);
    glBindTexture(GL_TEXTURE_2D, relief->shadows ? relief->map : 0);
    glActiveTexture(GL_TEXTURE0);
    glUniform1i(glGetUniformLocation(program, "seen"), VISIBILITY_UNIT);
    glUniform1i(glGetUniformLocation(program, "shadow_map"), VISIBILITY_UNIT + 1);
    glUniform1i(glGetUniformLocation(program, "silhouettes"), relief->silhouettes);
    glUniform1i(glGetUniformLocation(program, "shadows"), relief->shadows);
    glUniform1f(glGetUniformLocation(program, "slack"), SLACK * relief->radius);
    glUniformMatrix4fv(glGetUniformLocation(program, "shadow_matrix"), 1, GL_FALSE, relief->matrix);
    glUniform3fv(glGetUniformLocation(program, "shadow_light"), 1, relief->light);
    glUniform3f(glGetUniformLocation(program, "shadow_range"), REACH * relief->radius,
                RANGE * relief->radius, SHADOW_SLACK * texel);
}
