#include "relief_scene.h"
#include "lib/ok.h"

#include "base/vec.h"
#include "codecs/lpca/lpca_levels.h"
#include "codecs/lpca/lpca_resample.h"
#include "codecs/mdf_codecs/mdf_blocks.h"
#include "codecs/mdf_codecs/mdf_factors.h"

#include <math.h>

#define RINGS    3
#define SIZE_MM  (RELIEF_TEXELS * RELIEF_TEXEL_MM)
#define STEPS    400 /* number of steps of a ray */
#define PERIODS  4   /* number of periods of the structure per tile */
#define SLOPE_MM 1e-3
#define TERMS    8

static const double depth_mm[RELIEF_KINDS] = {0.35, 0.5, 0.7};

/* Returns the height, 0 … −depth_mm. */
static double relief_scene_height(enum relief_kind kind, double x, double y) {
    const double a = 2 * G_PI * PERIODS * x / SIZE_MM, b = 2 * G_PI * PERIODS * y / SIZE_MM;
    const double shape = kind == RELIEF_WEAVE   ? sin(0.5 * a) * sin(0.5 * b)
                         : kind == RELIEF_BUMPS ? 0.5 * (cos(a) + cos(b))
                                                : sin(0.5 * a);
    return 0.5 * depth_mm[kind] * (shape - 1);
}

static struct vec3 relief_scene_normal(enum relief_kind kind, double x, double y) {
    const double dx =
        relief_scene_height(kind, x + SLOPE_MM, y) - relief_scene_height(kind, x - SLOPE_MM, y);
    const double dy =
        relief_scene_height(kind, x, y + SLOPE_MM) - relief_scene_height(kind, x, y - SLOPE_MM);
    return vec3_unit(vec3(-dx / (2 * SLOPE_MM), -dy / (2 * SLOPE_MM), 1));
}

static struct vec3 relief_scene_direction(const struct direction_list *list, gsize k) {
    const double theta = list->theta_deg[k] * G_PI / 180, phi = list->phi_deg[k] * G_PI / 180;
    return vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
}

/* Computes a Lambertian part and a lobe around the half vector (Blinn 1977). */
static void relief_scene_reflect(enum relief_kind kind, double x, double y, struct vec3 v,
                                 struct vec3 l, float ret[3]) {
    static const double gloss[RELIEF_KINDS] = {0, 0.5, 0.2}, sharp[RELIEF_KINDS] = {1, 12, 6};
    static const double colours[RELIEF_KINDS][2][3] = {{{0.7, 0.6, 0.4}, {0.1, 0.25, 0.5}},
                                                       {{0.5, 0.12, 0.1}, {0.5, 0.12, 0.1}},
                                                       {{0.3, 0.45, 0.25}, {0.5, 0.5, 0.3}}};
    const int i = (int)floor(2 * PERIODS * x / SIZE_MM), j = (int)floor(2 * PERIODS * y / SIZE_MM);
    const struct vec3 n = relief_scene_normal(kind, x, y);
    const struct vec3 h = vec3_unit(vec3(v.x + l.x, v.y + l.y, v.z + l.z));
    const double cosine = fmax(0, vec3_dot(n, l));
    const double lobe = gloss[kind] * pow(fmax(0, vec3_dot(n, h)), sharp[kind]) * fmax(0, l.z);
    for (int c = 0; c < 3; c++)
        ret[c] = (float)(colours[kind][(i + j) & 1][c] * cosine + lobe);
}

/* Gives the centre of a texel. Rows run downwards, y upwards. */
static void relief_scene_texel(int texel, double *ret_x, double *ret_y) {
    const int i = texel % RELIEF_TEXELS, j = texel / RELIEF_TEXELS;
    *ret_x = (i + 0.5) * RELIEF_TEXEL_MM;
    *ret_y = -(j + 0.5) * RELIEF_TEXEL_MM;
}

