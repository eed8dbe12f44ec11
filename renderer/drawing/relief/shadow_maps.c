#include "shadow_maps.h"

#include "drawing/gl/gpu.h"

#include <epoxy/gl.h>
#include <math.h>
#include <string.h>

#define SLACK 2.0 /* depth bias, in texels */
/* Depths in the map of a distant lamp, in radii of the mesh: distance of depth 0 from the origin,
 * and length from depth 0 to depth 1; see shadow_maps_range(). */
#define REACH 2.0
#define RANGE 4.0

/* A lamp without a cone has six maps if it is nearer to the origin than this, in radii of the mesh.
 */
#define NEAR 1.2
/* A near lamp with a cone has six maps if half the angle of the cone is larger than this, in
 * radians. */
#define WIDE  (75.0 * G_PI / 180)
#define FACES 6 /* number of maps of such a lamp: the faces of a cube */

/* Everything on which a map depends. */
struct key {
    guint64 parts; /* result of parts_hash(); 0 if there is no map yet */
    guint serial;
    struct shadow_lamp lamp;
    struct visibility_options options;
};

struct ShadowMaps {
    gboolean layered;
    guint program, texture, framebuffer;
    /* `size` is the width and height of a map, and `n` the number of layers */
    int size, n;
    struct key keys[SHADOW_MAPS_LAYER]; /* keys of the layers */
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

static gboolean make(ShadowMaps *maps, int size, int n, GError **error) {
    const GLenum target = maps->layered ? GL_TEXTURE_2D_ARRAY : GL_TEXTURE_2D;
    if (maps->texture != 0 && maps->size == size && maps->n == n)
        return TRUE;
    GLint largest = 0, layers = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &largest);
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
    const int most = maps->layered ? MIN(layers, SHADOW_MAPS_LAYER) : 1;
    if (size > largest) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "a shadow map of %d × %d texels is not possible: %s supports %d in each "
                    "direction; choose a smaller --shadow-map",
                    size, size, gpu_renderer(), largest);
        return FALSE;
    }
    if (n > most) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "the lamps need %d shadow maps, but %s supports %d; give fewer lamps", n,
                    gpu_renderer(), most);
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

