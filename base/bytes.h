/* These functions append 4 bytes to a byte array, with the least significant byte first. Any thread
 * may call them. */
#pragma once

#include <glib.h>

void bytes_put_u32(GByteArray *to, guint32 value);
void bytes_put_float(GByteArray *to, double value); /* as an IEEE 754 single */
