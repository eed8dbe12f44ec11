#include "gige_private.h"

#include <arpa/inet.h>
#include <string.h>
#include <sys/socket.h>

#define BUFFER_SIZE   1024
#define HEARTBEAT_MS  3000
#define ACCESS_DENIED 0x8006
#define BAD_ADDRESS   0x8003
#define UNKNOWN       0x8001

enum command {
    DISCOVERY = 0x02,
    RESEND = 0x40,
    READ = 0x80,
    WRITE = 0x82,
    READ_MEMORY = 0x84,
    WRITE_MEMORY = 0x86
};

static void set_text(VirtualGige *camera, guint address, const char *text, gsize size) {
    g_strlcpy((char *)camera->memory + address, text, size);
}

static void add_transport(struct imager_xml *xml) {
    g_autofree char *sizes = g_strdup_printf("<Min>576</Min><Max>%d</Max><Inc>4</Inc>", MAX_PACKET);
    imager_xml_string(xml, "DeviceVendorName", GVBS_VENDOR, 32);
    imager_xml_string(xml, "DeviceModelName", GVBS_MODEL, 32);
    imager_xml_string(xml, "DeviceSerialNumber", GVBS_SERIAL, 16);
    imager_xml_string(xml, "DeviceID", GVBS_SERIAL, 16);
    g_string_append_printf(xml->text,
                           "<Integer Name=\"GevSCPSPacketSize\"><pValue>PacketSizeReg</pValue>%s"
                           "</Integer>\n<MaskedIntReg Name=\"PacketSizeReg\">"
                           "<Address>0x%x</Address><Length>4</Length><AccessMode>RW</AccessMode>"
                           "<pPort>Device</pPort><LSB>31</LSB><MSB>16</MSB><Sign>Unsigned</Sign>"
                           "<Endianess>BigEndian</Endianess></MaskedIntReg>\n"
                           "<MaskedIntReg Name=\"FireReg\">"
                           "<Address>0x%x</Address><Length>4</Length><AccessMode>RW</AccessMode>"
                           "<pPort>Device</pPort><Bit>0</Bit><Sign>Unsigned</Sign>"
                           "<Endianess>BigEndian</Endianess></MaskedIntReg>\n",
                           sizes, GVBS_PACKET_SIZE, GVBS_PACKET_SIZE);
    imager_xml_command(xml, "GevSCPSFireTestPacket", "Fire", 1);
    imager_xml_integer(xml, "GevSCPD", GVBS_PACKET_DELAY, 4, "RW",
                       "<Min>0</Min><Max>1000000000</Max>");
}

const struct imager_transport gige_transport = {
    "GEV", "BigEndian", "GevSCPSPacketSize GevSCPD GevSCPSFireTestPacket", add_transport};

void gige_reset(VirtualGige *camera) {
    struct in_addr ip;
    g_autofree char *url =
        g_strdup_printf("Local:camera.xml;%x;%zx", GENICAM_AT, camera->imager.xml_size);
    inet_pton(AF_INET, camera->address, &ip);
    memset(camera->memory, 0, sizeof camera->memory);
    gige_set_reg(camera, GVBS_VERSION, 0x00010002);
    gige_set_reg(camera, GVBS_MODE, 0x80000001);
    gige_set_reg(camera, GVBS_MAC_HIGH, 0x0200);
    memcpy(camera->memory + GVBS_MAC_LOW, &ip, 4);
    memcpy(camera->memory + GVBS_IP, &ip, 4);
    gige_set_reg(camera, GVBS_MASK, 0xff000000);
    set_text(camera, GVBS_VENDOR, "Mesorig", 32);
    set_text(camera, GVBS_MODEL, "VirtualCamera", 32);
    set_text(camera, GVBS_DEVICE_VERSION, MESORIG_VERSION, 32);
    set_text(camera, GVBS_SERIAL, camera->imager.options.serial, 16);
    set_text(camera, GVBS_URL_0, url, 512);
    gige_set_reg(camera, GVBS_N_INTERFACES, 1);
    gige_set_reg(camera, GVBS_N_STREAMS, 1);
    gige_set_reg(camera, GVBS_CAPABILITY, 1 << 1 | 1 << 2); /* write memory, resend */
    gige_set_reg(camera, GVBS_HEARTBEAT_MS, HEARTBEAT_MS);
    gige_set_reg(camera, GVBS_TICKS_LOW, GIGE_TICKS_HZ);
    gige_set_reg(camera, GVBS_PACKET_SIZE, 1500);
    imager_reset(&camera->imager);
    camera->has_controller = camera->stolen = FALSE;
}

static gboolean write_register(VirtualGige *camera, guint32 address, guint32 value,
                               const struct sockaddr_in *from) {
    if (address % 4 == 0 && imager_has_reg(address)) {
        imager_write(&camera->imager, address, value);
        return TRUE;
    }
    if (address % 4 != 0 || address >= GVBS_END)
        return FALSE;
    gige_set_reg(camera, address, value);
    if (address == GVBS_CONTROL) {
        camera->has_controller = (value & 3) != 0;
        camera->controller = *from;
        if (!camera->has_controller)
            imager_stop(&camera->imager);
    } else if (address == GVBS_PACKET_SIZE) {
        gige_send_test_packet(camera, value);
    } else if (address == GVBS_STAMP_CONTROL && value & 2) {
        guint64 ticks = gige_ticks(g_get_monotonic_time());
        gige_set_reg(camera, GVBS_STAMP_HIGH, (guint32)(ticks >> 32));
        gige_set_reg(camera, GVBS_STAMP_LOW, (guint32)ticks);
    }
    return TRUE;
}

