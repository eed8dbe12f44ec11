#include "gltf_file.h"

#include "soup.h"

#include "base/input_file.h"

#include <math.h>
#include <string.h>

#define MAX_DEPTH 64 /* largest depth of the JSON, because its parser is recursive */
#define MAGIC     0x46546c67U
#define JSON      0x4e4f534aU
#define BINARY    0x004e4942U

gboolean gltf_fail(const struct gltf *gltf, enum scene_error code, GError **error,
                   const char *format, ...) {
    va_list list;
    va_start(list, format);
    g_autofree char *text = g_strdup_vprintf(format, list);
    va_end(list);
    g_set_error(error, SCENE_ERROR, code, "%s: %s", gltf->path, text);
    return FALSE;
}

gint64 gltf_int(JsonObject *object, const char *name, gint64 fallback) {
    JsonNode *node = json_object_get_member(object, name);
    if (node == NULL || !JSON_NODE_HOLDS_VALUE(node))
        return fallback;
    const GType type = json_node_get_value_type(node);
    if (type == G_TYPE_INT64)
        return json_node_get_int(node);
    const double value = type == G_TYPE_DOUBLE ? json_node_get_double(node) : NAN;
    return value == rint(value) && fabs(value) < 1e15 ? (gint64)value : fallback;
}

const char *gltf_string(JsonObject *object, const char *name) {
    JsonNode *node = json_object_get_member(object, name);
    return node != NULL && JSON_NODE_HOLDS_VALUE(node) &&
                   json_node_get_value_type(node) == G_TYPE_STRING
               ? json_node_get_string(node)
               : NULL;
}

JsonArray *gltf_array(JsonObject *object, const char *name) {
    JsonNode *node = json_object_get_member(object, name);
    return node != NULL && JSON_NODE_HOLDS_ARRAY(node) ? json_node_get_array(node) : NULL;
}

JsonObject *gltf_object(JsonObject *object, const char *name) {
    JsonNode *node = json_object_get_member(object, name);
    return node != NULL && JSON_NODE_HOLDS_OBJECT(node) ? json_node_get_object(node) : NULL;
}

JsonObject *gltf_item(const struct gltf *gltf, const char *array, gint64 k, GError **error) {
    JsonArray *items = gltf_array(gltf->root, array);
    const guint n = items != NULL ? json_array_get_length(items) : 0;
    JsonNode *node = k >= 0 && k < n ? json_array_get_element(items, (guint)k) : NULL;
    if (node != NULL && JSON_NODE_HOLDS_OBJECT(node))
        return json_node_get_object(node);
    gltf_bad(gltf, error,
             "there is no entry %" G_GINT64_FORMAT
             " in the array “%s”, which has %u entries, counted from 0; export the file again",
             k, array, n);
    return NULL;
}

/* Returns the largest depth of nested brackets. Brackets in strings do not count. */
static int depth_of(const char *text, gsize length) {
    int depth = 0, deepest = 0;
    gboolean string = FALSE;
    for (gsize k = 0; k < length; k++) {
        if (string)
            k += text[k] == '\\';
        if (k < length && text[k] == '"')
            string = !string;
        else if (!string && (text[k] == '[' || text[k] == '{'))
            depth++;
        else if (!string && (text[k] == ']' || text[k] == '}'))
            depth--;
        deepest = MAX(deepest, depth);
    }
    return deepest;
}

static gboolean parse(struct gltf *gltf, const char *text, gsize length, GError **error) {
    g_autoptr(GError) why = NULL;
    const int nested = depth_of(text, length);
    if (nested > MAX_DEPTH)
        return gltf_bad(gltf, error,
                        "its JSON is nested %d deep, but at most %d is read; export the file again",
                        nested, MAX_DEPTH);
    gltf->parser = json_parser_new_immutable();
    if (!json_parser_load_from_data(gltf->parser, text, (gssize)length, &why))
        return gltf_bad(gltf, error,
                        "not glTF, because its JSON cannot be parsed: %s; export the file again",
                        why->message);
    JsonNode *root = json_parser_get_root(gltf->parser);
    JsonObject *asset = root != NULL && JSON_NODE_HOLDS_OBJECT(root)
                            ? gltf_object(gltf->root = json_node_get_object(root), "asset")
                            : NULL;
    const char *version = asset != NULL ? gltf_string(asset, "version") : NULL;
    if (version == NULL || !g_str_has_prefix(version, "2."))
        return gltf_bad(gltf, error,
                        "not glTF of version 2: asset.version is “%s”; export it as glTF 2.0",
                        version != NULL ? version : "");
    JsonArray *required = gltf_array(gltf->root, "extensionsRequired");
    for (guint k = 0; required != NULL && k < json_array_get_length(required); k++) {
        JsonNode *node = json_array_get_element(required, k);
        const char *name = JSON_NODE_HOLDS_VALUE(node) ? json_node_get_string(node) : NULL;
        /* Extensions that are ignored: they only concern textures, materials and lamps. */
        if (name == NULL ||
            (!g_str_has_prefix(name, "KHR_materials_") && !g_str_has_prefix(name, "KHR_texture_") &&
             !g_str_equal(name, "KHR_lights_punctual") && !g_str_has_prefix(name, "EXT_texture_")))
            return gltf_bad(gltf, error,
                            "it needs the extension %s, which cannot be read; export the file "
                            "again without this extension (for a compressed mesh: uncompressed)",
                            name != NULL ? name : "(no name)");
    }
    return TRUE;
}

