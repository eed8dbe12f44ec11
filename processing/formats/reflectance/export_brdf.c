#include "export_brdf.h"

#include "formats/brdf/merl.h"
#include "formats/brdf/rgl.h"

#define TURNS 12 /* number of rotations about the normal for a mean, 30° apart */

gboolean export_brdf(const char *material, const char *file,
                     const struct export_brdf_options *options, const struct work *work,
                     struct export_brdf_result *ret, GError **error) {
    *ret = (struct export_brdf_result){.spread = -1};
    g_autoptr(Abrdf) abrdf = abrdf_read(material, &options->region, work, error);
    if (!abrdf)
        return FALSE;
    const struct abrdf_info *info = abrdf_info(abrdf);
    ret->n_views = (int)info->views.n;
    ret->n_lights = (int)info->lights.n;
    ret->width = info->region.width;
    ret->height = info->region.height;
    ret->holes = info->holes;
    ret->filled = info->filled;
    ret->error = info->error;
    ret->lowest_deg = info->lowest_deg;
    if (options->kind == BRDF_MERL) {
        struct merl_result merl = {0};
        const gboolean ok = merl_write(file, abrdf_evaluate_both, abrdf, TURNS, work, &merl, error);
        ret->spread = merl.spread;
        return ok;
    }
    g_autofree char *name = g_path_get_basename(material);
    g_autofree char *text = g_strdup_printf("%s, mesorig %s", name, MESORIG_VERSION);
    const struct rgl_options rgl = {.isotropic = options->isotropic,
                                    .n_turns = TURNS,
                                    .description = text,
                                    .rgb_only = options->rgb_only};
    struct rgl_result result;
    return rgl_write(file, abrdf_evaluate, abrdf, &rgl, work, &result, error);
}
