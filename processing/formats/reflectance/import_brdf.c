#include "import_brdf.h"

#include <math.h>

#include "base/data_error.h"
#include "base/srgb.h"
#include "btf/btf_directions.h"
#include "codecs/hsh/hsh.h"
#include "formats/brdf/utia.h"
#include "formats/rti/rti.h"

/* for HSH: minimum elevation of a light; lower lights are raised to it, as in RTIViewer and
 * OpenLIME */
#define LOWEST_RAD 0.15

static struct btf_directions *import_brdf_directions(const char *table, gboolean utia,
                                                     GError **error) {
    if (table)
        return btf_directions_read(table, error);
    if (!utia)
        return btf_directions_81();
    struct btf_directions *ret = g_new0(struct btf_directions, 1);
    ret->name = g_strdup("UTIA");
    ret->lights = direction_list_new(1 + (gsize)(UTIA_THETAS - 1) * UTIA_PHIS);
    for (gsize i = 1; i < ret->lights.n; i++) {
        const gsize ring = 1 + (i - 1) / UTIA_PHIS, within = (i - 1) % UTIA_PHIS;
        ret->lights.theta_deg[i] = 15 * (float)ring;
        ret->lights.phi_deg[i] = 7.5F * (float)within;
    }
    ret->views = direction_list_copy(&ret->lights);
    return ret;
}

struct import_brdf_source {
    Brdf *brdf;
    gsize texels; /* number of texels */
    const struct btf_directions *directions;
    float *views, *lights; /* unit vectors */
};

static gboolean import_brdf_view(int view, float *ret_rgb, int *ret_holes, gpointer data,
                                 GError **error G_GNUC_UNUSED) {
    const struct import_brdf_source *source = data;
    for (gsize l = 0; l < source->directions->lights.n; l++) {
        const float *light = source->lights + 3 * l;
        float f[3];
        brdf_evaluate(light, source->views + 3 * view, f, source->brdf);
        for (gsize i = 0; i < source->texels; i++)
            for (gsize c = 0; c < 3; c++)
                *ret_rgb++ = (float)G_PI * light[2] * f[c];
        ret_holes[l] = 0;
    }
    return TRUE;
}

gboolean import_brdf(const char *path, const char *file, const struct import_brdf_wish *wish,
                     const struct work *work, struct import_result *ret, GError **error) {
    const int side = MAX(wish->texels, 1);
    g_autoptr(Brdf) brdf = brdf_open(file, wish->kind, &wish->coding, error);
    struct btf_directions *directions =
        brdf ? import_brdf_directions(wish->directions, wish->kind == BRDF_UTIA, error) : NULL;
    if (!directions)
        return FALSE;
    g_autofree float *views = direction_list_vectors(&directions->views);
    g_autofree float *lights = direction_list_vectors(&directions->lights);
    struct import_brdf_source source = {.brdf = brdf,
                                        .texels = (gsize)side * (gsize)side,
                                        .directions = directions,
                                        .views = views,
                                        .lights = lights};
    const struct import_material material = {
        .source = file,
        .width = side,
        .height = side,
        .texel_mm = wish->texel_mm > 0 ? wish->texel_mm : 1,
        .n_views = (int)directions->views.n,
        .n_lights = (int)directions->lights.n,
        .view_theta_deg = directions->views.theta_deg,
        .view_phi_deg = directions->views.phi_deg,
        .light_theta_deg = directions->lights.theta_deg,
        .light_phi_deg = directions->lights.phi_deg,
        .view = import_brdf_view,
        .data = &source,
    };
    const gboolean ok = import_material(path, &material, work, ret, error);
    btf_directions_free(directions);
    return ok;
}

struct import_ptm_source {
    Rti *rti;
    float *lights; /* unit vectors */
};

static void ptm_basis(const struct rti *rti, const float light[3], float ret[RTI_MAX_TERMS]) {
    if (!rti->hsh) {
        rti_ptm_basis(light, ret);
        return;
    }
    const float z = MAX(light[2], (float)sin(LOWEST_RAD)), flat = hypotf(light[0], light[1]);
    const float wide = flat > 0 ? sqrtf(1 - MIN(z * z, 1)) / flat : 0;
    hsh_basis((const float[]){light[0] * wide, light[1] * wide, z}, rti->n_terms, ret);
}

static gboolean ptm_picture(int view G_GNUC_UNUSED, int light, const struct import_region *region,
                            float *const *ret_planes, int *ret_holes, gpointer data,
                            GError **error G_GNUC_UNUSED) {
    const struct import_ptm_source *source = data;
    const gsize width = (gsize)region->width, n = width * (gsize)region->height;
    float basis[RTI_MAX_TERMS];
    ptm_basis(source->rti, source->lights + 3 * light, basis);
    *ret_holes = 0;
    for (gsize i = 0; ret_planes && i < n; i++) {
        const gsize x = (gsize)region->x + i % width, y = (gsize)region->y + i / width;
        float f[3];
        rti_evaluate(source->rti, y * (gsize)source->rti->width + x, basis, f);
        for (int c = 0; c < 3; c++)
            ret_planes[c][i] = (float)srgb_decode(MAX((double)f[c], 0));
    }
    return TRUE;
}

gboolean import_ptm(const char *path, const char *file, const char *table,
                    const struct import_wish *wish, const struct work *work,
                    struct import_result *ret, GError **error) {
    const float straight = 0;
    g_autoptr(Rti) rti = rti_read(file, error);
    struct btf_directions *directions = rti ? import_brdf_directions(table, FALSE, error) : NULL;
    if (!directions)
        return FALSE;
    g_autofree float *lights = direction_list_vectors(&directions->lights);
    struct import_ptm_source source = {.rti = rti, .lights = lights};
    const struct import_material material = {
        .source = file,
        .width = rti->width,
        .height = rti->height,
        .texel_mm = wish->texel_mm > 0 ? wish->texel_mm : 1,
        .region = wish->region,
        .n_views = 1,
        .n_lights = (int)directions->lights.n,
        .view_theta_deg = &straight,
        .view_phi_deg = &straight,
        .light_theta_deg = directions->lights.theta_deg,
        .light_phi_deg = directions->lights.phi_deg,
        .picture = ptm_picture,
        .data = &source,
    };
    const gboolean ok = import_material(path, &material, work, ret, error);
    btf_directions_free(directions);
    return ok;
}
