/* The virtual USB3 Vision camera has three parts: u3v_control.c answers requests to its registers,
 * u3v_stream.c sends pictures as transfers, and u3v.c has the device on the bus. */
#pragma once

#include "imager_private.h"
#include "u3v.h"

/* Technology agnostic bootstrap registers of GenCP. All numbers are little endian. */
#define ABRM_VERSION         0x0000
#define ABRM_MANUFACTURER    0x0004
#define ABRM_MODEL           0x0044
#define ABRM_FAMILY          0x0084
#define ABRM_DEVICE_VERSION  0x00c4
#define ABRM_SERIAL          0x0144
#define ABRM_CAPABILITY      0x01c4
#define ABRM_RESPONSE_MS     0x01cc
#define ABRM_MANIFEST        0x01d0
#define ABRM_SBRM            0x01d8
#define ABRM_STAMP           0x01f0
#define ABRM_STAMP_LATCH     0x01f8
#define ABRM_STAMP_INCREMENT 0x01fc

/* Register addresses of USB3 Vision (SBRM), of its stream (SIRM) and of the GenICam file. */
#define SBRM_AT         0x0400
#define SBRM_VERSION    (SBRM_AT + 0x00)
#define SBRM_CAPABILITY (SBRM_AT + 0x04)
#define SBRM_MAX_CMD    (SBRM_AT + 0x14)
#define SBRM_MAX_ACK    (SBRM_AT + 0x18)
#define SBRM_N_STREAMS  (SBRM_AT + 0x1c)
#define SBRM_SIRM       (SBRM_AT + 0x20)
#define SBRM_SIRM_SIZE  (SBRM_AT + 0x28)
#define SBRM_SPEED      (SBRM_AT + 0x40)

#define SIRM_AT            0x0500
#define SIRM_INFO          (SIRM_AT + 0x00)
#define SIRM_CONTROL       (SIRM_AT + 0x04)
#define SIRM_NEEDS_PAYLOAD (SIRM_AT + 0x08)
#define SIRM_NEEDS_LEADER  (SIRM_AT + 0x10)
#define SIRM_NEEDS_TRAILER (SIRM_AT + 0x14)
#define SIRM_MAX_LEADER    (SIRM_AT + 0x18)
#define SIRM_PAYLOAD       (SIRM_AT + 0x1c)
#define SIRM_PAYLOAD_COUNT (SIRM_AT + 0x20)
#define SIRM_TRANSFER1     (SIRM_AT + 0x24)
#define SIRM_TRANSFER2     (SIRM_AT + 0x28)
#define SIRM_MAX_TRAILER   (SIRM_AT + 0x2c)
#define SIRM_END           (SIRM_AT + 0x30)

#define MANIFEST_AT   0x0600
#define MANIFEST_SIZE 0x48
#define U3V_END       (MANIFEST_AT + MANIFEST_SIZE)

#define U3V_MAX_TRANSFER 2048 /* bytes of a command or an answer */
#define LEADER_SIZE      52
#define TRAILER_SIZE     36

enum u3v_phase { U3V_IDLE, U3V_LEADER, U3V_PAYLOAD, U3V_TRAILER };

struct VirtualU3v {
    struct imager imager; /* imager.mutex guards `memory` and all members below it */
    VirtualUsb *usb;
    struct virtual_usb_class class;

    guint8 memory[U3V_END];
    guint8 answer[U3V_MAX_TRANSFER];
    int answer_size;  /* 0 if no answer waits */
    gint64 answer_us; /* time from which the answer can be read */
    /* Picture that is being sent. `data` is a copy of the picture's data, or NULL while there is
     * none yet. */
    struct imager_picture out;
    enum u3v_phase phase;
    gsize sent;                         /* bytes of the picture's payload that were sent */
    gboolean tailless, stunted, hollow; /* faults of this picture (imager.h) */
};

static inline void u3v_put(guint8 *to, guint64 value, int n) {
    for (int i = 0; i < n; i++)
        to[i] = (guint8)(value >> 8 * i);
}

static inline guint64 u3v_get(const guint8 *from, int n) {
    guint64 value = 0;
    for (int i = 0; i < n; i++)
        value |= (guint64)from[i] << 8 * i;
    return value;
}

static inline void u3v_set_reg(VirtualU3v *camera, guint address, guint64 value, int n) {
    u3v_put(camera->memory + address, value, n);
}

static inline guint32 u3v_reg(const VirtualU3v *camera, guint address) {
    return (guint32)u3v_get(camera->memory + address, 4);
}

/* Call all functions below with the mutex locked. */

/* u3v_control.c */
extern const struct imager_transport u3v_transport;
/* Gives all registers their initial values. Discards the answer and the picture that wait. */
void u3v_reset(VirtualU3v *camera);
/* Carries out a command of n bytes and makes its answer. An earlier answer that was not read is
 * lost. A command that is not understood is not answered. Returns n. */
int u3v_command(VirtualU3v *camera, const guint8 *data, int n);
/* Moves the waiting answer to data. Returns the length of the answer, -EAGAIN if no answer is due,
 * or -EOVERFLOW if size is too small. */
int u3v_answer(VirtualU3v *camera, guint8 *data, int size);

/* u3v_stream.c */
extern const struct imager_bus u3v_bus;
/* Fills data with the next transfer. Returns the length of the transfer, -EAGAIN if there is
 * nothing to send, or -EOVERFLOW if size is too small. */
int u3v_stream(VirtualU3v *camera, guint8 *data, int size);
void u3v_drop(VirtualU3v *camera); /* discards what has not been sent of the picture */