static void cross(const float a[3], const float b[3], float ret[3]) {
    for (int k = 0; k < 3; k++)
        ret[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

void shadow_maps_right(const float towards[3], float ret[3]) {
    const gboolean steep = fabsf(towards[2]) > 0.9f;
    const float pole[3] = {0.0f, steep ? 1.0f : 0.0f, steep ? 0.0f : 1.0f};
    cross(pole, towards, ret);
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

static double place_distance(const struct shadow_lamp *lamp) {
    const float *p = lamp->place;
    return sqrt((double)p[0] * p[0] + (double)p[1] * p[1] + (double)p[2] * p[2]);
}

static gboolean lamp_has_cone(const struct shadow_lamp *lamp) {
    return lamp->cone_rad > 0.0F && (double)lamp->cone_rad <= WIDE;
}

/* Returns the number of maps of a lamp, 1 or FACES. */
static int lamp_faces(const struct shadow_lamp *lamp, double radius) {
    const gboolean outside = lamp->cone_rad <= 0.0F && place_distance(lamp) >= NEAR * radius;
    return lamp->place[3] < 0.5F || lamp_has_cone(lamp) || outside ? 1 : FACES;
}

/* Returns the tangent of half the angle of a near lamp's map. For the faces of a cube, this is 1.
 * The map of a spot lamp just contains the cone. The map of a lamp without a cone just contains the
 * sphere of the mesh. */
static double lamp_tangent(const struct shadow_lamp *lamp, double radius) {
    const double distance = place_distance(lamp);
    if (lamp_faces(lamp, radius) == FACES)
        return 1.0;
    return lamp_has_cone(lamp) ? tan((double)lamp->cone_rad)
                               : radius / sqrt(distance * distance - radius * radius);
}

/* Returns the length from depth 0 to depth 1 in the maps of a lamp. */
static double lamp_range(const struct shadow_lamp *lamp, double radius) {
    return lamp->place[3] < 0.5F ? RANGE * radius : place_distance(lamp) + 2.0 * radius;
}

int shadow_maps_layers(const struct shadow_lamp *lamps, int n, double radius) {
    int layers = n;
    for (int k = 0; k < n; k++)
        layers += lamp_faces(&lamps[k], radius) - 1;
    return layers;
}

void shadow_maps_axes(const ShadowMaps *maps, const struct shadow_lamp *lamps, int n, double radius,
                      float (*ret)[3]) {
    int next = n;
    for (int k = 0; k < n; k++) {
        const gboolean cube = lamp_faces(&lamps[k], radius) == FACES;
        const double tangent = lamp_tangent(&lamps[k], radius);
        if (lamps[k].place[3] < 0.5F) {
            shadow_maps_right(lamps[k].place, ret[k]);
            continue;
        }
        ret[k][0] = (float)tangent;
        ret[k][1] = (float)(SLACK * 2.0 * tangent / MAX(maps->size, 1));
        ret[k][2] = cube ? (float)next : -1.0F;
        next += cube ? FACES - 1 : 0;
    }
}

/* Sets ret to the unit vector from the middle of a face of the lamp's maps towards the lamp. */
static void face_back(const struct shadow_lamp *lamp, int face, double radius, float ret[3]) {
    const double distance = place_distance(lamp);
    const gboolean cube = lamp_faces(lamp, radius) == FACES, cone = lamp_has_cone(lamp);
    for (int k = 0; k < 3; k++)
        ret[k] = cube   ? (k != face / 2   ? 0.0F
                           : face % 2 != 0 ? -1.0F
                                           : 1.0F)
                 : cone ? -lamp->axis[k]
                        : (float)(lamp->place[k] / distance);
}

/* Computes the column-major matrix of a parallel projection along the light. A sphere of this
 * radius around the origin just fits into the picture. */
static void lamp_matrix(const float light[3], double radius, float ret[16]) {
    float right[3], up[3];
    shadow_maps_right(light, right);
    cross(light, right, up);
    memset(ret, 0, 16 * sizeof(float));
    for (int k = 0; k < 3; k++) {
        ret[4 * k] = (float)(right[k] / radius);
        ret[4 * k + 1] = (float)(up[k] / radius);
        ret[4 * k + 2] = (float)(-light[k] / radius);
    }
    ret[15] = 1.0f;
}

/* Computes the column-major matrix of a perspective view from the lamp through one face of its
 * maps. Nothing is drawn that is nearer to the lamp than a hundredth of the radius. The near plane
 * lies close to the mesh, because a near plane close to the lamp would leave few bits for the
 * depths of the mesh. */
static void near_matrix(const struct shadow_lamp *lamp, int face, double radius, float ret[16]) {
    float back[3], right[3], up[3];
    face_back(lamp, face, radius, back);
    shadow_maps_right(back, right);
    cross(back, right, up);
    const double distance = place_distance(lamp), tangent = lamp_tangent(lamp, radius);
    /* distance from the lamp to the origin, along the line of sight */
    const double ahead = (double)back[0] * lamp->place[0] + (double)back[1] * lamp->place[1] +
                         (double)back[2] * lamp->place[2];
    const double near = MAX(0.01 * radius, ahead - 1.05 * radius);
    const double far = distance + 1.05 * radius;
    const double scale = (far + near) / (far - near), shift = 2.0 * far * near / (far - near);
    double moved[3] = {0.0};
    for (int k = 0; k < 3; k++) {
        ret[4 * k] = (float)(right[k] / tangent);
        ret[4 * k + 1] = (float)(up[k] / tangent);
        ret[4 * k + 2] = (float)(-back[k] * scale);
        ret[4 * k + 3] = -back[k];
        moved[0] += (double)right[k] * lamp->place[k];
        moved[1] += (double)up[k] * lamp->place[k];
        moved[2] += (double)back[k] * lamp->place[k];
    }
    ret[12] = (float)(-moved[0] / tangent);
    ret[13] = (float)(-moved[1] / tangent);
    ret[14] = (float)(moved[2] * scale - shift);
    ret[15] = (float)moved[2];
}

/* Draws the depths of seen, a texture of visibility_find(), into a layer. */
static void draw_map(const ShadowMaps *maps, int layer, double range, guint seen) {
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
    glUniform1f(glGetUniformLocation(maps->program, "range"), (float)range);
    gpu_fill_screen();
    glDepthFunc(GL_LESS);
}

static gboolean same_floats(const float *a, const float *b, int n) {
    for (int k = 0; k < n; k++)
        if (a[k] != b[k])
            return FALSE;
    return TRUE;
}

static gboolean same_lamp(const struct shadow_lamp *a, const struct shadow_lamp *b) {
    return same_floats(a->place, b->place, 4) && same_floats(a->axis, b->axis, 3) &&
           a->cone_rad == b->cone_rad;
}

static gboolean same_key(const struct key *a, const struct key *b) {
    return a->parts == b->parts && a->serial == b->serial && same_lamp(&a->lamp, &b->lamp) &&
           a->options.way == b->options.way && a->options.layers == b->options.layers &&
           a->options.straight == b->options.straight && a->options.volume == b->options.volume &&
           a->options.views == b->options.views;
}

/* Returns an FNV-1a hash of the parts that cast shadows. The hash is never 0. */
static guint64 parts_hash(const struct visibility_scene *s) {
    guint64 hash = 14695981039346656037U;
    for (int k = 0; k < s->n_parts; k++) {
        const struct visibility_part *part = &s->parts[k];
        guint64 values[] = {GPOINTER_TO_SIZE(part->mdf),
                            GPOINTER_TO_SIZE(part->places.index),
                            GPOINTER_TO_SIZE(part->places.endless),
                            part->first_index,
                            part->n_indices,
                            0};
        G_STATIC_ASSERT(sizeof part->tiles == sizeof *values);
        memcpy(&values[5], part->tiles, sizeof *values);
        for (gsize i = 0; i < G_N_ELEMENTS(values); i++)
            for (int shift = 0; shift < 64; shift += 8)
                hash = (hash ^ (values[i] >> shift & 0xff)) * 1099511628211U;
    }
    return hash | 1;
}

/* Draws one face of a lamp into a layer. */
static gboolean find_face(ShadowMaps *maps, Visibility *visibility,
                          const struct shadow_scene *scene, const struct key *key, int face,
                          int layer, GError **error) {
    struct visibility_scene seen_from = scene->casting;
    const struct shadow_lamp *lamp = &key->lamp;
    guint seen;
    maps->keys[layer].parts = 0;
    if (lamp->place[3] < 0.5F)
        lamp_matrix(lamp->place, scene->radius, seen_from.projection);
    else
        near_matrix(lamp, face, scene->radius, seen_from.projection);
    memcpy(seen_from.sight, lamp->place, sizeof lamp->place);
    seen_from.reach = (float)(REACH * scene->radius);
    seen_from.width = seen_from.height = maps->size;
    seen_from.base_only = TRUE;
    if (!visibility_find(visibility, &seen_from, &seen, error))
        return FALSE;
    draw_map(maps, layer, lamp_range(lamp, scene->radius), seen);
    maps->keys[layer] = *key;
    return TRUE;
}

gboolean shadow_maps_find(ShadowMaps *maps, Visibility *visibility,
                          const struct shadow_scene *scene, const struct shadow_lamp *lamps, int n,
                          GError **error) {
    struct key key = {.parts = parts_hash(&scene->casting),
                      .serial = scene->serial,
                      .options = scene->casting.options};
    const int layers = shadow_maps_layers(lamps, n, scene->radius);
    int next = n;
    if (!make(maps, scene->size, layers, error))
        return FALSE;
    for (int k = 0; k < n; k++) {
        const int faces = lamp_faces(&lamps[k], scene->radius);
        key.lamp = lamps[k];
        for (int face = 0; face < faces; face++) {
            const int layer = face == 0 ? k : next++;
            if (!same_key(&key, &maps->keys[layer]) &&
                !find_face(maps, visibility, scene, &key, face, layer, error))
                return FALSE;
        }
    }
    return gpu_check("drawing shadow maps", error);
}
