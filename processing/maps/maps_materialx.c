/* Writes MaterialX 1.39, one document for each shading model. The name of the maps is the only text
 * from outside, and has no character that XML would have to escape. */
#include <math.h>

#include "maps.h"
#include "maps_png.h"

/* The names of the inputs in one of the shading models, standard_surface or OpenPBR. */
struct maps_materialx_names {
    const char *file, *node, *fixed;
    const char *base, *metallic, *specular, *roughness, *ior, *anisotropy;
    const char *coat, *coat_roughness, *sheen, *sheen_colour, *sheen_roughness;
    const char *normal, *tangent;
    const char *roughness_map;
};

static const struct maps_materialx_names standard_surface = {"standard_surface",
                                                             "standard_surface",
                                                             "base",
                                                             "base_color",
                                                             "metalness",
                                                             "specular",
                                                             "specular_roughness",
                                                             "specular_IOR",
                                                             "specular_anisotropy",
                                                             "coat",
                                                             "coat_roughness",
                                                             "sheen",
                                                             "sheen_color",
                                                             "sheen_roughness",
                                                             "normal",
                                                             "tangent",
                                                             "Roughness"};
static const struct maps_materialx_names openpbr = {"openpbr",
                                                    "open_pbr_surface",
                                                    "base_weight",
                                                    "base_color",
                                                    "base_metalness",
                                                    "specular_weight",
                                                    "specular_roughness",
                                                    "specular_ior",
                                                    "specular_roughness_anisotropy",
                                                    "coat_weight",
                                                    "coat_roughness",
                                                    "fuzz_weight",
                                                    "fuzz_color",
                                                    "fuzz_roughness",
                                                    "geometry_normal",
                                                    "geometry_tangent",
                                                    "OpenPBRRoughness"};

static void number(GString *to, const char *name, const char *type, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    g_string_append_printf(to, "    <input name=\"%s\" type=\"%s\" value=\"%s\" />\n", name, type,
                           g_ascii_formatd(text, sizeof text, "%.6g", value));
}

static void maps_materialx_link(GString *to, const char *name, const char *type, const char *node) {
    g_string_append_printf(to, "    <input name=\"%s\" type=\"%s\" nodename=\"%s\" />\n", name,
                           type, node);
}

static void maps_materialx_map(const struct maps *maps, GString *to, const char *map,
                               const char *type, gboolean srgb, gboolean closest) {
    g_string_append_printf(
        to,
        "  <image name=\"map_%s\" type=\"%s\">\n    <input name=\"file\" type=\"filename\" "
        "value=\"%s_%s.png\"%s />\n%s  </image>\n",
        map, type, maps->name, map, srgb ? " colorspace=\"srgb_texture\"" : "",
        closest ? "    <input name=\"filtertype\" type=\"string\" value=\"closest\" />\n" : "");
}

/* Writes the lobe's tangent: the tangent of the mesh, rotated about its normal by the map's
 * angle. */
static void maps_materialx_tangent(GString *to) {
    g_string_append(
        to,
        "  <multiply name=\"turn\" type=\"float\">\n"
        "    <input name=\"in1\" type=\"float\" nodename=\"map_AnisotropyAngle\" />\n"
        "    <input name=\"in2\" type=\"float\" value=\"360\" />\n  </multiply>\n"
        "  <tangent name=\"mesh_tangent\" type=\"vector3\">\n"
        "    <input name=\"space\" type=\"string\" value=\"world\" />\n  </tangent>\n"
        "  <normal name=\"mesh_normal\" type=\"vector3\">\n"
        "    <input name=\"space\" type=\"string\" value=\"world\" />\n  </normal>\n"
        "  <rotate3d name=\"tangent\" type=\"vector3\">\n"
        "    <input name=\"in\" type=\"vector3\" nodename=\"mesh_tangent\" />\n"
        "    <input name=\"amount\" type=\"float\" nodename=\"turn\" />\n"
        "    <input name=\"axis\" type=\"vector3\" nodename=\"mesh_normal\" />\n  </rotate3d>\n");
}

static void maps_materialx_maps(const struct maps *maps, const struct maps_materialx_names *names,
                                GString *to) {
    maps_materialx_map(maps, to, "BaseColor", "color3", TRUE, FALSE);
    maps_materialx_map(maps, to, "Metallic", "float", FALSE, FALSE);
    maps_materialx_map(maps, to, names->roughness_map, "float", FALSE, FALSE);
    maps_materialx_map(maps, to, "SpecularWeight", "float", FALSE, FALSE);
    maps_materialx_map(maps, to, "Normal", "vector3", FALSE, FALSE);
    maps_materialx_map(maps, to, "Height", "float", FALSE, FALSE);
    g_string_append(to, "  <normalmap name=\"bent_normal\" type=\"vector3\">\n"
                        "    <input name=\"in\" type=\"vector3\" nodename=\"map_Normal\" />\n"
                        "  </normalmap>\n");
    if (maps->anisotropic) {
        maps_materialx_map(maps, to, "AnisotropyLevel", "float", FALSE, FALSE);
        maps_materialx_map(maps, to, "AnisotropyAngle", "float", FALSE, TRUE);
        maps_materialx_tangent(to);
    }
    if (maps->fit->layers.sheen_roughness > 0)
        maps_materialx_map(maps, to, "SheenColor", "color3", TRUE, FALSE);
    if (maps->fit->layers.coat_roughness > 0)
        maps_materialx_map(maps, to, "ClearCoat", "float", FALSE, FALSE);
}

