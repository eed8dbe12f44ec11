/*
 * A recording of what devices say on their buses: a text that a person can read and mail, and that
 * a virtual bus can replay (sim/virtual/replay/replay.h). docs/build-a-rig/recordings.md describes
 * its lines.
 *
 * The process has at most one recording. The classes of devices record their calls and their
 * results, and the buses record each message where they read and write it. Without a recording,
 * each of these places costs one look at an integer. Any thread may call these functions.
 */
#pragma once

#include "base/config.h"

#define RECORDING_VERSION 1

/* Begins a recording. A recording that is under way is dropped. */
void recording_begin(void);

/* Ends the recording, and returns its text. Returns NULL if there is none. g_free()
 *
 * The text contains neither the names of the computer and of its user nor a path or a network
 * address. Other text stands in their places, and in the place of everything that was given to
 * recording_hide(). */
char *recording_end(void);

extern gint recording_state; /* use recording_is_on() */
static inline gboolean recording_is_on(void) {
    return g_atomic_int_get(&recording_state) != 0;
}

/* The bus of a message. `kind` is the kind of the bus: "serial", "modbus", "udp", "http",
 * "program", "usb", "v4l2" or "genicam". `address` is the place of the bus on this computer or in
 * the network. In the text of the recording, a number stands for the address. */
struct recording_bus {
    const char *kind, *address;
};

enum recording_way { RECORDING_SENT, RECORDING_RECEIVED };

/* Records bytes of text. Bytes that were received are recorded when their line is complete. Bytes
 * that were sent are recorded as they are. */
void recording_text(struct recording_bus bus, enum recording_way way, const char *bytes, gsize n);

/* Records a message of n bytes in hexadecimal digits. */
void recording_bytes(struct recording_bus bus, enum recording_way way, const guint8 *bytes,
                     gsize n);

/* Records that something other than a message has happened, such as a missing answer. */
void recording_note(struct recording_bus bus, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* Returns whether the value of a key of a rig file names a place on this computer or in its
 * network, such as a path or an address, or is the serial number of a device. The text of a
 * recording does not have such values. */
gboolean recording_is_place(const char *key);

/* For classes. recording_section() records the section of a device. recording_device() records a
 * call of a device, or its result. `who` names the device ("axis turntable"). The text of a result
 * begins with "= ". */
void recording_section(const struct config_section *section);
void recording_device(const char *who, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* Replaces a text by another one in the whole recording. If instead is NULL, each character is
 * replaced by X. In a message in hexadecimal digits, the bytes of the text are replaced only if
 * instead is NULL or has the same length as the text. A text of less than 4 characters is kept,
 * because it could be part of anything. A text that is part of the name of a device in the rig file
 * is also kept. */
void recording_hide(const char *text, const char *instead);

/* Replaces n bytes by 0 wherever they occur in binary messages, such as the address of a network
 * interface. n is at most 64. Nothing is replaced if fewer than 3 bytes are left without the zeros
 * at both ends. */
void recording_hide_bytes(const guint8 *bytes, gsize n);
