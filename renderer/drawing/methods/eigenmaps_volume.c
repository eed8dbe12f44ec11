#include "eigenmaps_volume.h"

#include "directions/directions.h"
#include "drawing/gl/gpu.h"
#include "drawing/gl/ring_slices.h"
#include "eigenmaps_view.h"

#include <epoxy/gl.h>
#include <math.h>

#define HALF_MAX 65504.0F

struct EigenmapsVolume {
    int n_terms, n_slices; /* n_slices is the number of slices of a term */
    guint maps, view_weights;
    struct ring_slices lights;
};

static gboolean check(const struct eigenmaps *maps, const struct ring_slices *lights,
                      GError **error) {
    const gsize texels = btf_layout_texels(&maps->layout), n_lights = maps->layout.lights.n;
    const gsize longest = MAX(MAX(maps->layout.width, maps->layout.height),
                              (gsize)maps->n_terms * ((gsize)lights->n_slices + 1));
    GLint most = 0;
    glGetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &most);
    if (longest > (gsize)most) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "%zu × %zu texels in %d terms of %zu lights do not fit into a 3D texture: %s "
                    "supports at most %d texels in each direction; use --method eigenmaps",
                    maps->layout.width, maps->layout.height, maps->n_terms, n_lights,
                    gpu_renderer(), most);
        return FALSE;
    }
    for (gsize k = 0; k < 3 * texels * n_lights * (gsize)maps->n_terms; k++)
        if (!isfinite(maps->maps[k])) {
            g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                        "value %zu of the eigen-maps (counted from 0) is not finite: the file is "
                        "damaged; process the session again",
                        k);
            return FALSE;
        }
    return TRUE;
}

/* Uploads a slice: the sum of the maps of a term, each multiplied by the share of its light. */
static void put_slice(const struct eigenmaps *maps, int term, const float *shares, int slice,
                      float *texels) {
    const gsize n = 3 * btf_layout_texels(&maps->layout), n_lights = maps->layout.lights.n;
    for (gsize k = 0; k < n; k++) {
        float sum = 0.0F;
        for (gsize light = 0; light < n_lights; light++)
            if (shares[light] != 0.0F)
                sum += shares[light] * maps->maps[n * ((gsize)term * n_lights + light) + k];
        texels[k] = CLAMP(sum, -HALF_MAX, HALF_MAX);
    }
    glTexSubImage3D(GL_TEXTURE_3D, 0, 0, 0, slice, (int)maps->layout.width,
                    (int)maps->layout.height, 1, GL_RGB, GL_FLOAT, texels);
}

static void upload_maps(EigenmapsVolume *volume, const struct eigenmaps *maps, const float *sky) {
    const gsize n_lights = maps->layout.lights.n;
    g_autofree float *texels = g_new(float, 3 * btf_layout_texels(&maps->layout));
    g_autofree float *one = g_new0(float, n_lights);
    glGenTextures(1, &volume->maps);
    glBindTexture(GL_TEXTURE_3D, volume->maps);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_WRAP_R, GL_CLAMP_TO_EDGE);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexImage3D(GL_TEXTURE_3D, 0, GL_RGBA16F, (int)maps->layout.width, (int)maps->layout.height,
                 volume->n_terms * volume->n_slices, 0, GL_RGB, GL_FLOAT, NULL);
    for (int term = 0; term < volume->n_terms; term++) {
        const int first = term * volume->n_slices;
        for (int slice = 0; slice < volume->lights.n_slices; slice++) {
            const int light = ring_slices_direction(&volume->lights, slice);
            one[light] = 1.0F;
            put_slice(maps, term, one, first + slice, texels);
            one[light] = 0.0F;
        }
        put_slice(maps, term, sky, first + volume->lights.n_slices, texels);
    }
}

