/* Names and files come from maps->name, which has no character that XML or USD would have to
 * escape. */
#include "maps_graph.h"

/* Returns USD's type of an input with this type of MaterialX. */
static const char *usd_type(const char *type) {
    static const char *const types[][2] = {{"color3", "color3f"},
                                           {"vector3", "float3"},
                                           {"surfaceshader", "token"},
                                           {"displacementshader", "token"}};
    for (gsize k = 0; k < G_N_ELEMENTS(types); k++)
        if (g_str_equal(types[k][0], type))
            return types[k][1];
    return type;
}

char *maps_graph_name(const char *name) {
    char *ret = g_strconcat(g_ascii_isdigit(*name) ? "_" : "", name, NULL);
    return g_strdelimit(ret, "-", '_');
}

void maps_graph_begin(const struct maps_graph *graph, const char *category, const char *variant,
                      const char *type, const char *name) {
    if (graph->material)
        g_string_append_printf(graph->text,
                               "            def Shader \"%s\"\n            {\n"
                               "                uniform token info:id = \"ND_%s_%s\"\n",
                               name, category, variant);
    else
        g_string_append_printf(graph->text, "  <%s name=\"%s\" type=\"%s\">\n", category, name,
                               type);
}

void maps_graph_end(const struct maps_graph *graph, const char *category, const char *type) {
    if (graph->material)
        g_string_append_printf(graph->text, "                %s outputs:out\n            }\n\n",
                               usd_type(type));
    else
        g_string_append_printf(graph->text, "  </%s>\n", category);
}

void maps_graph_number(const struct maps_graph *graph, const char *input, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(text, sizeof text, "%.6g", value);
    if (graph->material)
        g_string_append_printf(graph->text, "                float inputs:%s = %s\n", input, text);
    else
        g_string_append_printf(
            graph->text, "    <input name=\"%s\" type=\"float\" value=\"%s\" />\n", input, text);
}

void maps_graph_string(const struct maps_graph *graph, const char *input, const char *value) {
    if (graph->material)
        g_string_append_printf(graph->text, "                string inputs:%s = \"%s\"\n", input,
                               value);
    else
        g_string_append_printf(
            graph->text, "    <input name=\"%s\" type=\"string\" value=\"%s\" />\n", input, value);
}

void maps_graph_file(const struct maps_graph *graph, const char *input, const char *file,
                     gboolean srgb) {
    if (graph->material)
        g_string_append_printf(graph->text,
                               "                asset inputs:%s = @./%s@ (\n"
                               "                    colorSpace = \"%s\"\n                )\n",
                               input, file, srgb ? "srgb_texture" : "raw");
    else
        g_string_append_printf(graph->text,
                               "    <input name=\"%s\" type=\"filename\" value=\"%s\"%s />\n",
                               input, file, srgb ? " colorspace=\"srgb_texture\"" : "");
}

void maps_graph_link(const struct maps_graph *graph, const char *input, const char *type,
                     const char *node) {
    if (graph->material)
        g_string_append_printf(graph->text,
                               "                %s inputs:%s.connect = <%s/%s.outputs:out>\n",
                               usd_type(type), input, graph->material, node);
    else
        g_string_append_printf(graph->text,
                               "    <input name=\"%s\" type=\"%s\" nodename=\"%s\" />\n", input,
                               type, node);
}
