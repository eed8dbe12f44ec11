/* The inside of the virtual GigE camera: registers and what is asked of them (gige_control.c), the
 * GenICam file that describes them (gige_genicam.c), pictures as bytes (gige_pixels.c) and as
 * packets (gige_stream.c), and the camera with its two threads (gige.c). */
#pragma once

#include "gige.h"

#include <netinet/in.h>

/* Bootstrap registers of GigE Vision. */
#define GVBS_VERSION        0x0000
#define GVBS_MODE           0x0004
#define GVBS_MAC_HIGH       0x0008
#define GVBS_MAC_LOW        0x000c
#define GVBS_IP             0x0024
#define GVBS_MASK           0x0034
#define GVBS_VENDOR         0x0048
#define GVBS_MODEL          0x0068
#define GVBS_DEVICE_VERSION 0x0088
#define GVBS_SERIAL         0x00d8
#define GVBS_DISCOVERY_SIZE 0x00f8
#define GVBS_URL_0          0x0200
#define GVBS_N_INTERFACES   0x0600
#define GVBS_N_STREAMS      0x0904
#define GVBS_CAPABILITY     0x0934
#define GVBS_HEARTBEAT_MS   0x0938
#define GVBS_TICKS_LOW      0x0940
#define GVBS_STAMP_CONTROL  0x0944
#define GVBS_STAMP_HIGH     0x0948
#define GVBS_STAMP_LOW      0x094c
#define GVBS_CONTROL        0x0a00
#define GVBS_STREAM_PORT    0x0d00
#define GVBS_PACKET_SIZE    0x0d04
#define GVBS_PACKET_DELAY   0x0d08
#define GVBS_STREAM_IP      0x0d18
#define GVBS_STREAM_SOURCE  0x0d1c

/* The camera's own. */
#define REG_WIDTH         0x1100
#define REG_HEIGHT        0x1104
#define REG_OFFSET_X      0x1108
#define REG_OFFSET_Y      0x110c
#define REG_FORMAT        0x1110
#define REG_ACQUISITION   0x1114
#define REG_EXPOSURE_US   0x1118
#define REG_GAIN          0x111c /* 1/100 dB */
#define REG_BLACK         0x1120 /* 1/10 DN */
#define REG_TRIGGER_MODE  0x1124
#define REG_TRIGGER_FROM  0x1128 /* 0 Line0, 1 Software */
#define REG_TRIGGER       0x112c
#define REG_SENSOR_WIDTH  0x1130
#define REG_SENSOR_HEIGHT 0x1134
#define REG_PAYLOAD       0x1138
#define REG_AUTO_EXPOSURE 0x113c
#define REG_END           0x1140

#define GENICAM_AT 0x10000

#define MIN_EXPOSURE_US 10
#define MAX_EXPOSURE_US 60000000
#define MAX_PACKET      9000
#define MAX_GAIN        2400

/* The GenICam file, with formats for this colour filter array; g_free(). */
char *virtual_gige_genicam(enum cfa cfa);

/* EnumEntry elements. */
void virtual_gige_append_formats(GString *xml, enum cfa cfa);
guint32 virtual_gige_first_format(enum cfa cfa); /* of 8 bits */

/* Bytes of a picture; 0: no such format, or not of this colour filter array. */
gsize virtual_gige_payload(guint32 format, enum cfa cfa, int width, int height);

/* n values of bits as the format (of a known payload) has them on the wire. */
void virtual_gige_pack(guint32 format, enum cfa cfa, const guint16 *pixels, gsize n, int bits,
                       guint8 *to);

#define GIGE_OVERHEAD 36        /* of a stream packet: IP, UDP and GVSP */
#define GIGE_TICKS_HZ 125000000 /* 8 ns */
#define GIGE_N_KEPT   2

struct gige_kept { /* a picture as it was sent */
    guint16 id;
    guint64 ticks;
    guint32 format, width, height, x, y, packet;
    guint8 *data;
    gsize size;
    gboolean cut;
};

struct VirtualGige {
    struct virtual_gige_options options;
    char *address, *xml;
    gsize xml_size;
    int control, discovery, stream, wake[2];
    GThread *answerer, *imager;

    GMutex mutex; /* guards what follows */
    GCond cond;
    guint8 memory[REG_END];
    struct virtual_gige_faults faults;
    struct virtual_gige_state state;
    gboolean quit, has_controller, stolen, triggered, exposing;
    int down_ms;
    struct sockaddr_in controller;
    gint64 heard_us;
    guint16 last_id;
    struct gige_kept kept[GIGE_N_KEPT]; /* the latest first */
    GRand *rand;
};

/* Network order. */
static inline void gige_put16(guint8 *to, guint value) {
    to[0] = (guint8)(value >> 8);
    to[1] = (guint8)value;
}

static inline void gige_put32(guint8 *to, guint32 value) {
    gige_put16(to, value >> 16);
    gige_put16(to + 2, value & 0xffff);
}

static inline guint gige_get16(const guint8 *from) {
    return (guint)from[0] << 8 | from[1];
}

static inline guint32 gige_get32(const guint8 *from) {
    return (guint32)gige_get16(from) << 16 | gige_get16(from + 2);
}

static inline guint32 gige_reg(const VirtualGige *camera, guint address) {
    return gige_get32(camera->memory + address);
}

static inline void gige_set_reg(VirtualGige *camera, guint address, guint32 value) {
    gige_put32(camera->memory + address, value);
}

static inline guint64 gige_ticks(gint64 at_us) {
    return (guint64)at_us * (GIGE_TICKS_HZ / 1000000);
}

/* All with the mutex locked. */

/* gige_control.c */
void gige_reset(VirtualGige *camera);             /* registers as they were delivered */
void gige_serve(VirtualGige *camera, int socket); /* one request */
void gige_check_heartbeat(VirtualGige *camera);
void gige_trigger(VirtualGige *camera, guint source); /* as REG_TRIGGER_FROM counts them */
void gige_stop(VirtualGige *camera);

/* gige_stream.c */
void gige_send_picture(VirtualGige *camera); /* the last one kept; unlocks it between packets */
void gige_send_leader(VirtualGige *camera, const struct gige_kept *kept);
void gige_send_again(VirtualGige *camera, const guint8 *request, gsize size);
void gige_send_test_packet(VirtualGige *camera, guint32 value);
