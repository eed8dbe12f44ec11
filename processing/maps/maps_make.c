/* Makes maps: computes the fit or reads the stored fit of an earlier export, then computes heights
 * and occlusion. */
#include "maps.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "maps_private.h"
#include "maps_store.h"

#define ISOTROPIC 0.15F /* mean anisotropy below which the maps have no anisotropy */

/* Returns a name of at most 64 characters that are letters, digits, “-” or “_”; g_free(). These
 * characters are valid in names of files, in XML and in Python. */
static char *plain_name(const char *name) {
    char *ret = g_strdup(name && *name ? name : "material");
    g_strcanon(ret, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_", '_');
    if (strlen(ret) > 64)
        ret[64] = '\0';
    return ret;
}

/* Sets max_specular, specular_scale and anisotropic. If the mean anisotropy is below ISOTROPIC,
 * makes all texels isotropic, with the geometric mean of the roughnesses in both directions. A
 * second call changes nothing. */
static void summarise(struct maps *maps) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    double anisotropy = 0;
    maps->max_specular = maps->specular_scale = 1;
    for (gsize i = 0; i < n; i++) {
        const struct maps_texel *texel = &maps->fit->texels[i];
        anisotropy += (double)texel->anisotropy;
        maps->specular_scale = MAX(maps->specular_scale, maps_specular_level(texel));
        for (int c = 0; c < 3; c++)
            maps->max_specular = MAX(maps->max_specular, texel->specular_colour[c]);
    }
    maps->anisotropic = anisotropy / (double)n >= (double)ISOTROPIC;
    for (gsize i = 0; i < n && !maps->anisotropic; i++) {
        struct maps_texel *texel = &maps->fit->texels[i];
        if (texel->anisotropy <= 0)
            continue;
        const float alpha = texel->roughness * texel->roughness;
        const float along = alpha + (1 - alpha) * texel->anisotropy * texel->anisotropy;
        texel->roughness = powf(alpha * along, 0.25F);
        texel->anisotropy = 0;
    }
}

/* Fits the maps and computes their errors. Heights and occlusion follow later (shape()). */
static struct maps *maps_of(const struct btf_matrix *btf, enum maps_model model,
                            const struct work *work, GError **error) {
    const gsize n = btf_layout_texels(&btf->layout);
    g_autoptr(Maps) maps = g_new0(struct maps, 1);
    if (n > MAPS_MAX_TEXELS) {
        data_error_set(btf->name ? btf->name : "BTF", 0, error,
                       "the BTF has %zu × %zu texels, but maps can have at most %d (4096 × 4096); "
                       "process or import the session with fewer texels",
                       btf->layout.width, btf->layout.height, MAPS_MAX_TEXELS);
        return NULL;
    }
    maps->name = plain_name(btf->name);
    maps->width = (int)btf->layout.width;
    maps->height = (int)btf->layout.height;
    maps->texel_mm = btf->layout.texel_mm > 0 ? btf->layout.texel_mm : 1;
    maps->n_views = (int)btf->layout.views.n;
    maps->n_lights = (int)btf->layout.lights.n;
    maps->holes = btf->holes;
    maps->model = model;
    struct maps_register *of = maps_register_new(btf, work, error);
    maps->depth_mm = of ? of->depth_mm : 0;
    maps->fit = of ? maps_fit_new(of, NULL, model, work, error) : NULL;
    if (maps->fit)
        summarise(maps);
    const gboolean ok = maps->fit && maps_find_errors(maps, of, work, error);
    maps_register_free(of);
    return ok ? g_steal_pointer(&maps) : NULL;
}

/* Computes the maps that are not fitted: the heights (maps_find_heights()) and the occlusion. */
static gboolean shape(struct maps *maps, const char *session, const struct work *work,
                      GError **error) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    g_autofree float *heights = g_new(float, n);
    if (!maps_find_heights(maps, session, work, error))
        return FALSE;
    for (gsize i = 0; i < n; i++)
        heights[i] = (float)((double)maps->heights_mm[i] / maps->texel_mm);
    maps->occlusion = g_new0(float, n);
    return maps_find_occlusion(heights, maps->width, maps->height, work, maps->occlusion, error);
}

struct maps *maps_new_of(const struct btf_matrix *btf, enum maps_model model,
                         const struct work *work, GError **error) {
    g_autoptr(Maps) maps = maps_of(btf, model, work, error);
    return maps && shape(maps, NULL, work, error) ? g_steal_pointer(&maps) : NULL;
}

/* Returns the stored fit of an earlier export, or makes a new fit and stores it if the session can
 * be written to. */
static struct maps *fitted(const char *path, const char *session, enum maps_model model,
                           gint64 memory, const struct work *work, GError **error) {
    g_autoptr(GError) unknown = NULL;
    g_autofree char *inputs = maps_store_inputs(session, model, &unknown);
    g_autoptr(Maps) maps = inputs ? maps_store_read(session, model, inputs) : NULL;
    if (maps) {
        summarise(maps);
        maps->kept = MAPS_FIT_TAKEN;
        return g_steal_pointer(&maps);
    }
    struct btf_matrix *btf = btf_matrix_read_within(memory, path, work, error);
    maps = btf ? maps_of(btf, model, work, error) : NULL;
    btf_matrix_free(btf);
    if (maps && inputs && maps_store_write(session, inputs, maps, &unknown))
        maps->kept = MAPS_FIT_KEPT;
    else if (maps && unknown)
        maps->lost = g_strdup(unknown->message);
    return g_steal_pointer(&maps);
}

struct maps *maps_new(const char *path, enum maps_model model, gint64 memory,
                      const struct work *work, GError **error) {
    g_autofree char *session = btf_matrix_session(path);
    g_autoptr(Maps) maps = fitted(path, session, model, memory, work, error);
    return maps && shape(maps, session, work, error) ? g_steal_pointer(&maps) : NULL;
}
