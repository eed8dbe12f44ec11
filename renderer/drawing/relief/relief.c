#include "relief.h"

#include "drawing/gl/gpu.h"

#include <epoxy/gl.h>
#include <math.h>
#include <string.h>

#define SLACK 1e-4 /* tolerance of distances from the eye, in radii of the mesh */

struct Relief {
    MdfTexture *mdfs[RELIEF_MAX_MATERIALS], *smooth;
    /* two objects, because the pictures of the eye and of the lamps have different sizes */
    Visibility *eye, *lamp;
    /* Shadow maps of the first lamp, and of further lamps (NULL until there are any). */
    ShadowMaps *first, *further;
    /* Values that relief_prepare() has set for relief_bind(). */
    gboolean silhouettes, shadows; /* `shadows` is for the first lamp */
    gboolean curved[RELIEF_MAX_MATERIALS];
    int n_further;
    guint seen;
    float light[3], radius, lamp_spread; /* for lamp_spread see shadow.glsl */
    guint depths; /* sampler of the depths of a shadow map; 0 before it is first used */
    float axes[RELIEF_MAX_LAMPS][3]; /* see shadow_maps_axes() */
};

Relief *relief_new(GError **error) {
    float zero = 0.0f;
    const struct mdf_table flat = {.width = 1,
                                   .height = 1,
                                   .n_views = 1,
                                   .texel_mm = 1.0,
                                   .theta_deg = &zero,
                                   .phi_deg = &zero,
                                   .depth_mm = &zero};
    g_autoptr(Relief) relief = g_new0(Relief, 1);
    if ((relief->smooth = mdf_texture_new(&(struct mdf_source){.table = &flat}, error)) == NULL ||
        (relief->eye = visibility_new(error)) == NULL ||
        (relief->lamp = visibility_new(error)) == NULL ||
        (relief->first = shadow_maps_new(FALSE, error)) == NULL)
        return NULL;
    return g_steal_pointer(&relief);
}

void relief_free(Relief *relief) {
    if (relief == NULL)
        return;
    for (int k = 0; k < RELIEF_MAX_MATERIALS; k++)
        mdf_texture_free(relief->mdfs[k]);
    mdf_texture_free(relief->smooth);
    visibility_free(relief->eye);
    visibility_free(relief->lamp);
    shadow_maps_free(relief->first);
    shadow_maps_free(relief->further);
    if (relief->depths != 0)
        glDeleteSamplers(1, &relief->depths);
    g_free(relief);
}

gboolean relief_set_mdf(Relief *relief, int material, const struct mdf_source *mdf,
                        GError **error) {
    MdfTexture *texture = mdf != NULL ? mdf_texture_new(mdf, error) : NULL;
    if (mdf != NULL && texture == NULL)
        return FALSE;
    mdf_texture_free(relief->mdfs[material]);
    relief->mdfs[material] = texture;
    relief_forget(relief);
    return TRUE;
}

void relief_forget(Relief *relief) {
    shadow_maps_forget(relief->first);
    if (relief->further != NULL)
        shadow_maps_forget(relief->further);
}

gint64 relief_mdf_bytes(const Relief *relief) {
    gint64 sum = 0;
    for (int k = 0; k < RELIEF_MAX_MATERIALS; k++)
        sum += mdf_texture_bytes(relief->mdfs[k]);
    return sum;
}

/* Removes all indices from n_casting on, because they cast no shadow. If index n_casting lies
 * within a part, only the indices of this part before n_casting remain. */
static void parts_casting(struct visibility_scene *scene, guint n_casting) {
    int n = 0;
    for (int k = 0; k < scene->n_parts; k++) {
        struct visibility_part part = scene->parts[k];
        if (part.first_index >= n_casting)
            continue;
        part.n_indices = MIN(part.n_indices, n_casting - part.first_index);
        scene->parts[n++] = part;
    }
    scene->n_parts = n;
}

