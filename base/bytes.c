#include "bytes.h"

#include <string.h>

void bytes_put_u32(GByteArray *to, guint32 value) {
    value = GUINT32_TO_LE(value);
    g_byte_array_append(to, (const guint8 *)&value, sizeof value);
}

void bytes_put_float(GByteArray *to, double value) {
    const float narrow = (float)value;
    guint32 bits;
    memcpy(&bits, &narrow, sizeof bits);
    bytes_put_u32(to, bits);
}
