/* Writes a graph of MaterialX nodes as text: as elements of a MaterialX document, or as the shaders
 * of a USD material. Any thread. */
#pragma once

#include <glib.h>

struct maps_graph {
    GString *text;
    /* path of the USD material that contains the shaders; NULL for a MaterialX document */
    const char *material;
};

/* Converts the name of maps to a name of MaterialX nodes and of USD prims; g_free(). Such a name
 * may not contain "-". In USD it may not begin with a digit either. */
char *maps_graph_name(const char *name);

/* Begins a node, to which the functions below add inputs. category is the kind of node in
 * MaterialX, and type is the type of its output. The name of its definition in MaterialX's
 * libraries is ND_CATEGORY_VARIANT. */
void maps_graph_begin(const struct maps_graph *graph, const char *category, const char *variant,
                      const char *type, const char *name);
/* Ends a node that began with the same category and type. */
void maps_graph_end(const struct maps_graph *graph, const char *category, const char *type);

/* Give an input of the node its value. A link is the output of another node. */
void maps_graph_number(const struct maps_graph *graph, const char *input, double value);
void maps_graph_string(const struct maps_graph *graph, const char *input, const char *value);
void maps_graph_file(const struct maps_graph *graph, const char *input, const char *file,
                     gboolean srgb);
void maps_graph_link(const struct maps_graph *graph, const char *input, const char *type,
                     const char *node);
