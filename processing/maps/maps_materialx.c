/* Writes MaterialX 1.39, one document for each shading model. */
#include <math.h>

#include "maps_materialx.h"
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

static void image(const struct maps_graph *graph, const struct maps *maps, const char *map,
                  const char *type, gboolean srgb, gboolean closest) {
    g_autofree char *name = g_strdup_printf("map_%s", map);
    g_autofree char *file = g_strdup_printf("%s_%s.png", maps->name, map);
    maps_graph_begin(graph, "image", type, type, name);
    maps_graph_file(graph, "file", file, srgb);
    if (closest)
        maps_graph_string(graph, "filtertype", "closest");
    maps_graph_end(graph, "image", type);
}

/* Writes the lobe's tangent: the tangent of the mesh, rotated about its normal by the map's
 * angle. */
static void turned_tangent(const struct maps_graph *graph) {
    maps_graph_begin(graph, "multiply", "float", "float", "turn");
    maps_graph_link(graph, "in1", "float", "map_AnisotropyAngle");
    maps_graph_number(graph, "in2", 360);
    maps_graph_end(graph, "multiply", "float");
    maps_graph_begin(graph, "tangent", "vector3", "vector3", "mesh_tangent");
    maps_graph_string(graph, "space", "world");
    maps_graph_end(graph, "tangent", "vector3");
    maps_graph_begin(graph, "normal", "vector3", "vector3", "mesh_normal");
    maps_graph_string(graph, "space", "world");
    maps_graph_end(graph, "normal", "vector3");
    maps_graph_begin(graph, "rotate3d", "vector3", "vector3", "tangent");
    maps_graph_link(graph, "in", "vector3", "mesh_tangent");
    maps_graph_link(graph, "amount", "float", "turn");
    maps_graph_link(graph, "axis", "vector3", "mesh_normal");
    maps_graph_end(graph, "rotate3d", "vector3");
}

static void images(const struct maps_graph *graph, const struct maps *maps,
                   const struct maps_materialx_names *names) {
    image(graph, maps, "BaseColor", "color3", TRUE, FALSE);
    image(graph, maps, "Metallic", "float", FALSE, FALSE);
    image(graph, maps, names->roughness_map, "float", FALSE, FALSE);
    image(graph, maps, "SpecularWeight", "float", FALSE, FALSE);
    image(graph, maps, "Normal", "vector3", FALSE, FALSE);
    maps_graph_begin(graph, "normalmap", "float", "vector3", "bent_normal");
    maps_graph_link(graph, "in", "vector3", "map_Normal");
    maps_graph_end(graph, "normalmap", "vector3");
    if (maps->anisotropic) {
        image(graph, maps, "AnisotropyLevel", "float", FALSE, FALSE);
        image(graph, maps, "AnisotropyAngle", "float", FALSE, TRUE);
        turned_tangent(graph);
    }
    if (maps->fit->layers.sheen_roughness > 0)
        image(graph, maps, "SheenColor", "color3", TRUE, FALSE);
    if (maps->fit->layers.coat_roughness > 0)
        image(graph, maps, "ClearCoat", "float", FALSE, FALSE);
}

double maps_materialx_specular(const struct maps_texel *t) {
    const float *s = t->specular_colour;
    return (double)t->specular * (double)(s[0] + s[1] + s[2]) / 3;
}

static double maps_materialx_most(const struct maps *maps) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    double ret = 1;
    for (gsize i = 0; i < n; i++)
        ret = MAX(ret, maps_materialx_specular(&maps->fit->texels[i]));
    return ret;
}

/* Returns the index of refraction of the most specular texel. The map of the specular weight is
 * relative to the reflectance of this texel. */
static double maps_materialx_ior(const struct maps *maps) {
    const double root = sqrt(MIN((double)MAPS_DIELECTRIC * maps_materialx_most(maps), 0.9));
    return (1 + root) / (1 - root);
}

