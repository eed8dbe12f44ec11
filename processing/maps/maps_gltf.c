/* Writes glTF 2.0: meshes with tangents, textures, and one material. The text is written without a
 * JSON library. The name of the maps is the only text from outside, and has no character that JSON
 * would have to escape. */
#include <math.h>
#include <string.h>

#include "formats/glb.h"
#include "maps_png.h"
#include "maps_shapes.h"

/* A file that is being made: the lists of its JSON, and its bytes. */
struct maps_gltf {
    const struct maps *maps;
    gboolean text;
    GByteArray *bytes;
    GString *views, *accessors, *meshes, *nodes, *images, *textures;
    int n_views, n_accessors, n_meshes, n_textures;
    MapsFiles *beside; /* the export's files; receives the textures if text is TRUE */
};

static void comma(GString *list) {
    if (list->len > 0)
        g_string_append(list, ",\n  ");
}

/* Adds a buffer view. stride and target are 0 if the buffer view has none. Returns its index. */
static int put(struct maps_gltf *to, gconstpointer data, gsize size, int stride, int target) {
    static const guint8 zeros[4] = {0};
    g_byte_array_append(to->bytes, zeros, (4 - to->bytes->len % 4) % 4);
    comma(to->views);
    g_string_append_printf(to->views, "{\"buffer\": 0, \"byteOffset\": %u, \"byteLength\": %zu",
                           to->bytes->len, size);
    if (stride)
        g_string_append_printf(to->views, ", \"byteStride\": %d", stride);
    if (target)
        g_string_append_printf(to->views, ", \"target\": %d", target);
    g_string_append_c(to->views, '}');
    g_byte_array_append(to->bytes, data, (guint)size);
    return to->n_views++;
}

static void number(GString *to, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    g_string_append(to, g_ascii_formatd(text, sizeof text, "%.9g", value));
}

static void bounds(GString *to, const char *name, const float values[3]) {
    g_string_append_printf(to, ", \"%s\": [", name);
    for (int k = 0; k < 3; k++) {
        g_string_append(to, k ? ", " : "");
        number(to, (double)values[k]);
    }
    g_string_append_c(to, ']');
}

static void accessor(struct maps_gltf *to, int view, gsize offset, int type, guint count,
                     const char *kind) {
    comma(to->accessors);
    g_string_append_printf(to->accessors,
                           "{\"bufferView\": %d, \"byteOffset\": %zu, \"componentType\": %d, "
                           "\"count\": %u, \"type\": \"%s\"",
                           view, offset, type, count, kind);
    to->n_accessors++;
}

/* Adds a mesh. glTF requires little-endian numbers. The numbers are written in the byte order of
 * this machine, which must therefore be little-endian. */