static guint32 word(const guint8 *bytes) {
    return bytes[0] | (guint32)bytes[1] << 8 | (guint32)bytes[2] << 16 | (guint32)bytes[3] << 24;
}

/* Reads a .glb: a header, JSON, and optionally binary data. */
static gboolean parse_binary(struct gltf *gltf, GBytes *file, GError **error) {
    gsize size;
    const guint8 *bytes = g_bytes_get_data(file, &size);
    if (size < 20)
        return gltf_bad(gltf, error, "truncated: it has only %zu bytes; copy the file again", size);
    if (word(bytes + 4) != 2)
        return gltf_bad(gltf, error,
                        "not binary glTF of version 2, but of version %u; export it as glTF 2.0",
                        word(bytes + 4));
    if (word(bytes + 16) != JSON)
        return gltf_bad(gltf, error, "its first chunk is not JSON; export the file again");
    if (word(bytes + 8) > size || word(bytes + 12) > size - 20)
        return gltf_bad(gltf, error,
                        "truncated: its header names %u bytes with %u of JSON, but it has %zu; "
                        "copy the file again",
                        word(bytes + 8), word(bytes + 12), size);
    const gsize length = word(bytes + 12), next = 20 + length;
    if (next + 8 <= size && word(bytes + next + 4) == BINARY) {
        if (word(bytes + next) > size - next - 8)
            return gltf_bad(gltf, error,
                            "truncated: its binary chunk should have %u bytes, but %zu are left; "
                            "copy the file again",
                            word(bytes + next), size - next - 8);
        gltf->binary = g_bytes_new_from_bytes(file, next + 8, word(bytes + next));
    }
    return parse(gltf, (const char *)bytes + 20, length, error);
}

static GBytes *read_file(const char *path, GError **error) {
    GError *why = NULL;
    gsize length;
    char *bytes = input_file_read(path, SCENE_MAX_FILE, &length, &why);
    if (bytes != NULL)
        return g_bytes_new_take(bytes, length);
    input_file_propagate(why, SCENE_ERROR, SCENE_ERROR_IO, SCENE_ERROR_FORMAT, error);
    return NULL;
}

gboolean gltf_open(struct gltf *gltf, const char *path, GError **error) {
    *gltf = (struct gltf){.path = path};
    g_autoptr(GBytes) file = read_file(path, error);
    if (file == NULL)
        return FALSE;
    gsize size;
    const guint8 *bytes = g_bytes_get_data(file, &size);
    const gboolean binary = size >= 4 && word(bytes) == MAGIC;
    if (!(binary ? parse_binary(gltf, file, error)
                 : parse(gltf, bytes != NULL ? (const char *)bytes : "", size, error)))
        return FALSE;
    JsonArray *buffers = gltf_array(gltf->root, "buffers");
    gltf->buffers = g_ptr_array_new_with_free_func((GDestroyNotify)g_bytes_unref);
    g_ptr_array_set_size(gltf->buffers, buffers != NULL ? (int)json_array_get_length(buffers) : 0);
    return TRUE;
}

void gltf_clear(struct gltf *gltf) {
    g_clear_object(&gltf->parser);
    g_clear_pointer(&gltf->binary, g_bytes_unref);
    g_clear_pointer(&gltf->buffers, g_ptr_array_unref);
}

/* Reads the bytes in a data URI, or in a file below the folder of the glTF file. */
static GBytes *read_uri(const struct gltf *gltf, const char *uri, GError **error) {
    const char *comma = strchr(uri, ',');
    if (g_str_has_prefix(uri, "data:")) {
        gsize size = 0;
        if (comma == NULL || comma - uri < 7 || strncmp(comma - 7, ";base64", 7) != 0) {
            gltf_bad(gltf, error, "a data URI is not in base64; export the file again");
            return NULL;
        }
        guint8 *bytes = g_base64_decode(comma + 1, &size);
        return g_bytes_new_take(bytes, size);
    }
    g_autofree char *name = g_uri_unescape_string(uri, NULL);
    g_autofree char *folder = g_path_get_dirname(gltf->path);
    if (name == NULL || g_path_is_absolute(name) || strstr(name, "..") != NULL ||
        strstr(name, ":") != NULL) {
        gltf_bad(gltf, error,
                 "it names the file “%s”, but only files in its own folder are opened; export it "
                 "again with all files in one folder",
                 uri);
        return NULL;
    }
    g_autofree char *path = g_build_filename(folder, name, NULL);
    return read_file(path, error);
}