/* Makes the sampler that reads the depths of a shadow map without a comparison. */
static gboolean make_depths(Relief *relief, GError **error) {
    GLint units = 0;
    glGetIntegerv(GL_MAX_TEXTURE_IMAGE_UNITS, &units);
    if (units <= RELIEF_DEPTHS_UNIT) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "soft shadows need %d texture units, but %s has %d; draw with sharp shadows "
                    "(--light-size-deg 0)",
                    RELIEF_DEPTHS_UNIT + 1, gpu_renderer(), units);
        return FALSE;
    }
    if (relief->depths != 0)
        return TRUE;
    glGenSamplers(1, &relief->depths);
    glSamplerParameteri(relief->depths, GL_TEXTURE_COMPARE_MODE, GL_NONE);
    glSamplerParameteri(relief->depths, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glSamplerParameteri(relief->depths, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glSamplerParameteri(relief->depths, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glSamplerParameteri(relief->depths, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    return gpu_check("making a sampler", error);
}

gboolean relief_prepare(Relief *relief, const struct relief_scene *from, GError **error) {
    struct visibility_scene scene = from->seen;
    const struct visibility_options *o = &from->seen.options;
    const gboolean marched = !o->views && !o->straight && !o->volume;
    gboolean any = FALSE;
    for (int k = 0; k < scene.n_parts; k++) {
        struct visibility_part *part = &scene.parts[k];
        MdfTexture *mdf = relief->mdfs[part->material];
        any |= mdf != NULL;
        part->mdf = from->silhouettes && mdf != NULL ? mdf : relief->smooth;
        part->volume = scene.options.volume && part->mdf == mdf;
        part->shell = marched && part->mdf == mdf;
        relief->curved[part->material] = part->shell;
        if ((part->volume && !mdf_texture_make_volume(mdf, error)) ||
            (part->shell && !mdf_texture_make_shell(mdf, error)) ||
            (part->shell && from->along_surface && !mdf_texture_make_along(mdf, error)))
            return FALSE;
    }
    if (from->silhouettes && !any) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "silhouettes need the material's MDF (mdf.exr): “mesorig process” makes it "
                    "from a session with laser sweeps; or draw without silhouettes");
        return FALSE;
    }
    memcpy(relief->light, from->light, sizeof from->light);
    relief->radius = from->radius;
    relief->silhouettes = from->silhouettes;
    relief->shadows = from->shadows && from->lit;
    relief->lamp_spread = relief->shadows ? (float)tan(from->light_size_deg * G_PI / 360.0) : 0.0F;
    if (relief->lamp_spread > 0.0F && !make_depths(relief, error))
        return FALSE;
    relief->n_further = 0;
    if (from->silhouettes && !visibility_find(relief->eye, &scene, &relief->seen, error))
        return FALSE;
    struct shadow_scene shadows = {scene, from->radius, from->serial, from->shadow_size};
    struct shadow_lamp light = {.place = {from->light[0], from->light[1], from->light[2]}};
    parts_casting(&shadows.casting, from->n_casting);
    if (relief->shadows &&
        !shadow_maps_find(relief->first, relief->lamp, &shadows, &light, 1, error))
        return FALSE;
    if (!from->shadows || from->n_further == 0)
        return TRUE;
    relief->n_further = from->n_further;
    if (relief->further == NULL && (relief->further = shadow_maps_new(TRUE, error)) == NULL)
        return FALSE;
    /* Up to 64 maps of further lamps take no more memory than four maps of full size. Low
     * resolution is enough, because each of many lamps contributes little. */
    const int layers = shadow_maps_layers(from->further, from->n_further, from->radius);
    shadows.size /= layers <= 4 ? 1 : layers <= 16 ? 2 : 4;
    if (!shadow_maps_find(relief->further, relief->lamp, &shadows, from->further, from->n_further,
                          error))
        return FALSE;
    shadow_maps_axes(relief->further, from->further, from->n_further, from->radius, relief->axes);
    return TRUE;
}

void relief_bind(const Relief *relief, int material, guint program) {
    float right[3] = {0.0f}, range[3] = {0.0f}, size_mm[2] = {1.0f, 1.0f};
    if (relief->curved[material]) {
        mdf_texture_size_mm(relief->mdfs[material], size_mm);
        mdf_texture_bind_along(relief->mdfs[material], program);
    }
    glUniform1i(glGetUniformLocation(program, "curved"), relief->curved[material]);
    glUniform2fv(glGetUniformLocation(program, "mdf_size"), 1, size_mm);
    if (relief->shadows) {
        shadow_maps_right(relief->light, right);
        shadow_maps_range(relief->first, relief->radius, range);
    }
    gpu_bind_texture(program, "seen", VISIBILITY_UNIT, GL_TEXTURE_2D,
                     relief->silhouettes ? relief->seen : 0);
    gpu_bind_texture(program, "shadow_map", VISIBILITY_UNIT + 1, GL_TEXTURE_2D,
                     relief->shadows ? shadow_maps_texture(relief->first) : 0);
    /* With sharp shadows, shadow_depths is not used. It then gets the unit of another sampler of
     * the same type, because samplers of different types must not share a unit. */
    if (relief->lamp_spread > 0.0F) {
        gpu_bind_texture(program, "shadow_depths", RELIEF_DEPTHS_UNIT, GL_TEXTURE_2D,
                         shadow_maps_texture(relief->first));
        glBindSampler(RELIEF_DEPTHS_UNIT, relief->depths);
    } else
        glUniform1i(glGetUniformLocation(program, "shadow_depths"), VISIBILITY_UNIT);
    glUniform1f(glGetUniformLocation(program, "lamp_spread"), relief->lamp_spread);
    glUniform1i(glGetUniformLocation(program, "silhouettes"), relief->silhouettes);
    glUniform1i(glGetUniformLocation(program, "shadows"), relief->shadows);
    glUniform1f(glGetUniformLocation(program, "slack"), SLACK * relief->radius);
    glUniform3fv(glGetUniformLocation(program, "shadow_right"), 1, right);
    glUniform3fv(glGetUniformLocation(program, "shadow_light"), 1, relief->light);
    glUniform3fv(glGetUniformLocation(program, "shadow_range"), 1, range);
    glUniform1f(glGetUniformLocation(program, "shadow_radius"), relief->radius);
    const int n = relief->n_further;
    float further_range[3] = {0.0f};
    if (n > 0) {
        shadow_maps_range(relief->further, relief->radius, further_range);
        glUniform3fv(glGetUniformLocation(program, "further_right"), n, relief->axes[0]);
    }
    gpu_bind_texture(program, "further_maps", RELIEF_FURTHER_UNIT, GL_TEXTURE_2D_ARRAY,
                     n > 0 ? shadow_maps_texture(relief->further) : 0);
    glUniform3fv(glGetUniformLocation(program, "further_range"), 1, further_range);
}