/* Returns the factor by which the specular weight and colour of a texel multiply the reflectance of
 * 4 %. */
static double factor(const struct maps_texel *t) {
    const float *s = t->specular_colour;
    return (double)t->specular * (double)(s[0] + s[1] + s[2]) / 3;
}

static double maps_materialx_most(const struct maps *maps) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    double ret = 1;
    for (gsize i = 0; i < n; i++)
        ret = MAX(ret, factor(&maps->fit->texels[i]));
    return ret;
}

/* Returns the index of refraction of the most specular texel. The map of the specular weight is
 * relative to the reflectance of this texel. */
static double maps_materialx_ior(const struct maps *maps) {
    const double root = sqrt(MIN((double)MAPS_DIELECTRIC * maps_materialx_most(maps), 0.9));
    return (1 + root) / (1 - root);
}

static GString *document(const struct maps *maps, const struct maps_materialx_names *names) {
    const struct maps_layers *layers = &maps->fit->layers;
    GString *to = g_string_new("<?xml version=\"1.0\"?>\n<materialx version=\"1.39\" "
                               "colorspace=\"lin_rec709\">\n");
    maps_materialx_maps(maps, names, to);
    g_string_append_printf(to, "  <%s name=\"surface\" type=\"surfaceshader\">\n", names->node);
    number(to, names->fixed, "float", 1);
    maps_materialx_link(to, names->base, "color3", "map_BaseColor");
    maps_materialx_link(to, names->metallic, "float", "map_Metallic");
    maps_materialx_link(to, names->specular, "float", "map_SpecularWeight");
    number(to, names->ior, "float", maps_materialx_ior(maps));
    g_autofree char *roughness = g_strdup_printf("map_%s", names->roughness_map);
    maps_materialx_link(to, names->roughness, "float", roughness);
    maps_materialx_link(to, names->normal, "vector3", "bent_normal");
    if (maps->anisotropic) {
        maps_materialx_link(to, names->anisotropy, "float", "map_AnisotropyLevel");
        maps_materialx_link(to, names->tangent, "vector3", "tangent");
    }
    if (layers->coat_roughness > 0) {
        maps_materialx_link(to, names->coat, "float", "map_ClearCoat");
        number(to, names->coat_roughness, "float", (double)layers->coat_roughness);
    }
    if (layers->sheen_roughness > 0) {
        number(to, names->sheen, "float", 1);
        maps_materialx_link(to, names->sheen_colour, "color3", "map_SheenColor");
        number(to, names->sheen_roughness, "float", (double)layers->sheen_roughness);
    }
    g_string_append_printf(to, "  </%s>\n", names->node);
    g_string_append(to, "  <displacement name=\"relief\" type=\"displacementshader\">\n");
    maps_materialx_link(to, "displacement", "float", "map_Height");
    number(to, "scale", "float", maps->relief_mm / 1000);
    g_string_append_printf(
        to,
        "  </displacement>\n  <surfacematerial name=\"%s\" type=\"material\">\n    <input "
        "name=\"surfaceshader\" type=\"surfaceshader\" nodename=\"surface\" />\n    <input "
        "name=\"displacementshader\" type=\"displacementshader\" nodename=\"relief\" />\n  "
        "</surfacematerial>\n</materialx>\n",
        maps->name);
    return to;
}

/* Adds the map of roughness, or of the specular weight. OpenPBR's roughness r follows from αt = r²
 * √(2 / (1 + (1 − a)²)), with a the level of anisotropy (ASWF 2024). The specular weight is
 * relative to the index of refraction of the document. */
static gboolean add_map(const struct maps *maps, gboolean roughness, MapsFiles *files,
                        GError **error) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    g_autofree float *values = g_new(float, n);
    const double most = maps_materialx_most(maps);
    for (gsize i = 0; i < n; i++) {
        const struct maps_texel *t = &maps->fit->texels[i];
        const float ab = t->roughness * t->roughness;
        const float at = ab + (1 - ab) * t->anisotropy * t->anisotropy, left = ab / at;
        values[i] =
            roughness ? sqrtf(at / sqrtf(2 / (1 + left * left))) : (float)(factor(t) / most);
    }
    GBytes *png = maps_png(values, maps->width, maps->height, 1, 8, FALSE, error);
    if (!png)
        return FALSE;
    maps_files_take(files,
                    g_strdup_printf("%s_%s.png", maps->name,
                                    roughness ? openpbr.roughness_map : "SpecularWeight"),
                    png);
    return TRUE;
}

gboolean maps_add_materialx(const struct maps *maps, MapsFiles *files, GError **error) {
    const struct maps_materialx_names *const all[] = {&openpbr, &standard_surface};
    for (gsize k = 0; k < G_N_ELEMENTS(all); k++)
        maps_files_take_text(files, g_strdup_printf("%s_%s.mtlx", maps->name, all[k]->file),
                             document(maps, all[k]));
    return add_map(maps, TRUE, files, error) && add_map(maps, FALSE, files, error) &&
           maps_add_maps(maps, FALSE, files, error);
}
