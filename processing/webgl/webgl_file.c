#include "webgl_file.h"

#include "base/json.h"

#include <gio/gio.h>
#include <string.h>

#define MAGIC "mesoweb2"
#define LEVEL 6
#define BLOCK 65536

struct WebglFile {
    GVariantBuilder *sections;
    GByteArray *data;
};

WebglFile *webgl_file_new(void) {
    WebglFile *file = g_new(WebglFile, 1);
    file->sections = g_variant_builder_new(G_VARIANT_TYPE("aa{sv}"));
    file->data = g_byte_array_new();
    return file;
}

void webgl_file_free(WebglFile *file) {
    if (!file)
        return;
    g_variant_builder_unref(file->sections);
    g_byte_array_unref(file->data);
    g_free(file);
}

/* Appends data to the array as a zlib stream. */
static gboolean webgl_file_deflate(GByteArray *to, const guint8 *data, gsize size, GError **error) {
    g_autoptr(GZlibCompressor) compressor =
        g_zlib_compressor_new(G_ZLIB_COMPRESSOR_FORMAT_ZLIB, LEVEL);
    guint8 out[BLOCK];
    for (GConverterResult result = G_CONVERTER_CONVERTED; result != G_CONVERTER_FINISHED;) {
        gsize took = 0, gave = 0;
        result = g_converter_convert(G_CONVERTER(compressor), data, size, out, sizeof out,
                                     G_CONVERTER_INPUT_AT_END, &took, &gave, error);
        if (result == G_CONVERTER_ERROR)
            return FALSE;
        g_byte_array_append(to, out, (guint)gave);
        data += took;
        size -= took;
    }
    return TRUE;
}

gboolean webgl_file_add(WebglFile *file, const char *name, gconstpointer data, gsize size,
                        GError **error) {
    static const guint8 none;
    const gsize before = file->data->len;
    if (!webgl_file_deflate(file->data, size > 0 ? data : &none, size, error))
        return FALSE;
    g_variant_builder_open(file->sections, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(file->sections, "{sv}", "name", g_variant_new_string(name));
    g_variant_builder_add(file->sections, "{sv}", "bytes",
                          g_variant_new_int64((gint64)(file->data->len - before)));
    g_variant_builder_add(file->sections, "{sv}", "size", g_variant_new_int64((gint64)size));
    g_variant_builder_close(file->sections);
    return TRUE;
}

GBytes *webgl_file_bytes(const WebglFile *file, GVariant *info) {
    g_autoptr(GVariant) taken = g_variant_ref_sink(info);
    g_auto(GVariantDict) whole = G_VARIANT_DICT_INIT(taken);
    g_variant_dict_insert_value(&whole, "sections", g_variant_builder_end(file->sections));
    g_autofree char *header = json_text(g_variant_dict_end(&whole));
    const guint32 length = GUINT32_TO_LE((guint32)strlen(header));
    GByteArray *all = g_byte_array_new();
    g_byte_array_append(all, (const guint8 *)MAGIC, strlen(MAGIC));
    g_byte_array_append(all, (const guint8 *)&length, sizeof length);
    g_byte_array_append(all, (const guint8 *)header, (guint)strlen(header));
    g_byte_array_append(all, file->data->data, file->data->len);
    return g_byte_array_free_to_bytes(all);
}
