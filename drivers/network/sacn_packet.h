/* Packets of sACN, ANSI E1.31-2018 "Lightweight streaming protocol for transport of DMX512 using
 * ACN". Any thread may call the functions. */
#pragma once

#include <glib.h>

#define SACN_PORT         5568
#define SACN_MIN_UNIVERSE 1
#define SACN_MAX_UNIVERSE 63999
#define SACN_CHANNELS     512
#define SACN_SIZE         (126 + SACN_CHANNELS)
#define SACN_SOURCE_SIZE  64 /* bytes of a source name with its terminating NUL */

struct sacn_source {
    guint8 cid[16];
    char name[SACN_SOURCE_SIZE]; /* UTF-8 */
    int priority;                /* 0 to 200 */
};

/* Writes an E1.31 data packet. ends is TRUE if the source sends nothing more for the universe
 * (Stream_Terminated). */
void sacn_data(const struct sacn_source *source, int universe, guint8 sequence, gboolean ends,
               const guint8 levels[SACN_CHANNELS], guint8 ret[SACN_SIZE]);

/* Returns the multicast address of a universe, in host byte order: 239.255.HIGH.LOW. */
guint32 sacn_group(int universe);