/* Writes the maps and the node "surface". */
static void surface(const struct maps_graph *graph, const struct maps *maps,
                    const struct maps_materialx_names *names) {
    const struct maps_layers *layers = &maps->fit->layers;
    g_autofree char *roughness = g_strdup_printf("map_%s", names->roughness_map);
    images(graph, maps, names);
    maps_graph_begin(graph, names->node, "surfaceshader", "surfaceshader", "surface");
    maps_graph_number(graph, names->fixed, 1);
    maps_graph_link(graph, names->base, "color3", "map_BaseColor");
    maps_graph_link(graph, names->metallic, "float", "map_Metallic");
    maps_graph_link(graph, names->specular, "float", "map_SpecularWeight");
    maps_graph_number(graph, names->ior, maps_materialx_ior(maps));
    maps_graph_link(graph, names->roughness, "float", roughness);
    maps_graph_link(graph, names->normal, "vector3", "bent_normal");
    if (maps->anisotropic) {
        maps_graph_link(graph, names->anisotropy, "float", "map_AnisotropyLevel");
        maps_graph_link(graph, names->tangent, "vector3", "tangent");
    }
    if (layers->coat_roughness > 0) {
        maps_graph_link(graph, names->coat, "float", "map_ClearCoat");
        maps_graph_number(graph, names->coat_roughness, (double)layers->coat_roughness);
    }
    if (layers->sheen_roughness > 0) {
        maps_graph_number(graph, names->sheen, 1);
        maps_graph_link(graph, names->sheen_colour, "color3", "map_SheenColor");
        maps_graph_number(graph, names->sheen_roughness, (double)layers->sheen_roughness);
    }
    maps_graph_end(graph, names->node, "surfaceshader");
}

void maps_materialx_surface(const struct maps_graph *graph, const struct maps *maps) {
    surface(graph, maps, &standard_surface);
}

static GString *document(const struct maps *maps, const struct maps_materialx_names *names) {
    const struct maps_graph graph = {
        .text = g_string_new("<?xml version=\"1.0\"?>\n<materialx version=\"1.39\" "
                             "colorspace=\"lin_rec709\">\n")};
    g_autofree char *name = maps_graph_name(maps->name);
    surface(&graph, maps, names);
    image(&graph, maps, "Height", "float", FALSE, FALSE);
    maps_graph_begin(&graph, "displacement", "float", "displacementshader", "relief");
    maps_graph_link(&graph, "displacement", "float", "map_Height");
    maps_graph_number(&graph, "scale", maps->relief_mm / 1000);
    maps_graph_end(&graph, "displacement", "displacementshader");
    maps_graph_begin(&graph, "surfacematerial", "", "material", name);
    maps_graph_link(&graph, "surfaceshader", "surfaceshader", "surface");
    maps_graph_link(&graph, "displacementshader", "displacementshader", "relief");
    maps_graph_end(&graph, "surfacematerial", "material");
    g_string_append(graph.text, "</materialx>\n");
    return graph.text;
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
        values[i] = roughness ? sqrtf(at / sqrtf(2 / (1 + left * left)))
                              : (float)(maps_materialx_specular(t) / most);
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

gboolean maps_materialx_add_weight(const struct maps *maps, MapsFiles *files, GError **error) {
    return add_map(maps, FALSE, files, error);
}

gboolean maps_add_materialx(const struct maps *maps, MapsFiles *files, GError **error) {
    const struct maps_materialx_names *const all[] = {&openpbr, &standard_surface};
    for (gsize k = 0; k < G_N_ELEMENTS(all); k++)
        maps_files_take_text(files, g_strdup_printf("%s_%s.mtlx", maps->name, all[k]->file),
                             document(maps, all[k]));
    return add_map(maps, TRUE, files, error) && add_map(maps, FALSE, files, error) &&
           maps_add_maps(maps, FALSE, files, error);
}
