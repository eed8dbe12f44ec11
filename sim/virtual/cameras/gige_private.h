/* The virtual GigE camera has three parts: gige_control.c answers requests to its registers,
 * gige_stream.c sends pictures as packets, and gige.c has the camera with its two threads. */
#pragma once

#include "gige.h"
#include "imager_private.h"

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

#define GVBS_END 0x1000

#define MAX_PACKET    9000
#define GIGE_OVERHEAD 36        /* bytes for IP, UDP and GVSP in a stream packet */
#define GIGE_TICKS_HZ 125000000 /* one tick is 8 ns */

struct VirtualGige {
    struct imager imager; /* imager.mutex guards `memory` and all members below it */
    char *address;
    int control, discovery, stream, wake[2];
    GThread *answerer;

    guint8 memory[GVBS_END];
    gboolean has_controller, stolen; /* `stolen`: another program has taken control */
    int down_ms;                     /* length of a power cut that was requested, or 0 */
    struct sockaddr_in controller;
    gint64 heard_us; /* time of the last request of the controller */
    GRand *rand;
};

/* These functions write and read numbers in network byte order. gige_ticks() converts µs to ticks
 * of the time stamp. */
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

/* Call all functions below with the mutex locked. */

/* gige_control.c */
extern const struct imager_transport gige_transport;
void gige_reset(VirtualGige *camera);             /* registers get their initial values */
void gige_serve(VirtualGige *camera, int socket); /* serves one request */
void gige_check_heartbeat(VirtualGige *camera);

/* gige_stream.c */
extern const struct imager_bus gige_bus;
void gige_send_again(VirtualGige *camera, const guint8 *request, gsize size);
void gige_send_test_packet(VirtualGige *camera, guint32 value);