static gboolean read_memory(const VirtualGige *camera, guint32 address, gsize n, guint8 *ret) {
    for (gsize i = 0; i < n; i++) {
        guint64 at = (guint64)address + i;
        if (at >= GENICAM_AT)
            ret[i] = imager_xml_byte(&camera->imager, at);
        else if (imager_has_reg(at))
            ret[i] = (guint8)(imager_reg(&camera->imager, (guint)at & ~3u) >> 8 * (3 - at % 4));
        else if (at < GVBS_END)
            ret[i] = camera->memory[at];
        else
            return FALSE;
    }
    return TRUE;
}

static gboolean is_controller(const VirtualGige *camera, const struct sockaddr_in *from) {
    return camera->has_controller && !camera->stolen &&
           camera->controller.sin_addr.s_addr == from->sin_addr.s_addr &&
           camera->controller.sin_port == from->sin_port;
}

/* Carries out a GVCP request. data is the request without its header. Sets ret to the answer
 * without its header, and *ret_size to its number of bytes. Returns the status of the answer. */
static guint answer(VirtualGige *camera, enum command command, const guint8 *data, gsize size,
                    const struct sockaddr_in *from, guint8 *ret, gsize *ret_size) {
    gboolean writes = command == WRITE || command == WRITE_MEMORY;
    gboolean takes_control =
        size >= 4 && gige_get32(data) == GVBS_CONTROL && !camera->has_controller;
    gsize n;
    *ret_size = 0;
    if (writes && !takes_control && !is_controller(camera, from))
        return ACCESS_DENIED;
    switch (command) {
    case DISCOVERY:
        *ret_size = GVBS_DISCOVERY_SIZE;
        memcpy(ret, camera->memory, GVBS_DISCOVERY_SIZE);
        return 0;
    case READ:
        for (gsize i = 0; i + 4 <= size && i + 4 <= BUFFER_SIZE - 8; i += 4, *ret_size += 4)
            if (!read_memory(camera, gige_get32(data + i), 4, ret + i))
                return BAD_ADDRESS;
        return 0;
    case WRITE: /* pairs of address and value; the answer is the number of written pairs */
        *ret_size = 4;
        gige_put32(ret, 0);
        for (guint i = 0; 8 * i + 8 <= size; gige_put32(ret, ++i))
            if (!write_register(camera, gige_get32(data + 8 * i), gige_get32(data + 8 * i + 4),
                                from))
                return BAD_ADDRESS;
        return 0;
    case READ_MEMORY:
        n = size >= 8 ? gige_get16(data + 6) : 0;
        if (n == 0 || n > 536 || !read_memory(camera, gige_get32(data), n, ret + 4))
            return BAD_ADDRESS;
        memcpy(ret, data, 4);
        *ret_size = n + 4;
        return 0;
    case WRITE_MEMORY:
        if (size < 8)
            return BAD_ADDRESS;
        gige_put32(ret, (guint32)size - 4);
        *ret_size = 4;
        for (gsize i = 4; i + 4 <= size; i += 4)
            if (!write_register(camera, gige_get32(data) + (guint32)i - 4, gige_get32(data + i),
                                from))
                return BAD_ADDRESS;
        return 0;
    default:
        return UNKNOWN;
    }
}

void gige_serve(VirtualGige *camera, int from_socket) {
    guint8 request[BUFFER_SIZE], reply[BUFFER_SIZE];
    struct sockaddr_in from = {0};
    socklen_t from_size = sizeof from;
    gsize size = 0;
    gssize n = recvfrom(from_socket, request, sizeof request, MSG_DONTWAIT,
                        (struct sockaddr *)&from, &from_size);
    if (n < 8 || request[0] != 0x42 || (gssize)gige_get16(request + 4) + 8 > n ||
        camera->imager.faults.unplugged)
        return;
    enum command command = gige_get16(request + 2);
    gsize given = gige_get16(request + 4);
    if (is_controller(camera, &from))
        camera->heard_us = g_get_monotonic_time();
    if (command == RESEND) {
        gige_send_again(camera, request + 8, given);
        return;
    }
    guint status = answer(camera, command, request + 8, given, &from, reply + 8, &size);
    if (is_controller(camera, &from))
        camera->heard_us = g_get_monotonic_time();
    gige_put16(reply, status);
    gige_put16(reply + 2, command + 1);
    gige_put16(reply + 4, (guint)(status ? 0 : size));
    memcpy(reply + 6, request + 6, 2);
    if (camera->imager.faults.answer_us > 0)
        g_usleep((gulong)camera->imager.faults.answer_us);
    sendto(camera->control, reply, 8 + (status ? 0 : size), 0, (struct sockaddr *)&from, from_size);
}

void gige_check_heartbeat(VirtualGige *camera) {
    gint64 limit_us = (gint64)gige_reg(camera, GVBS_HEARTBEAT_MS) * 1000;
    if (!camera->has_controller || camera->stolen ||
        g_get_monotonic_time() - camera->heard_us < limit_us)
        return;
    camera->has_controller = FALSE;
    gige_set_reg(camera, GVBS_CONTROL, 0);
    imager_stop(&camera->imager);
}