static GBytes *buffer_at(struct gltf *gltf, gint64 k, GError **error) {
    JsonObject *buffer = gltf_item(gltf, "buffers", k, error);
    if (buffer == NULL)
        return NULL;
    if (gltf->buffers->pdata[k] != NULL)
        return gltf->buffers->pdata[k];
    const char *uri = gltf_string(buffer, "uri");
    GBytes *bytes = NULL;
    if (uri != NULL)
        bytes = read_uri(gltf, uri, error);
    else if (k == 0 && gltf->binary != NULL)
        bytes = g_bytes_ref(gltf->binary);
    else
        gltf_bad(gltf, error,
                 "buffer %d has neither a URI nor a binary chunk; export the file again", (int)k);
    gltf->buffers->pdata[k] = bytes;
    return bytes;
}

GBytes *gltf_image(struct gltf *gltf, gint64 k, GError **error) {
    JsonObject *image = gltf_item(gltf, "images", k, error);
    const char *uri = image != NULL ? gltf_string(image, "uri") : NULL;
    if (image == NULL || uri != NULL)
        return image != NULL ? read_uri(gltf, uri, error) : NULL;
    JsonObject *view = gltf_item(gltf, "bufferViews", gltf_int(image, "bufferView", -1), error);
    GBytes *buffer = view != NULL ? buffer_at(gltf, gltf_int(view, "buffer", -1), error) : NULL;
    if (buffer == NULL)
        return NULL;
    const gint64 from = gltf_int(view, "byteOffset", 0), n = gltf_int(view, "byteLength", -1);
    const gint64 size = (gint64)g_bytes_get_size(buffer);
    if (from < 0 || n < 0 || from > size || n > size - from) {
        gltf_bad(gltf, error,
                 "truncated: image %d lies outside its buffer; copy or export the file again",
                 (int)k);
        return NULL;
    }
    return g_bytes_new_from_bytes(buffer, (gsize)from, (gsize)n);
}

/* Location of the numbers of an accessor. */
struct numbers {
    const guint8 *bytes;
    gsize n, stride;
    int type, size, n_components;
    gboolean normalized;
};

static gboolean find_bytes(struct gltf *gltf, gint64 k, JsonObject *accessor, struct numbers *ret,
                           GError **error) {
    JsonObject *view = gltf_item(gltf, "bufferViews", gltf_int(accessor, "bufferView", -1), error);
    GBytes *buffer = view != NULL ? buffer_at(gltf, gltf_int(view, "buffer", -1), error) : NULL;
    if (buffer == NULL)
        return FALSE;
    const gint64 element = (gint64)ret->size * ret->n_components;
    const gint64 view_from = gltf_int(view, "byteOffset", 0);
    const gint64 view_size = gltf_int(view, "byteLength", -1);
    const gint64 from = gltf_int(accessor, "byteOffset", 0);
    const gint64 stride = gltf_int(view, "byteStride", element);
    const gint64 size = (gint64)g_bytes_get_size(buffer);
    if (view_from < 0 || view_size < 0 || view_from > size || view_size > size - view_from)
        return gltf_bad(gltf, error,
                        "truncated: a buffer view of %" G_GINT64_FORMAT
                        " bytes from byte %" G_GINT64_FORMAT
                        " on lies outside its buffer of %" G_GINT64_FORMAT
                        " bytes; copy or export the file again",
                        view_size, view_from, size);
    if (from < 0 || stride < element || stride > 65536 || from > view_size ||
        (ret->n > 0 && (gint64)(ret->n - 1) * stride + element > view_size - from))
        return gltf_bad(gltf, error,
                        "the %" G_GSIZE_FORMAT
                        " values of accessor %d lie outside its buffer view; export the file again",
                        ret->n, (int)k);
    const guint8 *start = g_bytes_get_data(buffer, NULL);
    if (start == NULL)
        return gltf_bad(gltf, error, "the buffer of accessor %d is empty; export the file again",
                        (int)k);
    ret->bytes = start + view_from + from;
    ret->stride = (gsize)stride;
    return TRUE;
}

