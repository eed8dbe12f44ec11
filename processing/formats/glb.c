#include "glb.h"

#include "base/bytes.h"

#include <string.h>

#define MAGIC   0x46546c67
#define VERSION 2
#define JSON    0x4e4f534a
#define BIN     0x004e4942
#define HEAD    12 /* bytes of the header of the file, and of that of a chunk */
#define CHUNK   8

static void put_chunk(GByteArray *to, guint32 kind, const guint8 *data, guint n, guint8 padding) {
    const guint n_padded = (n + 3) / 4 * 4;
    bytes_put_u32(to, n_padded);
    bytes_put_u32(to, kind);
    g_byte_array_append(to, data, n);
    for (guint k = n; k < n_padded; k++)
        g_byte_array_append(to, &padding, 1);
}

GBytes *glb_new(const char *json, const GByteArray *binary) {
    GByteArray *glb = g_byte_array_new();
    const guint n = (guint)strlen(json);
    bytes_put_u32(glb, MAGIC);
    bytes_put_u32(glb, VERSION);
    bytes_put_u32(glb, HEAD + 2 * CHUNK + (n + 3) / 4 * 4 + (binary->len + 3) / 4 * 4);
    put_chunk(glb, JSON, (const guint8 *)json, n, ' ');
    put_chunk(glb, BIN, binary->data, binary->len, 0);
    return g_byte_array_free_to_bytes(glb);
}
