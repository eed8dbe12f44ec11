/*
 * Lamps behind receivers of sACN (ANSI E1.31).
 *
 * A receiver of sACN answers nothing. A command is confirmed when its levels were sent DMX_SENDS
 * times, and the network has not reported that the receiver is not there. Such reports (ICMP, or a
 * missing answer to ARP) come only if the receiver has an address of its own in the section.
 *
 * A source that was killed leaves its last levels behind until the receivers notice the loss of
 * data, after 2.5 s. The guardian sends "off" at once as the same source (CID). Receivers drop a
 * packet whose sequence number is up to 19 below that of the last packet, and the last number of
 * the dead source is not known. The first numbers of a stream are therefore far apart: at most the
 * first packet can be dropped.
 */
#include "devices.h"
#include "dmx.h"
#include "drivers/recording.h"
#include "sacn_packet.h"
#include "udp.h"

#include <arpa/inet.h>
#include <errno.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define LOSS_S         2.5 /* E131_NETWORK_DATA_LOSS_TIMEOUT */
#define FIRST_STEP     64  /* difference between the first sequence numbers of a stream */
#define OPEN_WAIT_MS   1000
#define CLOSE_WAIT_MS  300
#define N_TERMINATIONS 3 /* E1.31 demands three packets */

struct sacn_lamps {
    struct dmx dmx;
    int priority;
    guint32 receiver; /* 0: multicast */
    int fd;           /* -1 if it is not open */
    struct sacn_source source;
    guint8 *sequences; /* next sequence number of each universe */
    int *n_sent;       /* number of packets sent for each universe, up to DMX_SENDS */
    int refused;       /* errno that the network has reported since the last levels were sent */
};

static const struct option options[] = {
    {"address", OPTION_STRING, .fallback = "", .offset = DMX_FIELD(address),
     .help = "IPv4 address of the receiver, such as 10.0.0.7. Without it, the levels are sent to "
             "the multicast groups of their universes. A receiver that is not there is then not "
             "noticed"},
    DMX_OPTIONS,
    {"priority", OPTION_INT, NULL, 1, 200, "100", NULL,
     G_STRUCT_OFFSET(struct sacn_lamps, priority),
     "Receivers obey the source with the highest priority"},
    {NULL},
};

static const char *receiver_name(const struct dmx *dmx) {
    return *dmx->address ? dmx->address : "multicast";
}

static GError *refusal(const struct dmx *dmx, int why) {
    if (why == ECONNREFUSED)
        return device_error_new(DEVICE_ERROR_DISCONNECTED, dmx->bank->device.who,
                                "the device at %s does not receive sACN: its UDP port %d is "
                                "closed" ERROR_ADVICE "check address, and set the device to sACN",
                                receiver_name(dmx), SACN_PORT);
    return device_error_new(DEVICE_ERROR_DISCONNECTED, dmx->bank->device.who,
                            "cannot send sACN to %s: %s" ERROR_ADVICE
                            "check power and cable of the receiver, and the network of this "
                            "computer",
                            receiver_name(dmx), g_strerror(why));
}

/* Sends a packet. If the network has reported a failure of an earlier packet, the first attempt
 * only returns that report, so the packet is sent again. Returns 0, or the errno of that second
 * attempt. */
static int send_packet(struct sacn_lamps *lamps, int i, gboolean ends) {
    struct dmx *dmx = &lamps->dmx;
    guint8 packet[SACN_SIZE];
    const int universe = dmx_universe(dmx, i);
    const guint32 to = lamps->receiver ? lamps->receiver : sacn_group(universe);
    sacn_data(&lamps->source, universe, lamps->sequences[i], ends, dmx->frames[i], packet);
    lamps->sequences[i] += lamps->n_sent[i] < DMX_SENDS ? FIRST_STEP : 1;
    lamps->n_sent[i] = MIN(lamps->n_sent[i] + 1, DMX_SENDS);
    const int why = udp_send(lamps->fd, to, SACN_PORT, packet, sizeof packet);
    return why ? udp_send(lamps->fd, to, SACN_PORT, packet, sizeof packet) : 0;
}

static gboolean send_levels(struct dmx *dmx, int i, GError **error) {
    struct sacn_lamps *lamps = (struct sacn_lamps *)dmx;
    if (i == 0)
        lamps->refused = 0;
    const int why = send_packet(lamps, i, FALSE);
    if (why)
        g_propagate_error(error, refusal(dmx, why));
    return why == 0;
}

static void look(struct dmx *dmx, gboolean urgent, gboolean lit) {
    struct sacn_lamps *lamps = (struct sacn_lamps *)dmx;
    int why = 0;
    socklen_t length = sizeof why;
    if (getsockopt(lamps->fd, SOL_SOCKET, SO_ERROR, &why, &length) == 0 && why)
        lamps->refused = why;
}

static gint64 alive_us(const struct dmx *dmx) {
    return clock_now_us(dmx->bank->device.clock);
}

static GError *fault(const struct dmx *dmx) {
    const struct sacn_lamps *lamps = (const struct sacn_lamps *)dmx;
    return lamps->refused ? refusal(dmx, lamps->refused) : NULL;
}

static GError *silence(const struct dmx *dmx) {
    return device_error_new(DEVICE_ERROR_TIMEOUT, dmx->bank->device.who,
                            "the levels could not be sent to %s in time" ERROR_ADVICE
                            "check what else keeps this computer busy",
                            receiver_name(dmx));
}

static char *unit(const struct dmx *dmx, int i) {
    return g_strdup_printf("universe %d of sACN to %s", dmx_universe(dmx, i), receiver_name(dmx));
}

