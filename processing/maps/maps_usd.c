/* Writes USD as text: two shapes, and one material that has UsdPreviewSurface and a graph of
 * MaterialX. The name of the maps is the only text from outside, and has no character that USD
 * would have to escape in a string or in the name of a file. */
#include <math.h>

#include "maps_materialx.h"
#include "maps_shapes.h"

static void tuple(GString *to, const float *values, int n) {
    for (int k = 0; k < n; k++) {
        char text[G_ASCII_DTOSTR_BUF_SIZE];
        g_string_append_printf(to, "%s%s", k ? ", " : "(",
                               g_ascii_formatd(text, sizeof text, "%.7g", (double)values[k]));
    }
    g_string_append_c(to, ')');
}

/* Writes floats first … first + n − 1 of each vertex. */
static void vertices(GString *to, const char *declaration, const struct maps_mesh *mesh, int first,
                     int n) {
    g_string_append_printf(to, "        %s = [", declaration);
    for (guint i = 0; i < mesh->vertices->len / MAPS_VERTEX; i++) {
        const float *vertex = &g_array_index(mesh->vertices, float, i *MAPS_VERTEX);
        /* USD's v is 0 at the bottom row of a picture. */
        const float st[2] = {vertex[10], 1 - vertex[11]};
        g_string_append(to, i ? ", " : "");
        tuple(to, n == 2 ? st : vertex + first, n);
    }
    g_string_append(to, "]");
}

static void extent(GString *to, const struct maps_mesh *mesh) {
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (guint i = 0; i < mesh->vertices->len / MAPS_VERTEX; i++)
        for (guint k = 0; k < 3; k++) {
            const float p = g_array_index(mesh->vertices, float, i *MAPS_VERTEX + k);
            low[k] = MIN(low[k], p);
            high[k] = MAX(high[k], p);
        }
    g_string_append(to, "        float3[] extent = [");
    tuple(to, low, 3);
    g_string_append(to, ", ");
    tuple(to, high, 3);
    g_string_append(to, "]\n");
}

static void usd_mesh(GString *to, const char *name, const char *material, double aside,
                     struct maps_mesh mesh) {
    const float place[3] = {(float)aside, 0, 0};
    g_string_append_printf(to,
                           "    def Mesh \"%s\" (\n"
                           "        prepend apiSchemas = [\"MaterialBindingAPI\"]\n"
                           "    )\n"
                           "    {\n",
                           name);
    extent(to, &mesh);
    g_string_append(to, "        int[] faceVertexCounts = [");
    for (guint i = 0; i < mesh.indices->len / 3; i++)
        g_string_append(to, i ? ", 3" : "3");
    g_string_append(to, "]\n        int[] faceVertexIndices = [");
    for (guint i = 0; i < mesh.indices->len; i++)
        g_string_append_printf(to, "%s%u", i ? ", " : "", g_array_index(mesh.indices, guint32, i));
    g_string_append_printf(to, "]\n        rel material:binding = <%s>\n", material);
    vertices(to, "normal3f[] normals", &mesh, 3, 3);
    g_string_append(to, " (\n            interpolation = \"vertex\"\n        )\n");
    vertices(to, "point3f[] points", &mesh, 0, 3);
    g_string_append_c(to, '\n');
    vertices(to, "texCoord2f[] primvars:st", &mesh, 10, 2);
    g_string_append(to, " (\n            interpolation = \"vertex\"\n        )\n"
                        "        uniform token subdivisionScheme = \"none\"\n");
    if (aside > 0) {
        g_string_append(to, "        double3 xformOp:translate = ");
        tuple(to, place, 3);
        g_string_append(to, "\n        uniform token[] xformOpOrder = [\"xformOp:translate\"]\n");
    }
    g_string_append(to, "    }\n\n");
    maps_shapes_clear(&mesh);
}

/* Writes a texture that UsdPreviewSurface reads. */
static void texture(GString *to, const struct maps *maps, const char *material, const char *map,
                    const char *output, gboolean srgb) {
    const gboolean normal = g_str_equal(map, "Normal");
    g_string_append_printf(to,
                           "            def Shader \"preview_%s\"\n"
                           "            {\n"
                           "                uniform token info:id = \"UsdUVTexture\"\n"
                           "                asset inputs:file = @./%s_%s.png@\n"
                           "                float2 inputs:st.connect = <%s/st.outputs:result>\n"
                           "                token inputs:sourceColorSpace = \"%s\"\n"
                           "                token inputs:wrapS = \"repeat\"\n"
                           "                token inputs:wrapT = \"repeat\"\n",
                           map, maps->name, map, material, srgb ? "sRGB" : "raw");
    if (normal) /* components from 0 … 1 to −1 … 1 */
        g_string_append(to, "                float4 inputs:scale = (2, 2, 2, 1)\n"
                            "                float4 inputs:bias = (-1, -1, -1, 0)\n");
    g_string_append_printf(to, "                %s\n            }\n\n", output);
}

