#include "dmx_node.h"

#include <arpa/inet.h>
#include <errno.h>
#include <gio/gio.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define ARTNET_PORT 6454
#define SACN_PORT   5568
#define LOSS_US     2500000 /* E131_NETWORK_DATA_LOSS_TIMEOUT */

struct answer {
    gint64 at_us;
    struct sockaddr_in to;
    gsize n;
    guint8 bytes[240];
};

struct source { /* of a universe; sACN */
    gboolean known;
    guint8 cid[16];
    int sequence;
    gint64 heard_us;
};

struct VirtualDmx {
    struct virtual_dmx_options options;
    GThread *thread;

    GMutex mutex; /* guards the following members */
    gboolean quit;
    int fd; /* -1 while the node is unplugged */
    struct virtual_dmx_faults faults;
    struct virtual_dmx_state state;
    guint n_received, n_answers;
    gint64 heard_us;
    struct source sources[VIRTUAL_DMX_UNIVERSES];
    GQueue answers; /* of struct answer */
};

const char *virtual_dmx_address(int i) {
    /* A process id has up to 22 bits, but the address has space for only 20 of them. */
    const guint number = (guint)getpid() % (1u << 20) + (1u << 13);
    g_autofree char *address = g_strdup_printf("127.%u.%u.%u", number >> 13 & 255,
                                               number >> 5 & 255, (number & 31) << 3 | (guint)i);
    return g_intern_string(address);
}

static guint16 get16(const guint8 *bytes) {
    return (guint16)(bytes[0] << 8 | bytes[1]);
}

static void see_light(VirtualDmx *node) {
    node->state.lit = FALSE;
    for (int u = 0; u < VIRTUAL_DMX_UNIVERSES; u++)
        for (int i = 0; i < 512; i++)
            node->state.lit |= node->state.levels[u][i] > 0;
}

static void take_levels(VirtualDmx *node, int universe, const guint8 *levels, int n) {
    const gint64 now = g_get_monotonic_time();
    if (universe == 0 && node->heard_us)
        node->state.longest_us = MAX(node->state.longest_us, now - node->heard_us);
    if (universe == 0)
        node->heard_us = now;
    node->state.n_levels++;
    memcpy(node->state.levels[universe], levels, (gsize)n);
    see_light(node);
}

static void say(VirtualDmx *node, const struct sockaddr_in *to, const guint8 *bytes, gsize n) {
    struct answer *answer = g_new0(struct answer, 1);
    answer->at_us = g_get_monotonic_time() + node->faults.late_ms * (gint64)1000;
    answer->to = *to;
    answer->to.sin_port = htons(ARTNET_PORT);
    answer->n = n;
    memcpy(answer->bytes, bytes, n);
    g_queue_push_tail(&node->answers, answer);
}

/* Answers with the outputs first to first + n. */
static void reply(VirtualDmx *node, const struct sockaddr_in *to, int first, int n, int page) {
    guint8 packet[239] = "Art-Net";
    const int universe = node->options.universe + first + (node->faults.other ? 8 : 0);
    static const guint8 mac[6] = {0x02, 0x1b, 0xc5, 0x47, 0x11, 0x08};
    packet[9] = 0x21;
    inet_pton(AF_INET, node->options.address, packet + 10);
    memcpy(packet + 201, mac, sizeof mac);
    packet[14] = 0x36; /* port 0x1936, low byte first */
    packet[15] = 0x19;
    packet[18] = (guint8)(universe >> 8);
    packet[19] = universe >> 4 & 15;
    strcpy((char *)packet + 26, "virtual");
    strcpy((char *)packet + 44, "Virtual node of Mesorig");
    packet[173] = (guint8)n;
    for (int i = 0; i < n; i++) {
        packet[174 + i] = 0x80;
        packet[182 + i] = 0x80 ^ node->faults.state;
        packet[190 + i] = (universe + i) & 15;
    }
    packet[211] = (guint8)page;
    if (node->faults.garbage) {
        guint8 damaged[239];
        memcpy(damaged, packet, sizeof damaged);
        damaged[3] = '_';
        say(node, to, damaged, sizeof damaged);
        say(node, to, packet, 100);
    }
    say(node, to, packet, sizeof packet);
}

