#include "u3v_private.h"

#include <errno.h>
#include <string.h>

/* Header of a command and of an answer: a prefix, flags or a status, the code of the command, the
 * length of the data, and a number. */
#define PREFIX      0x43563355 /* "U3VC" */
#define HEADER_SIZE 12
#define RESPONSE_MS 200 /* longest time in ms until an answer, long enough for a busy computer */
#define ALIGNMENT   3   /* sizes of transfers are multiples of 2^ALIGNMENT bytes */
#define SUPER_SPEED 8

#define NOT_IMPLEMENTED   0x8001
#define INVALID_PARAMETER 0x8002
#define INVALID_ADDRESS   0x8003
#define WRITE_PROTECT     0x8004

enum command { READ_MEMORY = 0x0800, WRITE_MEMORY = 0x0802 };

static void add_transport(struct imager_xml *xml) {
    imager_xml_string(xml, "DeviceVendorName", ABRM_MANUFACTURER, 64);
    imager_xml_string(xml, "DeviceModelName", ABRM_MODEL, 64);
    imager_xml_string(xml, "DeviceSerialNumber", ABRM_SERIAL, 64);
    imager_xml_string(xml, "DeviceID", ABRM_SERIAL, 64);
    imager_xml_integer(xml, "TimestampLatchValue", ABRM_STAMP, 8, "RO", "");
    imager_xml_register(xml, "TimestampLatch", ABRM_STAMP_LATCH, 4, "WO");
    imager_xml_command(xml, "TimestampLatch", "TimestampLatch", 1);
}

const struct imager_transport u3v_transport = {"U3V", "LittleEndian",
                                               "TimestampLatch TimestampLatchValue", add_transport};

static void set_text(VirtualU3v *camera, guint address, const char *text) {
    g_strlcpy((char *)camera->memory + address, text, 64);
}

void u3v_reset(VirtualU3v *camera) {
    memset(camera->memory, 0, sizeof camera->memory);
    u3v_set_reg(camera, ABRM_VERSION, 0x00010000, 4);
    set_text(camera, ABRM_MANUFACTURER, "Mesorig");
    set_text(camera, ABRM_MODEL, "VirtualCamera");
    set_text(camera, ABRM_FAMILY, "Virtual");
    set_text(camera, ABRM_DEVICE_VERSION, MESORIG_VERSION);
    set_text(camera, ABRM_SERIAL, camera->imager.options.serial);
    u3v_set_reg(camera, ABRM_RESPONSE_MS, RESPONSE_MS, 4);
    u3v_set_reg(camera, ABRM_MANIFEST, MANIFEST_AT, 8);
    u3v_set_reg(camera, ABRM_SBRM, SBRM_AT, 8);
    u3v_set_reg(camera, ABRM_STAMP_INCREMENT, 1, 4); /* ns */
    u3v_set_reg(camera, SBRM_VERSION, 0x00010000, 4);
    u3v_set_reg(camera, SBRM_CAPABILITY, 1, 8); /* the camera has a stream */
    u3v_set_reg(camera, SBRM_MAX_CMD, U3V_MAX_TRANSFER, 4);
    u3v_set_reg(camera, SBRM_MAX_ACK, U3V_MAX_TRANSFER, 4);
    u3v_set_reg(camera, SBRM_N_STREAMS, 1, 4);
    u3v_set_reg(camera, SBRM_SIRM, SIRM_AT, 8);
    u3v_set_reg(camera, SBRM_SIRM_SIZE, SIRM_END - SIRM_AT, 4);
    u3v_set_reg(camera, SBRM_SPEED, SUPER_SPEED, 4);
    u3v_set_reg(camera, SIRM_INFO, ALIGNMENT << 24, 4);
    u3v_set_reg(camera, SIRM_NEEDS_LEADER, LEADER_SIZE, 4);
    u3v_set_reg(camera, SIRM_NEEDS_TRAILER, TRAILER_SIZE, 4);
    u3v_set_reg(camera, MANIFEST_AT, 1, 8);               /* one file, not compressed */
    u3v_set_reg(camera, MANIFEST_AT + 8, 0x01000000, 4);  /* version 1.0.0 */
    u3v_set_reg(camera, MANIFEST_AT + 12, 0x01010000, 4); /* schema 1.1, plain XML */
    u3v_set_reg(camera, MANIFEST_AT + 16, GENICAM_AT, 8);
    u3v_set_reg(camera, MANIFEST_AT + 24, camera->imager.xml_size, 8);
    camera->answer_size = 0;
    u3v_drop(camera);
    imager_reset(&camera->imager);
}

