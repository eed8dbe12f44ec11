#include "maps.h"

#include <math.h>

#include "maps_png.h"

void maps_free(struct maps *maps) {
    if (!maps)
        return;
    maps_fit_free(maps->fit);
    g_free(maps->name);
    g_free(maps->lost);
    g_free(maps->heights_mm);
    g_free(maps->occlusion);
    g_free(maps->errors.pairs);
    g_free(maps->errors.texels);
    g_free(maps);
}

static float eight(float value) {
    return rintf(255 * CLAMP(value, 0, 1)) / 255;
}

/* Rounds a component of a vector to the 8 bits of a normal map. */
static float eight_signed(float value) {
    return 2 * eight(value / 2 + 0.5F) - 1;
}

struct maps_texel maps_rounded(const struct maps *maps, gsize texel) {
    struct maps_texel ret = maps->fit->texels[texel];
    float length = 0;
    for (int c = 0; c < 3; c++) {
        ret.base[c] = maps_srgb_round(ret.base[c]);
        ret.specular_colour[c] =
            maps->max_specular * maps_srgb_round(ret.specular_colour[c] / maps->max_specular);
        ret.sheen[c] = maps_srgb_round(ret.sheen[c]);
        ret.normal[c] = eight_signed(ret.normal[c]);
        length += ret.normal[c] * ret.normal[c];
    }
    for (int c = 0; c < 3; c++)
        ret.normal[c] /= sqrtf(length);
    ret.metallic = eight(ret.metallic);
    ret.roughness = eight(ret.roughness);
    ret.specular = eight(ret.specular);
    ret.coat = eight(ret.coat);
    ret.anisotropy = maps->anisotropic ? eight(ret.anisotropy) : 0;
    for (int k = 0; k < 2; k++)
        ret.direction[k] = eight_signed(ret.direction[k]);
    const float along = hypotf(ret.direction[0], ret.direction[1]);
    ret.direction[0] = along > 0 ? ret.direction[0] / along : 1;
    ret.direction[1] = along > 0 ? ret.direction[1] / along : 0;
    return ret;
}
