#include "artnet_packet.h"

#include <string.h>

#define OP_POLL       0x2000
#define OP_POLL_REPLY 0x2100
#define OP_DMX        0x5000
#define VERSION       14

#define MIN_REPLY 207 /* bytes of a reply of Art-Net 1, which has no BindIndex */

static const char id[8] = "Art-Net";

static void begin(guint8 *packet, guint op) {
    memcpy(packet, id, sizeof id);
    packet[8] = op & 0xff;
    packet[9] = (guint8)(op >> 8);
    packet[10] = 0;
    packet[11] = VERSION;
}

void artnet_poll(guint8 ret[ARTNET_POLL_SIZE]) {
    begin(ret, OP_POLL);
    ret[12] = 0; /* no reports without a request, no diagnostics */
    ret[13] = 0;
}

void artnet_dmx(int universe, const guint8 levels[ARTNET_CHANNELS], guint8 ret[ARTNET_DMX_SIZE]) {
    begin(ret, OP_DMX);
    ret[12] = 0; /* sequence */
    ret[13] = 0; /* physical port */
    ret[14] = universe & 0xff;
    ret[15] = (guint8)(universe >> 8);
    ret[16] = ARTNET_CHANNELS >> 8;
    ret[17] = ARTNET_CHANNELS & 0xff;
    memcpy(ret + 18, levels, ARTNET_CHANNELS);
}

static void read_name(const guint8 *bytes, int size, char *ret) {
    int n = 0;
    for (; n < size - 1 && bytes[n]; n++)
        ret[n] = (char)(g_ascii_isprint((char)bytes[n]) ? bytes[n] : '?');
    ret[n] = 0;
}

gboolean artnet_reply_read(const guint8 *bytes, gsize n, struct artnet_reply *ret) {
    if (n < MIN_REPLY || memcmp(bytes, id, sizeof id) != 0 ||
        (bytes[8] | bytes[9] << 8) != OP_POLL_REPLY)
        return FALSE;
    *ret = (struct artnet_reply){.page = n > 211 ? bytes[211] : 0};
    read_name(bytes + 44, 64, ret->name);
    if (!*ret->name)
        read_name(bytes + 26, 18, ret->name);
    const int first = (bytes[18] & 0x7f) << 8 | (bytes[19] & 0x0f) << 4;
    const int n_ports = MIN(bytes[172] << 8 | bytes[173], ARTNET_PORTS);
    for (int i = 0; i < n_ports; i++)
        if (bytes[174 + i] & 0x80) /* the port can be an output */
            ret->outputs[ret->n++] =
                (struct artnet_output){first | (bytes[190 + i] & 0x0f), bytes[182 + i]};
    return TRUE;
}
