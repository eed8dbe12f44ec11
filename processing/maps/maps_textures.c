/* Makes maps as PNG and EXR, and the errors as a table and as pictures. */
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#include "exr/exr.h"
#include "maps.h"
#include "maps_png.h"

/* side of the square, in pixels, that shows a pair of directions in the picture of errors */
#define CELL   8
#define MAX_DE 10.0F

static void widths(const struct maps_texel *texel, float *ret_t, float *ret_b) {
    *ret_b = texel->roughness * texel->roughness;
    *ret_t = *ret_b + (1 - *ret_b) * texel->anisotropy * texel->anisotropy;
}

float maps_specular_level(const struct maps_texel *t) {
    const float *s = t->specular_colour;
    return t->specular * (s[0] + s[1] + s[2]) / 6;
}

/* A map. fill() gives the channels of a texel. */
struct maps_texture {
    const char *name;
    int channels, bits;
    gboolean srgb;
    void (*fill)(const struct maps *maps, gsize texel, float *ret);
};

static void base(const struct maps *maps, gsize i, float *ret) {
    memcpy(ret, maps->fit->texels[i].base, sizeof(float) * 3);
}
static void metallic(const struct maps *maps, gsize i, float *ret) {
    *ret = maps->fit->texels[i].metallic;
}
static void roughness(const struct maps *maps, gsize i, float *ret) {
    float at, ab;
    widths(&maps->fit->texels[i], &at, &ab);
    *ret = powf(at * ab, 0.25F);
}
static void specular(const struct maps *maps, gsize i, float *ret) {
    *ret = maps_specular_level(&maps->fit->texels[i]);
}
static void edge(const struct maps *maps, gsize i, float *ret) {
    *ret = maps->fit->texels[i].specular;
}
/* Gives the specular colour, scaled so that its largest component is 1. */
static void tint(const struct maps *maps, gsize i, float *ret) {
    const float *s = maps->fit->texels[i].specular_colour;
    const float most = MAX(MAX(s[0], s[1]), s[2]);
    for (int c = 0; c < 3; c++)
        ret[c] = most > 0 ? s[c] / most : 1;
}
static void normal(const struct maps *maps, gsize i, float *ret) {
    for (int c = 0; c < 3; c++)
        ret[c] = maps->fit->texels[i].normal[c] / 2 + 0.5F;
}
static void maps_textures_height(const struct maps *maps, gsize i, float *ret) {
    *ret = maps->relief_mm > 0 ? maps->heights_mm[i] / (float)maps->relief_mm : 0;
}
static void occlusion(const struct maps *maps, gsize i, float *ret) {
    *ret = maps->occlusion[i];
}
static void level(const struct maps *maps, gsize i, float *ret) {
    float at, ab;
    widths(&maps->fit->texels[i], &at, &ab);
    *ret = 1 - ab / at;
}
static void maps_textures_angle(const struct maps *maps, gsize i, float *ret) {
    const float *d = maps->fit->texels[i].direction;
    const float angle = atan2f(d[1], d[0]) / (2 * (float)G_PI);
    *ret = angle < 0 ? angle + 0.5F : angle; /* t and −t are the same */
}
static void sheen(const struct maps *maps, gsize i, float *ret) {
    memcpy(ret, maps->fit->texels[i].sheen, sizeof(float) * 3);
}
static void coat(const struct maps *maps, gsize i, float *ret) {
    *ret = maps->fit->texels[i].coat;
}

static const struct maps_texture textures[] = {
    {"BaseColor", 3, 8, TRUE, base},
    {"Metallic", 1, 8, FALSE, metallic},
    {"Roughness", 1, 8, FALSE, roughness},
    {"SpecularLevel", 1, 8, FALSE, specular},
    {"SpecularEdge", 1, 8, FALSE, edge},
    {"SpecularColor", 3, 8, TRUE, tint},
    {"Normal", 3, 16, FALSE, normal},
    {"Height", 1, 16, FALSE, maps_textures_height},
    {"AmbientOcclusion", 1, 8, FALSE, occlusion},
    {"AnisotropyLevel", 1, 8, FALSE, level},
    {"AnisotropyAngle", 1, 8, FALSE, maps_textures_angle},
    {"SheenColor", 3, 8, TRUE, sheen},
    {"ClearCoat", 1, 8, FALSE, coat},
};

static gboolean has(const struct maps *maps, const struct maps_texture *texture) {
    if (texture->fill == sheen)
        return maps->fit->layers.sheen_roughness > 0;
    if (texture->fill == coat)
        return maps->fit->layers.coat_roughness > 0;
    return TRUE;
}

