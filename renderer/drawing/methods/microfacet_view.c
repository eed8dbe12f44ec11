#include "microfacet.h"

#include "drawing/gl/gpu.h"
#include "normal_map.h"

#include <epoxy/gl.h>
#include <math.h>

#define SIZE 256 /* width and height of the normal map, for one tile */
/* YARNS        number of yarns per tile in each direction
 * ACROSS       largest slope of a yarn across the yarn
 * ALONG        largest slope of a yarn along the yarn
 * BUMP_RADIUS  radius of a boss (a round bump), in widths of its cell
 * BUMP_SLOPE   largest slope of a boss */
#define YARNS       16
#define ACROSS      0.8F
#define ALONG       0.45F
#define BUMPS       3 /* number of bosses per tile in each direction */
#define BUMP_RADIUS 0.36
#define BUMP_SLOPE  0.75

/* The parameters of the surfaces.
 * - For fabric, diffuse is the colour of the warp, and rough belongs to the weft. The yarns of the
 *   weft run along U. For a yarn of the warp, U and V are exchanged.
 * - For metal, U is along the brushing, because the facets lean least in that direction. */
static const struct microfacet surfaces[2][2] = {
    {{MICROFACET_WARD, {0.03F, 0.03F, 0.03F}, {0.24F, 0.22F, 0.19F}, {0.08F, 0.35F}},
     {MICROFACET_ASHIKHMIN, {0.03F, 0.03F, 0.03F}, {0.55F, 0.5F, 0.44F}, {160, 10}}},
    {{MICROFACET_WARD, {0.28F, 0.05F, 0.06F}, {0.06F, 0.05F, 0.05F}, {0.5F, 0.18F}},
     {MICROFACET_ASHIKHMIN, {0.28F, 0.05F, 0.06F}, {0.1F, 0.08F, 0.08F}, {5, 50}}},
};
static const float weft_diffuse[3] = {0.07F, 0.08F, 0.3F};

struct material {
    enum microfacet_surface surface;
    struct microfacet facets;
    guint normals; /* texture of the normal map; 0 for fabric */
};

/* Returns the unit normal along (x, y, 1). */
static struct vec3 microfacet_view_normal_of(double x, double y) {
    const double length = sqrt(x * x + y * y + 1);
    return (struct vec3){x / length, y / length, 1 / length};
}

/* Returns the normal of a lattice of bosses at texel coordinates `at`. On the side of a boss, the
 * normal leans away from the centre of the boss. The slope is largest half way down the side, where
 * it is BUMP_SLOPE. The normal is constant within each texel of the normal map. */
static struct vec3 microfacet_view_metal_normal(const double at[2]) {
    const int i = (int)floor((at[0] - floor(at[0])) * SIZE);
    const int j = (int)floor((at[1] - floor(at[1])) * SIZE);
    const double x = (i + 0.5) / SIZE, y = (j + 0.5) / SIZE;
    const double u = x * BUMPS - floor(x * BUMPS) - 0.5, v = y * BUMPS - floor(y * BUMPS) - 0.5;
    const double r = hypot(u, v) / BUMP_RADIUS;
    const double slope = r < 1 ? BUMP_SLOPE * sin(G_PI * r) : 0;
    if (!(r > 0))
        return microfacet_view_normal_of(0, -0.0);
    /* the signs differ because v increases downwards, and y of the normal upwards */
    return microfacet_view_normal_of(slope * u / (r * BUMP_RADIUS),
                                     -(slope * v / (r * BUMP_RADIUS)));
}

void microfacet_surface_at(enum microfacet_surface which, enum microfacet_model model,
                           const double x[2], struct microfacet *ret_surface,
                           struct vec3 *ret_normal) {
    *ret_surface = surfaces[which][model];
    if (which == MICROFACET_METAL) {
        *ret_normal = microfacet_view_metal_normal(x);
        return;
    }
    const double u = x[0] * YARNS, v = x[1] * YARNS;
    const gboolean warp = ((gint64)floor(u) + (gint64)floor(v)) % 2 == 0;
    const double p = 2 * (u - floor(u)) - 1, q = 1 - 2 * (v - floor(v));
    *ret_normal = microfacet_view_normal_of(p * (double)(warp ? ACROSS : ALONG),
                                            q * (double)(warp ? ALONG : ACROSS));
    if (warp) {
        ret_surface->rough[0] = surfaces[which][model].rough[1];
        ret_surface->rough[1] = surfaces[which][model].rough[0];
        return;
    }
    for (int c = 0; c < 3; c++)
        ret_surface->diffuse[c] = weft_diffuse[c];
}

static struct normal_map *microfacet_view_bosses(void) {
    struct normal_map *map = g_new0(struct normal_map, 1);
    *map = (struct normal_map){SIZE, SIZE, g_new(float, 2 * SIZE * SIZE)};
    for (int j = 0; j < SIZE; j++)
        for (int i = 0; i < SIZE; i++) {
            const double at[2] = {(i + 0.5) / SIZE, (j + 0.5) / SIZE};
            const struct vec3 n = microfacet_view_metal_normal(at);
            map->xy[2 * (j * SIZE + i)] = (float)n.x;
            map->xy[2 * (j * SIZE + i) + 1] = (float)n.y;
        }
    return map;
}

