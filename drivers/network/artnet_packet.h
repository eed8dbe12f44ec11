/*
 * Packets of Art-Net 4 (Artistic Licence, "Art-Net 4 Protocol Release V1.4"): ArtPoll, ArtPollReply
 * and ArtDmx. Any thread may call the functions.
 */
#pragma once

#include <glib.h>

#define ARTNET_PORT         6454
#define ARTNET_MAX_UNIVERSE 32767 /* a port address: net (7 bits), sub-net (4), universe (4) */
#define ARTNET_CHANNELS     512

#define ARTNET_POLL_SIZE 14
#define ARTNET_DMX_SIZE  (18 + ARTNET_CHANNELS)

/* Writes an ArtPoll. It requests one report of each node that receives it. A node sends further
 * reports only for further ArtPolls. */
void artnet_poll(guint8 ret[ARTNET_POLL_SIZE]);

/* Writes an ArtDmx: the levels of all channels of a universe. The sequence number is 0, so the node
 * does not check it. With other numbers, a node would drop the packets of a restarted program as
 * old, even an "off", because a restarted program begins to count again. */
void artnet_dmx(int universe, const guint8 levels[ARTNET_CHANNELS], guint8 ret[ARTNET_DMX_SIZE]);

#define ARTNET_PORTS 4

/* Offsets, in bytes, of the addresses of a node in its reply. */
#define ARTNET_REPLY_IP  10
#define ARTNET_REPLY_MAC 201

struct artnet_output {
    int universe;
    guint8 state; /* GoodOutputA */
};

/* Bits of GoodOutputA. */
#define ARTNET_OUTPUT_SACN    0x01 /* the output gets its data by sACN */
#define ARTNET_OUTPUT_SHORT   0x04
#define ARTNET_OUTPUT_MERGES  0x08 /* another controller sends to the same universe */
#define ARTNET_OUTPUT_SENDING 0x80

struct artnet_reply {
    char name[65]; /* long name of the node, or its short name; printable ASCII */
    int page;      /* BindIndex: a node with many outputs sends several replies */
    int n;
    struct artnet_output outputs[ARTNET_PORTS];
};

/* Reads an ArtPollReply. Returns FALSE if the bytes are not an ArtPollReply. */
gboolean artnet_reply_read(const guint8 *bytes, gsize n, struct artnet_reply *ret);