static const struct dmx_protocol protocol = {
    .name = "sACN",
    .min_universe = SACN_MIN_UNIVERSE,
    .max_universe = SACN_MAX_UNIVERSE,
    .unit = unit,
    .send = send_levels,
    .look = look,
    .alive_us = alive_us,
    .fault = fault,
    .silence = silence,
};

/* Sets the name and the CID of the source. The CID is a UUID of version 5 that is made from the
 * machine ID of this computer. It is therefore the same for all programs, and after a restart. */
static void name_source(struct sacn_lamps *lamps) {
    struct sacn_source *source = &lamps->source;
    g_autofree char *machine = NULL;
    g_autoptr(GChecksum) sum = g_checksum_new(G_CHECKSUM_SHA1);
    guint8 digest[20];
    gsize n = sizeof digest;
    g_file_get_contents("/etc/machine-id", &machine, NULL, NULL);
    g_checksum_update(sum, (const guchar *)"mesorig sACN ", -1);
    g_checksum_update(sum, (const guchar *)(machine ? machine : g_get_host_name()), -1);
    g_checksum_get_digest(sum, digest, &n);
    memcpy(source->cid, digest, sizeof source->cid);
    source->cid[6] = (guint8)((source->cid[6] & 0x0f) | 0x50);
    source->cid[8] = (guint8)((source->cid[8] & 0x3f) | 0x80);
    recording_hide_bytes(source->cid, sizeof source->cid);
    g_snprintf(source->name, sizeof source->name, "Mesorig, %s", lamps->dmx.bank->device.who);
    source->priority = lamps->priority;
}

static void leave(struct sacn_lamps *lamps) {
    dmx_leave(&lamps->dmx);
    if (lamps->fd >= 0)
        close(lamps->fd);
    lamps->fd = -1;
    g_clear_pointer(&lamps->sequences, g_free);
    g_clear_pointer(&lamps->n_sent, g_free);
}

static gboolean connect_receiver(struct sacn_lamps *lamps, GError **error) {
    struct dmx *dmx = &lamps->dmx;
    guint32 local;
    dmx_address(dmx->address, &lamps->receiver);
    dmx_address(dmx->local_address, &local);
    if (!dmx_lock(dmx, error))
        return FALSE;
    lamps->fd = udp_open(local, 0, error);
    if (lamps->fd < 0)
        return FALSE;
    const struct sockaddr_in to = {.sin_family = AF_INET,
                                   .sin_port = htons(SACN_PORT),
                                   .sin_addr.s_addr = htonl(lamps->receiver)};
    const struct in_addr interface = {.s_addr = htonl(local)};
    /* Only a connected socket gets the reports of the network. */
    const int failed =
        lamps->receiver ? connect(lamps->fd, (const struct sockaddr *)&to, sizeof to)
        : local ? setsockopt(lamps->fd, IPPROTO_IP, IP_MULTICAST_IF, &interface, sizeof interface)
                : 0;
    if (failed)
        g_propagate_error(error, refusal(dmx, errno));
    return !failed;
}

static gboolean open_lamps(LampBank *bank, GError **error) {
    struct sacn_lamps *lamps = bank->device.priv;
    lamps->fd = -1;
    if (!device_check_real_clock(&bank->device, error))
        return FALSE;
    dmx_init(&lamps->dmx, &protocol, bank);
    lamps->sequences = g_new0(guint8, lamps->dmx.n_universes);
    lamps->n_sent = g_new0(int, lamps->dmx.n_universes);
    name_source(lamps);
    if (!connect_receiver(lamps, error)) {
        if (error && *error && !error_details_subject(*error))
            error_details_add_subject(error, bank->device.who);
    } else if (dmx_start(&lamps->dmx, OPEN_WAIT_MS, error)) {
        bank->watchdog_s = LOSS_S;
        device_set_identity(&bank->device, "sACN receiver", NULL, receiver_name(&lamps->dmx));
        return TRUE;
    }
    leave(lamps);
    return FALSE;
}

static void close_lamps(LampBank *bank) {
    struct sacn_lamps *lamps = bank->device.priv;
    dmx_stop(&lamps->dmx, CLOSE_WAIT_MS);
    for (int k = 0; k < N_TERMINATIONS; k++)
        for (int i = 0; i < lamps->dmx.n_universes; i++)
            send_packet(lamps, i, TRUE);
    leave(lamps);
}

static gboolean set_lamp(LampBank *bank, int index, gboolean on, GError **error) {
    return dmx_set(bank->device.priv, index, on, error);
}

static void check(gconstpointer given, const struct config_section *section, Mistakes *mistakes) {
    const struct dmx *dmx = given;
    guint32 address;
    dmx_check(dmx, &protocol, section, mistakes);
    if (!dmx_address(dmx->address, &address) || (*dmx->address && address == 0) ||
        address >> 28 >= 14)
        config_mistake(
            mistakes, CONFIG_ERROR_VALUE, section, "address",
            "“%s” is not the IPv4 address of a receiver, such as 10.0.0.7; for multicast "
            "leave the key out",
            dmx->address);
}

static void needs(gconstpointer given, GPtrArray *to) {
    dmx_needs(given, &protocol, to);
}

const struct lamps_driver sacn_lamps_driver = {
    .info = {"lamps", "sacn-lamps", "Lamps on DMX512 behind receivers of sACN (E1.31)", options,
             sizeof(struct sacn_lamps), check, needs, "sent, but nothing answers"},
    .open = open_lamps,
    .close = close_lamps,
    .set = set_lamp,
};