static void maps_gltf_mesh(struct maps_gltf *to, const char *name, double aside,
                           struct maps_mesh mesh) {
    static const char *const kinds[] = {"VEC3", "VEC3", "VEC4", "VEC2"};
    static const gsize offsets[] = {0, 3, 6, 10};
    const guint n = mesh.vertices->len / MAPS_VERTEX, first = (guint)to->n_accessors;
    float least[3] = {INFINITY, INFINITY, INFINITY}, most[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (guint i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            const float p = g_array_index(mesh.vertices, float, i *MAPS_VERTEX + (guint)k);
            least[k] = MIN(least[k], p);
            most[k] = MAX(most[k], p);
        }
    const int vertices = put(to, mesh.vertices->data, sizeof(float) * mesh.vertices->len,
                             MAPS_VERTEX * (int)sizeof(float), 34962);
    const int indices = put(to, mesh.indices->data, sizeof(guint32) * mesh.indices->len, 0, 34963);
    for (gsize k = 0; k < G_N_ELEMENTS(kinds); k++) {
        accessor(to, vertices, sizeof(float) * offsets[k], 5126, n, kinds[k]);
        if (k == 0) {
            bounds(to->accessors, "min", least);
            bounds(to->accessors, "max", most);
        }
        g_string_append_c(to->accessors, '}');
    }
    accessor(to, indices, 0, 5125, mesh.indices->len, "SCALAR");
    g_string_append_c(to->accessors, '}');
    comma(to->meshes);
    g_string_append_printf(
        to->meshes,
        "{\"name\": \"%s\", \"primitives\": [{\"attributes\": {\"POSITION\": %u, \"NORMAL\": %u, "
        "\"TANGENT\": %u, \"TEXCOORD_0\": %u}, \"indices\": %u, \"material\": 0}]}",
        name, first, first + 1, first + 2, first + 3, first + 4);
    comma(to->nodes);
    g_string_append_printf(to->nodes, "{\"name\": \"%s\", \"mesh\": %d", name, to->n_meshes++);
    if (aside > 0) {
        g_string_append(to->nodes, ", \"translation\": [");
        number(to->nodes, aside);
        g_string_append(to->nodes, ", 0, 0]");
    }
    g_string_append_c(to->nodes, '}');
    maps_shapes_clear(&mesh);
}

typedef void (*MapsGltfFill)(const struct maps *maps, gsize texel, float *ret);

/* Adds a texture whose texels fill() gives. Returns its index, or −1 with an error. */
static int texture(struct maps_gltf *to, const char *name, int channels, gboolean srgb,
                   MapsGltfFill fill, GError **error) {
    const struct maps *maps = to->maps;
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    g_autofree float *values = g_new(float, n *(gsize)channels);
    for (gsize i = 0; i < n; i++)
        fill(maps, i, values + i * (gsize)channels);
    GBytes *png = maps_png(values, maps->width, maps->height, channels, 8, srgb, error);
    if (!png)
        return -1;
    comma(to->images);
    if (to->text) {
        char *file = g_strdup_printf("%s_%s.png", maps->name, name);
        g_string_append_printf(to->images, "{\"uri\": \"%s\"}", file);
        maps_files_take(to->beside, file, png);
    } else {
        gsize size;
        gconstpointer data = g_bytes_get_data(png, &size);
        const int view = put(to, data, size, 0, 0);
        g_string_append_printf(
            to->images, "{\"name\": \"%s\", \"bufferView\": %d, \"mimeType\": \"image/png\"}", name,
            view);
        g_bytes_unref(png);
    }
    comma(to->textures);
    g_string_append_printf(to->textures, "{\"source\": %d, \"sampler\": 0}", to->n_textures);
    return to->n_textures++;
}

static void maps_gltf_base(const struct maps *maps, gsize i, float *ret) {
    memcpy(ret, maps->fit->texels[i].base, sizeof(float) * 3);
}
static void maps_gltf_orm(const struct maps *maps, gsize i, float *ret) {
    ret[0] = maps->model == MAPS_MODEL_CORE ? 1 : maps->occlusion[i];
    ret[1] = maps->fit->texels[i].roughness;
    ret[2] = maps->fit->texels[i].metallic;
}
static void maps_gltf_normal(const struct maps *maps, gsize i, float *ret) {
    for (int c = 0; c < 3; c++)
        ret[c] = maps->fit->texels[i].normal[c] / 2 + 0.5F;
}
static void maps_gltf_specular(const struct maps *maps, gsize i, float *ret) {
    for (int c = 0; c < 3; c++)
        ret[c] = maps->fit->texels[i].specular_colour[c] / maps->max_specular;
    ret[3] = maps->fit->texels[i].specular;
}
static void anisotropy(const struct maps *maps, gsize i, float *ret) {
    for (int k = 0; k < 2; k++)
        ret[k] = maps->fit->texels[i].direction[k] / 2 + 0.5F;
    ret[2] = maps->fit->texels[i].anisotropy;
}
static void sheen(const struct maps *maps, gsize i, float *ret) {
    memcpy(ret, maps->fit->texels[i].sheen, sizeof(float) * 3);
}
static void coat(const struct maps *maps, gsize i, float *ret) {
    ret[0] = ret[1] = ret[2] = maps->fit->texels[i].coat;
}

/* Adds the extensions to the end of a material, and their names to the list extensions. */
static gboolean maps_gltf_extensions(struct maps_gltf *to, GString *material, GString *extensions,
                                     GError **error) {
    const struct maps *maps = to->maps;
    const struct maps_layers *layers = &maps->fit->layers;
    const int specular = texture(to, "Specular", 4, TRUE, maps_gltf_specular, error);
    if (specular < 0)
        return FALSE;
    g_string_append(extensions, "\"KHR_materials_specular\"");
    g_string_append_printf(
        material,
        ",\n   \"extensions\": {\"KHR_materials_specular\": "
        "{\"specularTexture\": {\"index\": %d}, \"specularColorTexture\": {\"index\": %d}, "
        "\"specularColorFactor\": [",
        specular, specular);
    for (int c = 0; c < 3; c++) {
        g_string_append(material, c ? ", " : "");
        number(material, (double)maps->max_specular);
    }
    g_string_append(material, "]}");
    if (maps->anisotropic) {
        const int k = texture(to, "Anisotropy", 3, FALSE, anisotropy, error);
        if (k < 0)
            return FALSE;
        g_string_append(extensions, ", \"KHR_materials_anisotropy\"");
        g_string_append_printf(material,
                               ",\n    \"KHR_materials_anisotropy\": {\"anisotropyStrength\": 1, "
                               "\"anisotropyTexture\": {\"index\": %d}}",
                               k);
    }
    if (layers->sheen_roughness > 0) {
        const int k = texture(to, "SheenColor", 3, TRUE, sheen, error);
        if (k < 0)
            return FALSE;
        g_string_append(extensions, ", \"KHR_materials_sheen\"");
        g_string_append_printf(material,
                               ",\n    \"KHR_materials_sheen\": {\"sheenColorFactor\": [1, 1, 1], "
                               "\"sheenColorTexture\": {\"index\": %d}, \"sheenRoughnessFactor\": ",
                               k);
        number(material, (double)layers->sheen_roughness);
        g_string_append_c(material, '}');
    }
    if (layers->coat_roughness > 0) {
        const int k = texture(to, "ClearCoat", 3, FALSE, coat, error);
        if (k < 0)
            return FALSE;
        g_string_append(extensions, ", \"KHR_materials_clearcoat\"");
        g_string_append_printf(material,
                               ",\n    \"KHR_materials_clearcoat\": {\"clearcoatFactor\": 1, "
                               "\"clearcoatTexture\": {\"index\": %d}, "
                               "\"clearcoatRoughnessFactor\": ",
                               k);
        number(material, (double)layers->coat_roughness);
        g_string_append_c(material, '}');
    }
    g_string_append(material, "}}");
    return TRUE;
}

/* Writes the material, and lists the extensions that it uses. */
static gboolean maps_gltf_material(struct maps_gltf *to, GString *material, GString *extensions,
                                   GError **error) {
    const struct maps *maps = to->maps;
    const int base = texture(to, "BaseColor", 3, TRUE, maps_gltf_base, error);
    const int orm =
        base < 0 ? -1 : texture(to, "OcclusionRoughnessMetallic", 3, FALSE, maps_gltf_orm, error);
    const int normal = orm < 0 ? -1 : texture(to, "Normal", 3, FALSE, maps_gltf_normal, error);
    if (normal < 0)
        return FALSE;
    g_string_append_printf(
        material,
        "{\"name\": \"%s\",\n   \"pbrMetallicRoughness\": {\"baseColorTexture\": {\"index\": %d}, "
        "\"metallicRoughnessTexture\": {\"index\": %d}},\n   \"normalTexture\": {\"index\": %d},"
        "\n   \"extras\": {\"depth_mm\": ",
        maps->name, base, orm, normal);
    number(material, maps->depth_mm);
    g_string_append_c(material, '}');
    if (maps->model == MAPS_MODEL_CORE) {
        g_string_append_c(material, '}');
        return TRUE;
    }
    g_string_append_printf(material, ",\n   \"occlusionTexture\": {\"index\": %d}", orm);
    return maps_gltf_extensions(to, material, extensions, error);
}

static GString *maps_gltf_json(const struct maps_gltf *to, const char *binary, const char *material,
                               const char *extensions) {
    GString *json = g_string_new("{\"asset\": {\"version\": \"2.0\", \"generator\": "
                                 "\"mesorig " MESORIG_VERSION "\"},\n");
    if (*extensions)
        g_string_append_printf(json, " \"extensionsUsed\": [%s],\n", extensions);
    g_string_append_printf(json, " \"scene\": 0,\n \"scenes\": [{\"nodes\": [0%s]}],\n",
                           to->n_meshes > 1 ? ", 1" : "");
    g_string_append_printf(json, " \"nodes\": [%s],\n \"meshes\": [\n  %s],\n", to->nodes->str,
                           to->meshes->str);
    g_string_append_printf(json,
                           " \"materials\": [\n  %s],\n \"textures\": [%s],\n \"images\": [%s],\n",
                           material, to->textures->str, to->images->str);
    g_string_append_printf(json,
                           " \"samplers\": [{\"magFilter\": 9729, \"minFilter\": 9987, \"wrapS\": "
                           "10497, \"wrapT\": 10497}],\n \"accessors\": [\n  %s],\n "
                           "\"bufferViews\": [\n  %s],\n \"buffers\": [{\"byteLength\": %u",
                           to->accessors->str, to->views->str, to->bytes->len);
    if (binary)
        g_string_append_printf(json, ", \"uri\": \"%s\"", binary);
    g_string_append(json, "}]}\n");
    return json;
}

static void maps_gltf_shapes(struct maps_gltf *to, int shapes) {
    if (shapes & MAPS_PLANE)
        maps_gltf_mesh(to, "plane", 0, maps_shapes_plane(to->maps));
    if (shapes & MAPS_SPHERE)
        maps_gltf_mesh(to, "sphere", maps_shapes_aside(to->maps, shapes),
                       maps_shapes_sphere(to->maps));
}

gboolean maps_add_gltf(const struct maps *maps, const char *file, gboolean text, int shapes,
                       MapsFiles *files, GError **error) {
    struct maps_gltf to = {maps,
                           text,
                           g_byte_array_new(),
                           g_string_new(NULL),
                           g_string_new(NULL),
                           g_string_new(NULL),
                           g_string_new(NULL),
                           g_string_new(NULL),
                           g_string_new(NULL),
                           .beside = files};
    GString *material = g_string_new(NULL), *extensions = g_string_new(NULL);
    g_autofree char *binary = text ? g_strdup_printf("%s.bin", maps->name) : NULL;
    const guint first = files->len;
    maps_gltf_shapes(&to, shapes);
    const gboolean ok = maps_gltf_material(&to, material, extensions, error);
    if (ok) {
        GString *json = maps_gltf_json(&to, binary, material->str, extensions->str);
        if (text) {
            maps_files_take(files, g_strdup(binary), g_bytes_new(to.bytes->data, to.bytes->len));
            maps_files_take_text(files, g_strdup(file), json);
        } else {
            maps_files_take(files, g_strdup(file), glb_new(json->str, to.bytes));
            g_string_free(json, TRUE);
        }
        /* The file that names the others comes first in the list. */
        g_ptr_array_insert(files, (int)first, g_ptr_array_steal_index(files, files->len - 1));
    }
    g_byte_array_unref(to.bytes);
    GString *const lists[] = {to.views,  to.accessors, to.meshes, to.nodes,
                              to.images, to.textures,  material,  extensions};
    for (gsize i = 0; i < G_N_ELEMENTS(lists); i++)
        g_string_free(lists[i], TRUE);
    return ok;
}