static void take_artnet(VirtualDmx *node, const guint8 *bytes, gsize n,
                        const struct sockaddr_in *from) {
    if (n < 14 || memcmp(bytes, "Art-Net", 8) != 0 || get16(bytes + 10) < 14) {
        node->state.n_damaged++;
        return;
    }
    if (bytes[8] == 0x00 && bytes[9] == 0x20) {
        node->state.n_polls++;
        if (node->options.page_each)
            for (int i = 0; i < node->options.n; i++)
                reply(node, from, i, 1, 1 + i);
        else
            reply(node, from, 0, node->options.n, 0);
    } else if (bytes[8] == 0x00 && bytes[9] == 0x50 && n >= 20) {
        const int universe = (bytes[14] | bytes[15] << 8) - node->options.universe;
        const int length = get16(bytes + 16);
        if (length < 2 || length > 512 || length % 2 || n != 18 + (gsize)length)
            node->state.n_damaged++;
        else if (universe < 0 || universe >= node->options.n)
            node->state.n_foreign++;
        else
            take_levels(node, universe, bytes + 18, length);
    } else {
        node->state.n_damaged++;
    }
}

static void lose_source(VirtualDmx *node, int universe) {
    node->sources[universe].known = FALSE;
    if (!node->options.holds_last)
        memset(node->state.levels[universe], 0, 512);
    see_light(node);
}

static void take_sacn(VirtualDmx *node, const guint8 *bytes, gsize n) {
    static const guint8 root[16] = {0, 0x10, 0, 0, 'A', 'S', 'C', '-', 'E', '1', '.', '1', '7'};
    if (n < 126 || memcmp(bytes, root, sizeof root) != 0 ||
        get16(bytes + 16) != (0x7000 | (n - 16)) || get16(bytes + 18) != 0 ||
        get16(bytes + 20) != 4 || get16(bytes + 38) != (0x7000 | (n - 38)) ||
        get16(bytes + 40) != 0 || get16(bytes + 42) != 2 ||
        get16(bytes + 115) != (0x7000 | (n - 115)) || bytes[117] != 2 || bytes[118] != 0xa1 ||
        get16(bytes + 119) != 0 || get16(bytes + 121) != 1 || get16(bytes + 123) != n - 125 ||
        bytes[125] != 0) {
        node->state.n_damaged++;
        return;
    }
    const int universe = get16(bytes + 113) - node->options.universe;
    if (universe < 0 || universe >= node->options.n) {
        node->state.n_foreign++;
        return;
    }
    struct source *source = &node->sources[universe];
    const gboolean same = source->known && memcmp(source->cid, bytes + 22, 16) == 0;
    const gint8 ahead = (gint8)(guint8)(bytes[111] - source->sequence);
    if (same && ahead <= 0 && ahead > -20) {
        node->state.n_old++;
        return;
    }
    source->known = TRUE;
    memcpy(source->cid, bytes + 22, 16);
    source->sequence = bytes[111];
    source->heard_us = g_get_monotonic_time();
    node->state.priority = bytes[108];
    if (bytes[112] & 0x40) {
        node->state.n_terminated++;
        lose_source(node, universe);
    } else {
        take_levels(node, universe, bytes + 126, (int)n - 126);
    }
}

static void receive(VirtualDmx *node) {
    guint8 bytes[1500];
    struct sockaddr_in from;
    socklen_t length = sizeof from;
    for (gssize n; node->fd >= 0 && (n = recvfrom(node->fd, bytes, sizeof bytes, MSG_DONTWAIT,
                                                  (struct sockaddr *)&from, &length)) >= 0;) {
        const guint count = ++node->n_received;
        if (node->faults.cut || (node->faults.lose > 0 && count % (guint)node->faults.lose == 0))
            continue;
        if (node->options.sacn)
            take_sacn(node, bytes, (gsize)n);
        else
            take_artnet(node, bytes, (gsize)n, &from);
    }
}

