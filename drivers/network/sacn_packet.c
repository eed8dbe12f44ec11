#include "sacn_packet.h"

#include <string.h>

/* Positions of the layers, which begin with flags and length. */
#define ROOT    16
#define FRAMING 38
#define DMP     115

#define STREAM_TERMINATED 0x40

static void put16(guint8 *at, guint value) {
    at[0] = (guint8)(value >> 8);
    at[1] = value & 0xff;
}

/* Writes flags and length of a layer, which reaches to the end of the packet. */
static void begin_layer(guint8 *packet, int at) {
    put16(packet + at, 0x7000u | (guint)(SACN_SIZE - at));
}

void sacn_data(const struct sacn_source *source, int universe, guint8 sequence, gboolean ends,
               const guint8 levels[SACN_CHANNELS], guint8 ret[SACN_SIZE]) {
    memset(ret, 0, SACN_SIZE);
    put16(ret, 0x0010);                   /* size of the preamble */
    memcpy(ret + 4, "ASC-E1.17\0\0", 12); /* filled with 0 */
    begin_layer(ret, ROOT);
    ret[ROOT + 5] = 0x04; /* VECTOR_ROOT_E131_DATA */
    memcpy(ret + 22, source->cid, sizeof source->cid);
    begin_layer(ret, FRAMING);
    ret[FRAMING + 5] = 0x02; /* VECTOR_E131_DATA_PACKET */
    memcpy(ret + 44, source->name, sizeof source->name);
    ret[108] = (guint8)source->priority;
    ret[111] = sequence;
    ret[112] = ends ? STREAM_TERMINATED : 0;
    put16(ret + 113, (guint)universe);
    begin_layer(ret, DMP);
    ret[DMP + 2] = 0x02; /* VECTOR_DMP_SET_PROPERTY */
    ret[DMP + 3] = 0xa1; /* types of address and data */
    put16(ret + 121, 1); /* address increment */
    put16(ret + 123, 1 + SACN_CHANNELS);
    memcpy(ret + 126, levels, SACN_CHANNELS); /* after the start code 0 */
}

guint32 sacn_group(int universe) {
    return 0xefff0000u | (guint32)universe;
}