struct btf_matrix *relief_scene_btf(enum relief_kind kind) {
    struct btf_matrix *btf =
        btf_fixture_of("relief", RELIEF_TEXELS, RELIEF_TEXELS, btf_fixture_rings(RINGS, 70, 0),
                       btf_fixture_rings(RINGS, 75, 7));
    const struct direction_list *views = &btf->layout.views, *lights = &btf->layout.lights;
    float *to = btf->values;
    btf->layout.texel_mm = RELIEF_TEXEL_MM;
    btf->layout.reference_mm = 0;
    for (int texel = 0; texel < RELIEF_TEXELS * RELIEF_TEXELS; texel++) {
        double x, y;
        relief_scene_texel(texel, &x, &y);
        for (gsize v = 0; v < views->n; v++)
            for (gsize l = 0; l < lights->n; l++, to += 3)
                relief_scene_reflect(kind, x, y, relief_scene_direction(views, v),
                                     relief_scene_direction(lights, l), to);
    }
    return btf;
}

/* Returns the depth at which a ray meets the structure. The ray goes through (x, y) of the plane z
 * = 0 in the direction −v. */
static double relief_scene_depth(enum relief_kind kind, double x, double y, struct vec3 v) {
    for (int k = 0; k < STEPS; k++) {
        const double depth = depth_mm[kind] * k / STEPS, along = depth / v.z;
        if (relief_scene_height(kind, x - along * v.x, y - along * v.y) >= -depth)
            return depth;
    }
    return depth_mm[kind];
}

struct mdf_table *relief_scene_mdf(enum relief_kind kind) {
    struct direction_list views = btf_fixture_rings(RINGS, 80, 0);
    struct mdf_table *table = mdf_table_new(RELIEF_TEXELS, RELIEF_TEXELS, (int)views.n,
                                            RELIEF_TEXEL_MM, views.theta_deg, views.phi_deg);
    float *to = table->depth_mm;
    table->deepest_mm = depth_mm[kind];
    for (gsize v = 0; v < views.n; v++)
        for (int texel = 0; texel < RELIEF_TEXELS * RELIEF_TEXELS; texel++) {
            double x, y;
            relief_scene_texel(texel, &x, &y);
            *to++ = (float)relief_scene_depth(kind, x, y, relief_scene_direction(&views, v));
        }
    direction_list_clear(&views);
    return table;
}

struct lpca *relief_scene_compress(const struct btf_matrix *btf, int clusters, int components) {
    const struct lpca_options options = {.n_clusters = clusters, .n_components = components};
    struct lpca *lpca = ok(lpca_compute(btf, &options, ERR));
    return lpca;
}

/* Writes a local PCA in one of three forms: with mip levels in half floats, on a separate grid with
 * 8 bits, or on a separate grid in half floats. */
static void relief_scene_write_material(enum relief_kind kind, const char *path) {
    g_autoptr(BtfMatrix) btf = relief_scene_btf(kind);
    g_autoptr(BtfMatrix) half = btf_matrix_halved(btf);
    struct lpca *levels[2] = {relief_scene_compress(btf, 4, 4), relief_scene_compress(half, 2, 4)};
    const gboolean mips = kind == RELIEF_WEAVE;
    if (kind != RELIEF_WEAVE) {
        struct lpca *grid = ok(lpca_resample(levels[0], 8, ERR));
        lpca_free(levels[0]);
        levels[0] = grid;
    }
    for (int k = 0; k < 2; k++)
        lpca_quantise(levels[k], kind == RELIEF_BUMPS ? LPCA_8BIT_WEIGHTS : LPCA_HALF);
    ok(lpca_write_levels(path, levels, mips ? 2 : 1, ERR));
    for (int k = 0; k < 2; k++)
        lpca_free(levels[k]);
}

/* Writes the MDF as factors. The MDF of the bumps is written as blocks, which are converted to
 * factors for the web page. The viewer reads them directly. */
static void relief_scene_write_mdf(enum relief_kind kind, const char *path) {
    g_autoptr(GError) error = NULL;
    g_autoptr(MdfTable) table = relief_scene_mdf(kind);
    if (kind == RELIEF_BUMPS) {
        g_autoptr(MdfBlocks) blocks = mdf_blocks_new(table);
        mdf_blocks_write(path, blocks, &error);
    } else {
        g_autoptr(MdfFactors) factors =
            mdf_factors_compute(table, table->n_views, TERMS, 0, NULL, &error);
        g_assert_no_error(error);
        mdf_factors_write(path, factors, &error);
    }
    g_assert_no_error(error);
}

void relief_scene_write(enum relief_kind kind, const char *material, const char *mdf) {
    relief_scene_write_material(kind, material);
    relief_scene_write_mdf(kind, mdf);
}