EigenmapsVolume *eigenmaps_volume_new(const struct eigenmaps *maps, GError **error) {
    const struct direction_list *lights = &maps->layout.lights;
    if (!eigenmaps_view_check(maps, error))
        return NULL;
    g_autoptr(EigenmapsVolume) volume = g_new0(EigenmapsVolume, 1);
    if (!ring_slices_find(lights->theta_deg, lights->phi_deg, (int)lights->n, &volume->lights)) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "eigen-maps in a 3D texture need lights that are evenly spaced on at most %d "
                    "rings of increasing θ, but this material has other lights: use --method "
                    "eigenmaps",
                    RING_SLICES_MAX);
        return NULL;
    }
    g_autoptr(Directions) directions = method_directions(lights, "lights", FALSE, error);
    if (!directions || !check(maps, &volume->lights, error))
        return NULL;
    g_autofree float *sky = g_new0(float, lights->n);
    directions_sky(directions, sky);
    volume->n_terms = maps->n_terms;
    volume->n_slices = volume->lights.n_slices + 1;
    volume->view_weights = eigenmaps_view_weights(maps, error);
    if (volume->view_weights == 0)
        return NULL;
    upload_maps(volume, maps, sky);
    return gpu_check("the material's 3D texture", error) ? g_steal_pointer(&volume) : NULL;
}

void eigenmaps_volume_free(EigenmapsVolume *volume) {
    if (volume == NULL)
        return;
    glDeleteTextures(1, &volume->maps);
    glDeleteTextures(1, &volume->view_weights);
    g_free(volume);
}

static gpointer open_file(const char *path, GError **error) {
    struct eigenmaps *maps = eigenmaps_read(path, error);
    EigenmapsVolume *volume = maps != NULL ? eigenmaps_volume_new(maps, error) : NULL;
    eigenmaps_free(maps);
    return volume;
}

static char *constants(gconstpointer material, const struct method_style *style) {
    (void)material;
    /* The mean of the sample, which endless materials use, is the smallest mip level. It is not
     * available, because this texture has only one level. */
    return g_strdup_printf("#define N_LEVELS 1\n#define NEAREST %d\n", style->nearest);
}

static void bind_all(gpointer material, guint program, const struct method_style *style) {
    const EigenmapsVolume *volume = material;
    (void)style;
    gpu_bind_texture(program, "maps_volume", 0, GL_TEXTURE_3D, volume->maps);
    gpu_bind_texture(program, "view_weights", 1, GL_TEXTURE_2D_ARRAY, volume->view_weights);
    glUniform1i(glGetUniformLocation(program, "n_terms"), volume->n_terms);
    glUniform1i(glGetUniformLocation(program, "n_slices"), volume->n_slices);
    glUniform1i(glGetUniformLocation(program, "light_rings"), volume->lights.n_rings);
    glUniform4fv(glGetUniformLocation(program, "light_ring"), volume->lights.n_rings,
                 volume->lights.rings[0]);
}

static gint64 bytes(gconstpointer material) {
    const EigenmapsVolume *volume = material;
    return gpu_texture_bytes(GL_TEXTURE_3D, volume->maps) +
           gpu_texture_bytes(GL_TEXTURE_2D_ARRAY, volume->view_weights);
}

static gboolean texels(gconstpointer material, int ret[2]) {
    const EigenmapsVolume *volume = material;
    gpu_texture_size(GL_TEXTURE_3D, volume->maps, 0, ret);
    return TRUE;
}

static const char *const shader_names[] = {"eigenmaps_volume.glsl", NULL};

const struct method method_eigenmaps_volume = {
    .name = "eigenmaps-volume",
    .title = "eigen-maps, 3D texture",
    .product = "eigenmaps.exr",
    .made_by = "mesorig process",
    .shaders = shader_names,
    .open = open_file,
    .free = (GDestroyNotify)eigenmaps_volume_free,
    .constants = constants,
    .bytes = bytes,
    .texels = texels,
    .bind = bind_all,
};
