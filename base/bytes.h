/* Numbers at the end of a file in memory, with the least significant byte first. Any thread may
 * call the functions. */
#pragma once

#include <glib.h>

void bytes_put_u32(GByteArray *to, guint32 value);
void bytes_put_float(GByteArray *to, double value); /* in single precision */