static guint read_memory(VirtualU3v *camera, guint64 address, guint n, guint8 *ret) {
    u3v_set_reg(camera, SIRM_NEEDS_PAYLOAD, imager_reg(&camera->imager, REG_PAYLOAD), 8);
    for (guint64 at = address; at < address + n; at++, ret++) {
        if (at >= GENICAM_AT)
            *ret = imager_xml_byte(&camera->imager, at);
        else if (imager_has_reg(at))
            *ret = (guint8)(imager_reg(&camera->imager, (guint)at & ~3u) >> 8 * (at % 4));
        else if (at < U3V_END)
            *ret = camera->memory[at];
        else
            return INVALID_ADDRESS;
    }
    return 0;
}

static guint write_register(VirtualU3v *camera, guint64 address, guint32 value) {
    if (address % 4 == 0 && imager_has_reg(address)) {
        imager_write(&camera->imager, (guint)address, value);
        return 0;
    }
    if (address == ABRM_STAMP_LATCH) {
        u3v_set_reg(camera, ABRM_STAMP, (guint64)g_get_monotonic_time() * 1000, 8);
        return 0;
    }
    if (address % 4 != 0 || address < SIRM_CONTROL || address >= SIRM_END)
        return address < U3V_END ? WRITE_PROTECT : INVALID_ADDRESS;
    u3v_set_reg(camera, (guint)address, value, 4);
    if (address == SIRM_CONTROL && !(value & 1))
        u3v_drop(camera);
    return 0;
}

/* Carries out a command. Sets ret to the data of the answer, and *ret_size to its number of bytes.
 * Returns the status of the answer. */
static guint obey(VirtualU3v *camera, enum command command, const guint8 *data, guint size,
                  guint8 *ret, guint *ret_size) {
    guint64 address = size >= 8 ? u3v_get(data, 8) : 0;
    if (command == READ_MEMORY) {
        *ret_size = size == 12 ? (guint)u3v_get(data + 10, 2) : U3V_MAX_TRANSFER;
        if (*ret_size > U3V_MAX_TRANSFER - HEADER_SIZE)
            return INVALID_PARAMETER;
        return read_memory(camera, address, *ret_size, ret);
    }
    if (command != WRITE_MEMORY)
        return NOT_IMPLEMENTED;
    if (size <= 8)
        return INVALID_PARAMETER;
    *ret_size = 4;
    u3v_put(ret, (guint64)(size - 8) << 16, 4);
    guint status = size % 4 == 0 ? 0 : INVALID_PARAMETER;
    for (guint i = 8; i + 4 <= size && status == 0; i += 4)
        status = write_register(camera, address + i - 8, (guint32)u3v_get(data + i, 4));
    return status;
}

/* Carries out a command and makes its answer. An earlier answer that was not read is lost. */
int u3v_command(VirtualU3v *camera, const guint8 *data, int n) {
    guint size = n >= HEADER_SIZE ? (guint)u3v_get(data + 8, 2) : 0, answer_size = 0;
    if (n < HEADER_SIZE || n > U3V_MAX_TRANSFER || u3v_get(data, 4) != PREFIX ||
        size + HEADER_SIZE != (guint)n)
        return n; /* the command is not understood, so it is not answered */
    guint8 *answer = camera->answer;
    enum command command = (enum command)u3v_get(data + 6, 2);
    guint status =
        obey(camera, command, data + HEADER_SIZE, size, answer + HEADER_SIZE, &answer_size);
    answer_size = status ? 0 : answer_size;
    u3v_put(answer, PREFIX, 4);
    u3v_put(answer + 4, status, 2);
    u3v_put(answer + 6, command + 1, 2);
    u3v_put(answer + 8, answer_size, 2);
    memcpy(answer + 10, data + 10, 2);
    camera->answer_size = (int)answer_size + HEADER_SIZE;
    camera->answer_us = g_get_monotonic_time() + camera->imager.faults.answer_us;
    return n;
}

int u3v_answer(VirtualU3v *camera, guint8 *data, int size) {
    int n = camera->answer_size;
    if (n == 0 || g_get_monotonic_time() < camera->answer_us)
        return -EAGAIN;
    if (n > size)
        return -EOVERFLOW;
    memcpy(data, camera->answer, (gsize)n);
    camera->answer_size = 0;
    return n;
}