static gboolean find_numbers(struct gltf *gltf, gint64 k, int n_components, struct numbers *ret,
                             GError **error) {
    static const char *const shapes[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
    /* Bytes of a number of the component types 5120 to 5126: byte, ubyte, short, ushort, none,
     * uint, float. */
    static const int sizes[] = {1, 1, 2, 2, 0, 4, 4};
    JsonObject *accessor = gltf_item(gltf, "accessors", k, error);
    if (accessor == NULL)
        return FALSE;
    const gint64 n = gltf_int(accessor, "count", -1);
    const int type = (int)CLAMP(gltf_int(accessor, "componentType", 0), 0, 9999);
    *ret = (struct numbers){.type = type,
                            .size = type >= 5120 && type <= 5126 ? sizes[type - 5120] : 0,
                            .n_components = n_components};
    JsonNode *normalized = json_object_get_member(accessor, "normalized");
    ret->normalized = normalized != NULL && JSON_NODE_HOLDS_VALUE(normalized) &&
                      json_node_get_boolean(normalized);
    const char *shape = gltf_string(accessor, "type");
    if (ret->size == 0)
        return gltf_bad(gltf, error,
                        "accessor %d has the unknown component type %d; export the file again",
                        (int)k, type);
    if (g_strcmp0(shape, shapes[n_components - 1]) != 0)
        return gltf_bad(gltf, error,
                        "accessor %d is of type %s, but %s is needed; export the file again",
                        (int)k, shape != NULL ? shape : "“”", shapes[n_components - 1]);
    if (gltf_object(accessor, "sparse") != NULL)
        return gltf_bad(
            gltf, error,
            "accessor %d is sparse, which cannot be read; save the file without sparse accessors",
            (int)k);
    if (n < 0 || n > SOUP_MAX_CORNERS)
        return gltf_fail(gltf, SCENE_ERROR_TOO_LARGE, error,
                         "accessor %d has the count %" G_GINT64_FORMAT
                         " (−1 if it is missing), but must have 0 to %d; simplify the mesh, or "
                         "export the file again",
                         (int)k, n, SOUP_MAX_CORNERS);
    ret->n = (gsize)n;
    return find_bytes(gltf, k, accessor, ret, error);
}

static double number_at(const struct numbers *numbers, const guint8 *at) {
    const guint32 low = at[0] | (numbers->size > 1 ? (guint32)at[1] << 8 : 0);
    const gboolean share = numbers->normalized;
    guint32 bits;
    float real;
    switch (numbers->type) {
    case 5120:
        return share ? MAX((gint8)low / 127.0, -1.0) : (gint8)low;
    case 5121:
        return share ? low / 255.0 : low;
    case 5122:
        return share ? MAX((gint16)low / 32767.0, -1.0) : (gint16)low;
    case 5123:
        return share ? low / 65535.0 : low;
    case 5125:
        return word(at);
    default:
        bits = word(at);
        memcpy(&real, &bits, sizeof real);
        return (double)real;
    }
}

GArray *gltf_floats(struct gltf *gltf, gint64 accessor, int n_components, GError **error) {
    struct numbers numbers;
    if (!find_numbers(gltf, accessor, n_components, &numbers, error) || numbers.bytes == NULL)
        return NULL;
    g_autoptr(GArray) floats = g_array_new(FALSE, FALSE, sizeof(float));
    for (gsize k = 0; k < numbers.n; k++)
        for (int c = 0; c < n_components; c++) {
            const float value = (float)number_at(&numbers, numbers.bytes + k * numbers.stride +
                                                               (gsize)c * (gsize)numbers.size);
            if (!(fabsf(value) <= 1e18f)) {
                gltf_bad(gltf, error,
                         "element %zu of accessor %d is %g, but must be within ±1e18; export the "
                         "file again",
                         k, (int)accessor, (double)value);
                return NULL;
            }
            g_array_append_val(floats, value);
        }
    return g_steal_pointer(&floats);
}

GArray *gltf_indices(struct gltf *gltf, gint64 accessor, GError **error) {
    struct numbers numbers;
    if (!find_numbers(gltf, accessor, 1, &numbers, error) || numbers.bytes == NULL)
        return NULL;
    if (numbers.type != 5121 && numbers.type != 5123 && numbers.type != 5125) {
        gltf_bad(gltf, error,
                 "the indices in accessor %d have the component type %d, but must be unsigned "
                 "integers (5121, 5123 or 5125); export the file again",
                 (int)accessor, numbers.type);
        return NULL;
    }
    numbers.normalized = FALSE;
    GArray *indices = g_array_new(FALSE, FALSE, sizeof(guint32));
    for (gsize k = 0; k < numbers.n; k++) {
        const guint32 value = (guint32)number_at(&numbers, numbers.bytes + k * numbers.stride);
        g_array_append_val(indices, value);
    }
    return indices;
}