static gboolean microfacet_view_upload(struct material *material, const struct normal_map *map,
                                       GError **error) {
    GLint size = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    if (map->width > size || map->height > size) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "the normal map has %d × %d texels, but %s supports %d in each direction; make "
                    "the normal map smaller",
                    map->width, map->height, gpu_renderer(), size);
        return FALSE;
    }
    glGenTextures(1, &material->normals);
    glBindTexture(GL_TEXTURE_2D, material->normals);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RG16F, map->width, map->height, 0, GL_RG, GL_FLOAT, map->xy);
    glGenerateMipmap(GL_TEXTURE_2D);
    return gpu_check("the normal map", error);
}

static void microfacet_view_free_material(gpointer data) {
    struct material *material = data;
    if (material == NULL)
        return;
    glDeleteTextures(1, &material->normals);
    g_free(material);
}

static gpointer microfacet_view_open_surface(enum microfacet_surface surface,
                                             enum microfacet_model model, const char *path,
                                             GError **error) {
    struct material *material = g_new0(struct material, 1);
    material->surface = surface;
    material->facets = surfaces[surface][model];
    if (surface != MICROFACET_METAL)
        return material;
    struct normal_map *map = path != NULL ? normal_map_read(path, error) : microfacet_view_bosses();
    const gboolean good = map != NULL && microfacet_view_upload(material, map, error);
    normal_map_free(map);
    if (!good)
        g_clear_pointer(&material, microfacet_view_free_material);
    return material;
}

#define OPEN(ident, surface, model)                                                                \
    static gpointer open_##ident(const char *path, GError **error) {                               \
        return microfacet_view_open_surface(surface, model, path, error);                          \
    }
OPEN(metal_ward, MICROFACET_METAL, MICROFACET_WARD)
OPEN(metal_ashikhmin, MICROFACET_METAL, MICROFACET_ASHIKHMIN)
OPEN(fabric_ward, MICROFACET_FABRIC, MICROFACET_WARD)
OPEN(fabric_ashikhmin, MICROFACET_FABRIC, MICROFACET_ASHIKHMIN)

static char *microfacet_view_constants(gconstpointer data, const struct method_style *style) {
    return g_strdup_printf("#define ROTATION %d\n", (int)style->rotation);
}

static gint64 microfacet_view_bytes(gconstpointer data) {
    const struct material *material = data;
    return gpu_texture_bytes(GL_TEXTURE_2D, material->normals);
}

static void microfacet_view_set_colour(guint program, const char *name, const float rgb[3]) {
    glUniform3fv(glGetUniformLocation(program, name), 1, rgb);
}

static void microfacet_view_bind_material(gpointer data, guint program,
                                          const struct method_style *style) {
    const struct material *material = data;
    gpu_bind_texture(program, "normals", 0, GL_TEXTURE_2D, material->normals);
    if (material->normals != 0) {
        glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER,
                        style->nearest ? GL_NEAREST : GL_LINEAR_MIPMAP_LINEAR);
        glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER,
                        style->nearest ? GL_NEAREST : GL_LINEAR);
    }
    microfacet_view_set_colour(program, "diffuse", material->facets.diffuse);
    microfacet_view_set_colour(program, "specular", material->facets.specular);
    microfacet_view_set_colour(program, "weft_diffuse", weft_diffuse);
    glUniform2fv(glGetUniformLocation(program, "rough"), 1, material->facets.rough);
    glUniform3f(glGetUniformLocation(program, "weave"), YARNS, ACROSS, ALONG);
}

static const char *const metal_ward[] = {"ward.glsl", "microfacet.glsl", "metal.glsl", NULL};
static const char *const metal_ashikhmin[] = {"ashikhmin.glsl", "microfacet.glsl", "metal.glsl",
                                              NULL};
static const char *const fabric_ward[] = {"ward.glsl", "microfacet.glsl", "fabric.glsl", NULL};
static const char *const fabric_ashikhmin[] = {"ashikhmin.glsl", "microfacet.glsl", "fabric.glsl",
                                               NULL};

#define SURFACE(ident, text, id, normals)                                                          \
    {                                                                                              \
        .name = (ident), .title = (text), .shaders = (id), .open = open_##id,                      \
        .free = microfacet_view_free_material, .constants = microfacet_view_constants,             \
        .bytes = microfacet_view_bytes, .bind = microfacet_view_bind_material,                     \
        .takes_normals = (normals),                                                                \
    }

const struct method methods_microfacet[MICROFACET_METHODS] = {
    SURFACE("metal-ward", "brushed metal (Ward)", metal_ward, TRUE),
    SURFACE("metal-ashikhmin", "brushed metal (Ashikhmin and Shirley)", metal_ashikhmin, TRUE),
    SURFACE("fabric-ward", "woven fabric (Ward)", fabric_ward, FALSE),
    SURFACE("fabric-ashikhmin", "woven fabric (Ashikhmin and Shirley)", fabric_ashikhmin, FALSE),
};