static void send_answers(VirtualDmx *node) {
    struct answer *answer;
    while ((answer = g_queue_peek_head(&node->answers)) &&
           answer->at_us <= g_get_monotonic_time()) {
        const struct virtual_dmx_faults *faults = &node->faults;
        const guint count = ++node->n_answers;
        g_queue_pop_head(&node->answers);
        if (node->fd >= 0 && !faults->cut && !faults->silent &&
            !(faults->lose_answers > 0 && count % (guint)faults->lose_answers == 0) &&
            sendto(node->fd, answer->bytes, answer->n, 0, (struct sockaddr *)&answer->to,
                   sizeof answer->to) < 0)
            g_debug("virtual DMX node: %s", g_strerror(errno));
        g_free(answer);
    }
}

static gboolean join(const VirtualDmx *node, int fd, struct in_addr own) {
    for (int i = 0; i < node->options.n; i++) {
        const struct ip_mreq group = {
            .imr_multiaddr.s_addr = htonl(0xefff0000u | (guint32)(node->options.universe + i)),
            .imr_interface = own};
        if (setsockopt(fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group) < 0)
            return FALSE;
    }
    return TRUE;
}

static gboolean open_socket(VirtualDmx *node) {
    const int yes = 1;
    struct sockaddr_in at = {.sin_family = AF_INET,
                             .sin_port = htons(node->options.sacn ? SACN_PORT : ARTNET_PORT)};
    struct in_addr own = {0};
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    inet_pton(AF_INET, node->options.address, &own);
    if (!node->options.multicast)
        at.sin_addr = own;
    if (fd < 0 || setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) < 0 ||
        bind(fd, (struct sockaddr *)&at, sizeof at) < 0 ||
        (node->options.multicast && !join(node, fd, own))) {
        const int why = errno;
        if (fd >= 0)
            close(fd);
        errno = why;
        return FALSE;
    }
    node->fd = fd;
    return TRUE;
}

static gpointer run(gpointer data) {
    VirtualDmx *node = data;
    gboolean quit = FALSE;
    while (!quit) {
        g_mutex_lock(&node->mutex);
        struct pollfd fd = {node->fd, POLLIN, 0};
        g_mutex_unlock(&node->mutex);
        poll(&fd, 1, 2);
        g_mutex_lock(&node->mutex);
        receive(node);
        for (int u = 0; u < node->options.n; u++)
            if (node->sources[u].known &&
                g_get_monotonic_time() - node->sources[u].heard_us > LOSS_US) {
                node->state.n_lost++;
                lose_source(node, u);
            }
        send_answers(node);
        quit = node->quit;
        g_mutex_unlock(&node->mutex);
    }
    return NULL;
}

VirtualDmx *virtual_dmx_new(const struct virtual_dmx_options *options, GError **error) {
    VirtualDmx *node = g_new0(VirtualDmx, 1);
    node->options = *options;
    node->fd = -1;
    g_mutex_init(&node->mutex);
    if (!open_socket(node)) {
        g_set_error(
            error, G_IO_ERROR, g_io_error_from_errno(errno),
            "virtual DMX node: cannot listen at %s: %s; end the program that uses the address",
            options->address, g_strerror(errno));
        virtual_dmx_free(node);
        return NULL;
    }
    node->thread = g_thread_new("virtual-dmx", run, node);
    return node;
}

void virtual_dmx_free(VirtualDmx *node) {
    if (!node)
        return;
    g_mutex_lock(&node->mutex);
    node->quit = TRUE;
    g_mutex_unlock(&node->mutex);
    if (node->thread)
        g_thread_join(node->thread);
    if (node->fd >= 0)
        close(node->fd);
    g_queue_clear_full(&node->answers, g_free);
    g_mutex_clear(&node->mutex);
    g_free(node);
}

void virtual_dmx_fail(VirtualDmx *node, const struct virtual_dmx_faults *faults) {
    g_mutex_lock(&node->mutex);
    receive(node); /* packets sent before the fault still arrive */
    send_answers(node);
    node->faults = *faults;
    if (faults->unplugged && node->fd >= 0) {
        close(node->fd);
        node->fd = -1;
    } else if (!faults->unplugged && node->fd < 0 && !open_socket(node)) {
        g_warning("virtual DMX node: cannot listen again: %s", g_strerror(errno));
    }
    g_mutex_unlock(&node->mutex);
}

void virtual_dmx_state(VirtualDmx *node, struct virtual_dmx_state *ret) {
    g_mutex_lock(&node->mutex);
    receive(node);
    *ret = node->state;
    g_mutex_unlock(&node->mutex);
}
