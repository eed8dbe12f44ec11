#include "gige_private.h"

#include <arpa/inet.h>
#include <string.h>
#include <sys/socket.h>

#define LEADER_SIZE 36

enum content { LEADER = 1, TRAILER = 2, PAYLOAD = 3 };

static void gige_send_packet(VirtualGige *camera, const guint8 *packet, gsize size) {
    struct sockaddr_in to = {.sin_family = AF_INET,
                             .sin_port = htons((guint16)gige_reg(camera, GVBS_STREAM_PORT))};
    memcpy(&to.sin_addr, camera->memory + GVBS_STREAM_IP, 4);
    gboolean fits = camera->faults.mtu == 0 || size + 28 <= (gsize)camera->faults.mtu;
    if (camera->stream < 0 || camera->faults.unplugged || to.sin_port == 0 || !fits)
        return;
    sendto(camera->stream, packet, size, 0, (struct sockaddr *)&to, sizeof to);
}

static guint gige_n_blocks(const struct gige_kept *kept) {
    gsize data = kept->packet - GIGE_OVERHEAD;
    return (guint)((kept->size + data - 1) / data) + 2;
}

static gsize make_leader(const struct gige_kept *kept, guint8 *to) {
    gige_put32(to, 1); /* an image */
    gige_put32(to + 4, (guint32)(kept->ticks >> 32));
    gige_put32(to + 8, (guint32)kept->ticks);
    gige_put32(to + 12, kept->format);
    gige_put32(to + 16, kept->width);
    gige_put32(to + 20, kept->height);
    gige_put32(to + 24, kept->x);
    gige_put32(to + 28, kept->y);
    gige_put32(to + 32, 0);
    return LEADER_SIZE;
}

static gsize make_trailer(const struct gige_kept *kept, guint8 *to) {
    gige_put32(to, 1);
    gige_put32(to + 4, kept->height);
    return 8;
}

static gsize make_payload(const struct gige_kept *kept, guint block, guint8 *to) {
    gsize data = kept->packet - GIGE_OVERHEAD, from = (block - 1) * data;
    gsize size = MIN(data, kept->size - from);
    memcpy(to, kept->data + from, size);
    return size;
}

static void gige_send_block(VirtualGige *camera, const struct gige_kept *kept, guint block) {
    guint8 packet[MAX_PACKET];
    guint n = gige_n_blocks(kept);
    enum content content = block == 0 ? LEADER : block == n - 1 ? TRAILER : PAYLOAD;
    gige_put16(packet, 0);
    gige_put16(packet + 2, kept->id);
    gige_put32(packet + 4, (guint32)content << 24 | block);
    gsize size = content == LEADER    ? make_leader(kept, packet + 8)
                 : content == TRAILER ? make_trailer(kept, packet + 8)
                                      : make_payload(kept, block, packet + 8);
    camera->state.packets++;
    if ((kept->cut && block > n / 2) || g_rand_double(camera->rand) < camera->faults.loss)
        camera->state.lost++;
    else
        gige_send_packet(camera, packet, size + 8);
}

void gige_send_leader(VirtualGige *camera, const struct gige_kept *kept) {
    gige_send_block(camera, kept, 0);
}

void gige_send_again(VirtualGige *camera, const guint8 *request, gsize size) {
    if (size < 12 || camera->faults.no_resend)
        return;
    guint id = gige_get16(request + 2);
    guint32 first = gige_get32(request + 4) & 0xffffff, last = gige_get32(request + 8) & 0xffffff;
    for (int i = 0; i < GIGE_N_KEPT; i++) {
        const struct gige_kept *kept = &camera->kept[i];
        if (!kept->data || kept->id != id || first > last || last >= gige_n_blocks(kept))
            continue;
        for (guint32 block = first; block <= last; block++, camera->state.resent++)
            gige_send_block(camera, kept, block);
    }
}

void gige_send_test_packet(VirtualGige *camera, guint32 value) {
    guint8 packet[MAX_PACKET] = {0};
    guint size = value & 0xffff;
    if (value & 1u << 31 && size > GIGE_OVERHEAD && size <= MAX_PACKET)
        gige_send_packet(camera, packet, size - 28);
    gige_set_reg(camera, GVBS_PACKET_SIZE, value & ~(1u << 31));
}

void gige_send_picture(VirtualGige *camera) {
    const struct gige_kept *kept = &camera->kept[0];
    guint n = gige_n_blocks(kept);
    guint32 delay_us = gige_reg(camera, GVBS_PACKET_DELAY) / (GIGE_TICKS_HZ / 1000000);
    camera->state.pictures++;
    for (guint block = 0; block < n && gige_reg(camera, REG_ACQUISITION) == 1; block++) {
        gige_send_block(camera, kept, block);
        g_mutex_unlock(&camera->mutex);
        if (delay_us > 0)
            g_usleep(delay_us);
        g_mutex_lock(&camera->mutex);
    }
}