/* Returns the bytes of an EXR, which is written to a temporary file and read back. */
static GBytes *maps_textures_exr(const struct maps *maps, const struct maps_texture *texture,
                                 const float *values, GError **error) {
    static const char *const rgb[] = {"B", "G", "R", NULL}, *const grey[] = {"Y", NULL};
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    const gsize channels = (gsize)texture->channels;
    const gboolean height = texture->fill == maps_textures_height;
    g_autofree char *folder = g_dir_make_tmp("mesorig-XXXXXX", error), *bytes = NULL;
    gsize length = 0;
    if (!folder)
        return NULL;
    g_autofree char *path = g_build_filename(folder, "map.exr", NULL);
    g_autoptr(ExrFile) file = exr_file_new();
    struct exr_part *part = exr_part_new(texture->name, maps->width, maps->height,
                                         channels == 3 ? rgb : grey, EXR_FLOAT);
    exr_file_add(file, part);
    exr_set_double(part, "texel_mm", maps->texel_mm);
    for (gsize i = 0; i < n * channels; i++)
        part->planes[channels - 1 - i % channels][i / channels] =
            height ? maps->heights_mm[i] : values[i];
    if (exr_write(path, file, EXR_ZIP, FALSE, error))
        g_file_get_contents(path, &bytes, &length, error);
    g_unlink(path);
    g_rmdir(folder);
    return bytes ? g_bytes_new_take(g_steal_pointer(&bytes), length) : NULL;
}

gboolean maps_add_maps(const struct maps *maps, gboolean exr, MapsFiles *files, GError **error) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    g_autofree float *values = g_new(float, 3 * n);
    for (gsize k = 0; k < G_N_ELEMENTS(textures); k++) {
        const struct maps_texture *texture = &textures[k];
        if (!has(maps, texture))
            continue;
        for (gsize i = 0; i < n; i++)
            texture->fill(maps, i, values + i * (gsize)texture->channels);
        for (gsize i = 0; i < n && texture->fill == specular && !exr; i++)
            values[i] /= maps->specular_scale;
        GBytes *bytes = exr ? maps_textures_exr(maps, texture, values, error)
                            : maps_png(values, maps->width, maps->height, texture->channels,
                                       texture->bits, texture->srgb, error);
        if (!bytes)
            return FALSE;
        maps_files_take(files,
                        g_strdup_printf("%s_%s.%s", maps->name, texture->name, exr ? "exr" : "png"),
                        bytes);
    }
    return TRUE;
}

/* Gives the colour of a CIEDE2000: from black (0) over violet and orange to white (MAX_DE or more).
 * NaN, which means that nothing was compared, is grey. */
static void heat(float delta_e, float ret[3]) {
    static const float stops[5][3] = {
        {0, 0, 0}, {0.24F, 0.06F, 0.44F}, {0.73F, 0.21F, 0.33F}, {0.98F, 0.65F, 0.2F}, {1, 1, 1}};
    const float at = 4 * CLAMP(delta_e / MAX_DE, 0, 1);
    const int i = MIN((int)at, 3);
    for (int c = 0; c < 3; c++)
        ret[c] =
            isnan(delta_e) ? 0.5F : stops[i][c] + (at - (float)i) * (stops[i + 1][c] - stops[i][c]);
}

/* Returns a PNG that shows each value as a square of cell × cell pixels. */
static GBytes *picture(const float *values, int width, int height, int cell, GError **error) {
    const gsize row = (gsize)width * (gsize)cell;
    g_autofree float *rgb = g_new(float, row *(gsize)height *(gsize)cell * 3);
    for (gsize i = 0; i < row * (gsize)height * (gsize)cell; i++)
        heat(values[i / row / (gsize)cell * (gsize)width + i % row / (gsize)cell], rgb + 3 * i);
    return maps_png(rgb, width * cell, height * cell, 3, 8, FALSE, error);
}

gboolean maps_add_errors(const struct maps *maps, MapsFiles *files, GError **error) {
    const struct maps_errors *errors = &maps->errors;
    GBytes *pairs = picture(errors->pairs, errors->n_lights, errors->n_views, CELL, error);
    GBytes *texels = pairs ? picture(errors->texels, maps->width, maps->height, 1, error) : NULL;
    if (!texels) {
        g_clear_pointer(&pairs, g_bytes_unref);
        return FALSE;
    }
    maps_files_take(files, g_strdup_printf("%s_errors_directions.png", maps->name), pairs);
    maps_files_take(files, g_strdup_printf("%s_errors_texels.png", maps->name), texels);
    GString *table = g_string_new("view,light,delta_e\n");
    for (int i = 0; i < errors->n_views * errors->n_lights; i++) {
        char number[G_ASCII_DTOSTR_BUF_SIZE];
        g_ascii_formatd(number, sizeof number, "%.4f", (double)errors->pairs[i]);
        g_string_append_printf(table, "%d,%d,%s\n", i / errors->n_lights, i % errors->n_lights,
                               number);
    }
    maps_files_take_text(files, g_strdup_printf("%s_errors.csv", maps->name), table);
    return TRUE;
}
