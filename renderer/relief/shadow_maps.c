#include "shadow_maps.h"

#include "gl/gpu.h"

#include <epoxy/gl.h>
#include <math.h>
#include <string.h>

#define SLACK 2.0 /* in texels */
#define REACH 2.0 /* in radii; see shadow_maps_range() */
#define RANGE 4.0

/* Everything that a map depends on. */
struct key {
    const MdfTexture *mdf; /* NULL: there is no map yet */
    struct places_source places;
    guint serial;
    float light[3], tiles[2];
    struct visibility_options options;
};

struct ShadowMaps {
    gboolean layered;
    guint program, texture, framebuffer;
    int size, n;
    struct key keys[SHADOW_MAPS_MOST];
};

ShadowMaps *shadow_maps_new(gboolean layered, GError **error) {
    static const char *const names[] = {"screen.vert", "shadow_map.frag", NULL};
    g_autoptr(ShadowMaps) maps = g_new0(ShadowMaps, 1);
    maps->layered = layered;
    if ((maps->program = gpu_program("", names, error)) == 0)
        return NULL;
    glGenFramebuffers(1, &maps->framebuffer);
    return g_steal_pointer(&maps);
}

void shadow_maps_free(ShadowMaps *maps) {
    if (maps == NULL)
        return;
    glDeleteProgram(maps->program);
    glDeleteTextures(1, &maps->texture);
    glDeleteFramebuffers(1, &maps->framebuffer);
    g_free(maps);
}

void shadow_maps_forget(ShadowMaps *maps) {
    memset(maps->keys, 0, sizeof maps->keys);
}

guint shadow_maps_texture(const ShadowMaps *maps) {
    return maps->texture;
}

static gboolean shadow_maps_make(ShadowMaps *maps, int size, int n, GError **error) {
    const GLenum target = maps->layered ? GL_TEXTURE_2D_ARRAY : GL_TEXTURE_2D;
    if (maps->texture != 0 && maps->size == size && maps->n == n)
        return TRUE;
    GLint largest = 0, layers = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &largest);
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    if (size > largest || n > (maps->layered ? MIN(layers, SHADOW_MAPS_MOST) : 1)) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "%d shadow maps of %d × %d: %s takes %d each way, and %d of them; choose a "
                    "smaller --shadow-map",
                    n, size, size, gpu_renderer(), largest, layers);
        return FALSE;
    }
    glDeleteTextures(1, &maps->texture);
    shadow_maps_forget(maps);
    maps->texture = gpu_texture(GL_DEPTH_COMPONENT32F, size, size, maps->layered ? n : 0);
    maps->size = size;
    maps->n = n;
    glTexParameteri(target, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(target, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(target, GL_TEXTURE_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE);
    glTexParameteri(target, GL_TEXTURE_COMPARE_FUNC, GL_LEQUAL);
    if (gpu_check("making shadow maps", error))
        return TRUE;
    glDeleteTextures(1, &maps->texture);
    maps->texture = 0;
    return FALSE;
}

static void shadow_maps_cross(const float a[3], const float b[3], float ret[3]) {
    for (int k = 0; k < 3; k++)
        ret[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

void shadow_maps_right(const float towards[3], float ret[3]) {
    const gboolean steep = fabsf(towards[2]) > 0.9f;
    const float pole[3] = {0.0f, steep ? 1.0f : 0.0f, steep ? 0.0f : 1.0f};
    shadow_maps_cross(pole, towards, ret);
    const float length = sqrtf(ret[0] * ret[0] + ret[1] * ret[1] + ret[2] * ret[2]);
    for (int k = 0; k < 3; k++)
        ret[k] /= length;
}

void shadow_maps_range(const ShadowMaps *maps, double radius, float ret[3]) {
    const double texel = 2.0 * radius / MAX(maps->size, 1);
    ret[0] = (float)(REACH * radius);
    ret[1] = (float)(RANGE * radius);
    ret[2] = (float)(SLACK * texel);
}

/* From far away along light: a sphere of the radius fills the picture. Column-major. */
static void lamp_matrix(const float light[3], double radius, float ret[16]) {
    float right[3], up[3];
    shadow_maps_right(light, right);
    shadow_maps_cross(light, right, up);
    memset(ret, 0, 16 * sizeof(float));
    for (int k = 0; k < 3; k++) {
        ret[4 * k] = (float)(right[k] / radius);
        ret[4 * k + 1] = (float)(up[k] / radius);
        ret[4 * k + 2] = (float)(-light[k] / radius);
    }
    ret[15] = 1.0f;
}

static void draw_map(const ShadowMaps *maps, int layer, double radius, guint seen) {
    glBindFramebuffer(GL_FRAMEBUFFER, maps->framebuffer);
    if (maps->layered)
        glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, maps->texture, 0, layer);
    else
        glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, maps->texture,
                               0);
    glDrawBuffer(GL_NONE);
    glViewport(0, 0, maps->size, maps->size);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_ALWAYS);
    glDepthMask(GL_TRUE);
    glUseProgram(maps->program);
    gpu_bind_texture(maps->program, "seen", 0, GL_TEXTURE_2D, seen);
    glUniform1f(glGetUniformLocation(maps->program, "range"), (float)(RANGE * radius));
    gpu_fill_screen();
    glDepthFunc(GL_LESS);
}

static gboolean same_floats(const float *a, const float *b, int n) {
    for (int k = 0; k < n; k++)
        if (a[k] != b[k])
            return FALSE;
    return TRUE;
}

static gboolean same_key(const struct key *a, const struct key *b) {
    return a->mdf == b->mdf && a->places.index == b->places.index &&
           a->places.endless == b->places.endless && a->serial == b->serial &&
           same_floats(a->light, b->light, 3) && same_floats(a->tiles, b->tiles, 2) &&
           a->options.way == b->options.way && a->options.layers == b->options.layers &&
           a->options.straight == b->options.straight;
}

gboolean shadow_maps_find(ShadowMaps *maps, Visibility *visibility,
                          const struct shadow_scene *scene, const float (*towards)[3], int n,
                          GError **error) {
    struct visibility_scene seen_from = scene->casting;
    struct key key = {.mdf = seen_from.mdf,
                      .places = seen_from.places,
                      .serial = scene->serial,
                      .tiles = {seen_from.tiles[0], seen_from.tiles[1]},
                      .options = seen_from.options};
    if (!shadow_maps_make(maps, scene->size, n, error))
        return FALSE;
    for (int k = 0; k < n; k++) {
        guint seen;
        memcpy(key.light, towards[k], sizeof key.light);
        if (same_key(&key, &maps->keys[k]))
            continue;
        maps->keys[k].mdf = NULL;
        lamp_matrix(towards[k], scene->radius, seen_from.projection);
        memcpy(seen_from.sight, towards[k], sizeof key.light);
        seen_from.sight[3] = 0.0f;
        seen_from.reach = (float)(REACH * scene->radius);
        seen_from.width = seen_from.height = maps->size;
        if (!visibility_find(visibility, &seen_from, &seen, error))
            return FALSE;
        draw_map(maps, k, scene->radius, seen);
        maps->keys[k] = key;
    }
    return gpu_check("drawing shadow maps", error);
}