/* Returns the index of refraction whose reflectance along the normal is the mean over the texels.
 * Metals count less, because the index does not change their reflectance. */
static double mean_ior(const struct maps *maps) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    double sum = 0, weights = 1e-6;
    for (gsize i = 0; i < n; i++) {
        const struct maps_texel *t = &maps->fit->texels[i];
        const double weight = 1 - (double)t->metallic;
        sum += weight * maps_materialx_specular(t);
        weights += weight;
    }
    const double root = sqrt(MIN((double)MAPS_DIELECTRIC * sum / weights, 0.9));
    return (1 + root) / (1 - root);
}

/* Writes UsdPreviewSurface (Pixar 2016, version 2.6) and its textures. UsdPreviewSurface has no
 * anisotropy and no sheen. Its dielectrics have the same reflectance in all texels. */
static void preview(GString *to, const struct maps *maps, const char *material) {
    static const char *const inputs[][4] = {
        {"color3f", "diffuseColor", "BaseColor", "rgb"}, {"float", "metallic", "Metallic", "r"},
        {"float", "roughness", "Roughness", "r"},        {"normal3f", "normal", "Normal", "rgb"},
        {"float", "occlusion", "AmbientOcclusion", "r"}, {"float", "clearcoat", "ClearCoat", "r"}};
    const gsize n_inputs = maps->fit->layers.coat_roughness > 0 ? 6
                           : maps->model == MAPS_MODEL_CORE     ? 4
                                                                : 5;
    const struct maps_graph graph = {to, material};
    g_string_append(to, "            def Shader \"preview\"\n            {\n"
                        "                uniform token info:id = \"UsdPreviewSurface\"\n");
    for (gsize k = 0; k < n_inputs; k++)
        g_string_append_printf(
            to, "                %s inputs:%s.connect = <%s/preview_%s.outputs:%s>\n", inputs[k][0],
            inputs[k][1], material, inputs[k][2], inputs[k][3]);
    maps_graph_number(&graph, "ior", mean_ior(maps));
    if (n_inputs == 6)
        maps_graph_number(&graph, "clearcoatRoughness", (double)maps->fit->layers.coat_roughness);
    g_string_append(to, "                token outputs:surface\n            }\n\n"
                        "            def Shader \"st\"\n            {\n"
                        "                uniform token info:id = \"UsdPrimvarReader_float2\"\n"
                        "                string inputs:varname = \"st\"\n"
                        "                float2 outputs:result\n            }\n\n");
    for (gsize k = 0; k < n_inputs; k++)
        texture(to, maps, material, inputs[k][2],
                g_str_equal(inputs[k][3], "r") ? "float outputs:r" : "float3 outputs:rgb", k == 0);
}

static void usd_material(GString *to, const struct maps *maps, const char *name, const char *path) {
    char depth[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(depth, sizeof depth, "%.9g", maps->depth_mm);
    g_string_append_printf(
        to,
        "    def Scope \"Materials\"\n    {\n"
        "        def Material \"%s\" (\n"
        "            prepend apiSchemas = [\"MaterialXConfigAPI\"]\n"
        "            customData = {\n                double depth_mm = %s\n            }\n"
        "        )\n        {\n"
        "            uniform string config:mtlx:version = \"1.39\"\n"
        "            token outputs:mtlx:surface.connect = <%s/surface.outputs:out>\n"
        "            token outputs:surface.connect = <%s/preview.outputs:surface>\n\n",
        name, depth, path, path);
    preview(to, maps, path);
    maps_materialx_surface(&(struct maps_graph){to, path}, maps);
    g_string_truncate(to, to->len - 1);
    g_string_append(to, "        }\n    }\n");
}

gboolean maps_add_usd(const struct maps *maps, int shapes, MapsFiles *files, GError **error) {
    g_autofree char *name = maps_graph_name(maps->name);
    g_autofree char *material = g_strdup_printf("/%s/Materials/%s", name, name);
    GString *to = g_string_new("#usda 1.0\n(\n    customLayerData = {\n"
                               "        string creator = \"mesorig " MESORIG_VERSION "\"\n    }\n");
    g_string_append_printf(to,
                           "    defaultPrim = \"%s\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n"
                           ")\n\ndef Xform \"%s\"\n{\n",
                           name, name);
    if (shapes & MAPS_PLANE)
        usd_mesh(to, "plane", material, 0, maps_shapes_plane(maps));
    if (shapes & MAPS_SPHERE)
        usd_mesh(to, "sphere", material, maps_shapes_aside(maps, shapes), maps_shapes_sphere(maps));
    usd_material(to, maps, name, material);
    g_string_append(to, "}\n");
    maps_files_take_text(files, g_strdup_printf("%s.usda", maps->name), to);
    return maps_materialx_add_weight(maps, files, error) &&
           maps_add_maps(maps, FALSE, files, error);
}
