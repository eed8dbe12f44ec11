#include "gige_private.h"

#include <arpa/inet.h>
#include <string.h>
#include <sys/socket.h>

#define FIRST_ID 65530

enum content { LEADER = 1, TRAILER = 2, PAYLOAD = 3 };

static void send_packet(VirtualGige *camera, const guint8 *packet, gsize size) {
    struct sockaddr_in to = {.sin_family = AF_INET,
                             .sin_port = htons((guint16)gige_reg(camera, GVBS_STREAM_PORT))};
    memcpy(&to.sin_addr, camera->memory + GVBS_STREAM_IP, 4);
    gboolean fits = camera->imager.faults.mtu == 0 || size + 28 <= (gsize)camera->imager.faults.mtu;
    if (camera->stream < 0 || camera->imager.faults.unplugged || to.sin_port == 0 || !fits)
        return;
    sendto(camera->stream, packet, size, 0, (struct sockaddr *)&to, sizeof to);
}

/* Returns the number of bytes of a picture that a packet contains. Returns 0 if the packet size is
 * not possible. */
static gsize data_size(const VirtualGige *camera) {
    gsize packet = gige_reg(camera, GVBS_PACKET_SIZE) & 0xffff;
    return packet > GIGE_OVERHEAD && packet <= MAX_PACKET ? packet - GIGE_OVERHEAD : 0;
}

/* Returns the block id of a picture, from 1 to 65535. After 65535, the ids begin again at 1. The
 * first picture has an id close to 65535, so that tests reach this point. */
static guint gige_id(const struct imager_picture *kept) {
    return (guint)((kept->id + FIRST_ID - 1) % 65535) + 1;
}

/* Returns the number of packets of a picture, including its leader and trailer. Returns 0 if the
 * picture cannot be sent. */
static guint n_blocks(const VirtualGige *camera, const struct imager_picture *kept) {
    gsize data = data_size(camera);
    if (data == 0)
        return 0;
    return (guint)((kept->size + data - 1) / data) + 2;
}

static void send_block(VirtualGige *camera, const struct imager_picture *kept, guint block) {
    guint8 packet[MAX_PACKET], *to = packet + 8;
    guint n = n_blocks(camera, kept);
    enum content content = block == 0 ? LEADER : block == n - 1 ? TRAILER : PAYLOAD;
    gsize size;
    gige_put16(packet, 0);
    gige_put16(packet + 2, gige_id(kept));
    gige_put32(packet + 4, (guint32)content << 24 | block);
    if (content == LEADER) {
        guint64 ticks = gige_ticks(kept->stamp_us);
        const guint32 words[] = {1 /* an image */,
                                 (guint32)(ticks >> 32),
                                 (guint32)ticks,
                                 kept->format,
                                 kept->width,
                                 kept->height,
                                 kept->x,
                                 kept->y,
                                 0};
        for (gsize i = 0; i < G_N_ELEMENTS(words); i++)
            gige_put32(to + 4 * i, words[i]);
        size = sizeof words;
    } else if (content == TRAILER) {
        gige_put32(to, 1);
        gige_put32(to + 4, kept->height);
        size = 8;
    } else {
        gsize data = data_size(camera), from = (block - 1) * data;
        size = MIN(data, kept->size - from);
        memcpy(to, kept->data + from, size);
    }
    camera->imager.state.packets++;
    if ((kept->cut && block > n / 2) || g_rand_double(camera->rand) < camera->imager.faults.loss)
        camera->imager.state.lost++;
    else
        send_packet(camera, packet, size + 8);
}

void gige_send_again(VirtualGige *camera, const guint8 *request, gsize size) {
    if (size < 12 || camera->imager.faults.no_resend)
        return;
    guint id = gige_get16(request + 2);
    guint32 first = gige_get32(request + 4) & 0xffffff, last = gige_get32(request + 8) & 0xffffff;
    for (int i = 0; i < IMAGER_N_KEPT; i++) {
        const struct imager_picture *kept = &camera->imager.kept[i];
        if (!kept->data || gige_id(kept) != id || first > last || last >= n_blocks(camera, kept))
            continue;
        for (guint32 block = first; block <= last; block++, camera->imager.state.resent++)
            send_block(camera, kept, block);
    }
}

void gige_send_test_packet(VirtualGige *camera, guint32 value) {
    guint8 packet[MAX_PACKET] = {0};
    guint size = value & 0xffff;
    if (value & 1u << 31 && size > GIGE_OVERHEAD && size <= MAX_PACKET)
        send_packet(camera, packet, size - 28);
    gige_set_reg(camera, GVBS_PACKET_SIZE, value & ~(1u << 31));
}

static void send_picture(gpointer data) {
    VirtualGige *camera = data;
    const struct imager_picture *kept = &camera->imager.kept[0];
    guint n = n_blocks(camera, kept);
    guint32 delay_us = gige_reg(camera, GVBS_PACKET_DELAY) / (GIGE_TICKS_HZ / 1000000);
    for (guint block = 0; block < n && imager_reg(&camera->imager, REG_ACQUISITION) == 1; block++) {
        send_block(camera, kept, block);
        g_mutex_unlock(&camera->imager.mutex);
        if (delay_us > 0)
            g_usleep(delay_us);
        g_mutex_lock(&camera->imager.mutex);
    }
}

static void announce(const struct imager_picture *picture, gpointer data) {
    send_block(data, picture, 0);
}

const struct imager_bus gige_bus = {announce, send_picture};
