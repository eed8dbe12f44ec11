/*
 * Lamps behind an Art-Net node.
 *
 * Art-Net has no answer to levels. A node only answers an ArtPoll. The answer says that the node is
 * there, which universes it has, and what its outputs do. A command is therefore confirmed by an
 * answer to an ArtPoll that was sent after the levels.
 *
 * The answer does not name its ArtPoll, and a node may wait for a second before it answers. Each
 * answer therefore counts for the oldest ArtPoll that may still be answered, so that no old answer
 * confirms a new command. After a lost packet a command needs a further ArtPoll for each packet
 * that was lost.
 */
#include "artnet_socket.h"
#include "devices.h"
#include "dmx.h"
#include "udp.h"

#define N_POLLS         4    /* requests that may be unanswered at the same time */
#define POLL_MS         200  /* time between two requests while a command waits */
#define POLL_LIT_MS     1000 /* time between two requests while a lamp is lit */
#define ANSWERED_MS     1200 /* a node answers within 1 s, or never */
#define OPEN_ANSWER_MS  4000
#define CLOSE_ANSWER_MS 600
#define UNHEARD         G_MININT64

struct output {
    gboolean known;
    int page; /* number of the reply that names the output (struct artnet_reply) */
    guint8 state;
    gint64 polls[N_POLLS]; /* times of the requests that may still be answered, oldest first */
    int n_polls;
    gint64 alive_us; /* time of the last request that was answered */
};

struct artnet_lamps {
    struct dmx dmx;
    guint32 node;
    ArtnetSocket *socket;
    gint64 polled_us;       /* time of the last request; UNHEARD if an answer has come since */
    gint64 lit_polled_us;   /* time of the last request, answered or not */
    struct output *outputs; /* one for each universe */
    /* the node has answered, even if it does not have the wanted universes */
    gboolean answered;
};

static const struct option options[] = {
    {"address", OPTION_STRING, .offset = DMX_FIELD(address),
     .help = "IPv4 address of the node, such as 10.0.0.7"},
    DMX_OPTIONS,
    {NULL},
};

static void drop_poll(struct output *output) {
    output->n_polls--;
    for (int i = 0; i < output->n_polls; i++)
        output->polls[i] = output->polls[i + 1];
}

static void on_reply(const struct artnet_reply *reply, gpointer data) {
    struct artnet_lamps *lamps = data;
    struct dmx *dmx = &lamps->dmx;
    lamps->answered = TRUE;
    for (int i = 0; i < dmx->n_universes; i++) {
        struct output *output = &lamps->outputs[i];
        guint8 state = 0;
        gboolean named = FALSE;
        for (int k = 0; k < reply->n; k++)
            if (reply->outputs[k].universe == dmx_universe(dmx, i)) {
                state |= reply->outputs[k].state;
                named = TRUE;
            }
        if (!named || (output->known && output->page != reply->page))
            continue;
        output->known = TRUE;
        output->page = reply->page;
        output->state = state;
        if (output->n_polls > 0) {
            output->alive_us = output->polls[0];
            drop_poll(output);
        }
    }
    lamps->polled_us = UNHEARD; /* so that a command that still waits sends a request at once */
    if (dmx->timer)
        dmx_wake(dmx);
}

static gboolean send_levels(struct dmx *dmx, int i, GError **error) {
    struct artnet_lamps *lamps = (struct artnet_lamps *)dmx;
    guint8 packet[ARTNET_DMX_SIZE];
    artnet_dmx(dmx_universe(dmx, i), dmx->frames[i], packet);
    return artnet_socket_send(lamps->socket, lamps->node, packet, sizeof packet, error);
}

/* Returns whether a further request may be sent. */
static gboolean has_space(const struct artnet_lamps *lamps) {
    for (int i = 0; i < lamps->dmx.n_universes; i++)
        if (lamps->outputs[i].n_polls == N_POLLS)
            return FALSE;
    return TRUE;
}

static void send_poll(struct artnet_lamps *lamps, gint64 now) {
    guint8 packet[ARTNET_POLL_SIZE];
    lamps->polled_us = lamps->lit_polled_us = now;
    artnet_poll(packet);
    if (!artnet_socket_send(lamps->socket, lamps->node, packet, sizeof packet, NULL))
        return; /* the levels cannot be sent either, which is reported */
    for (int i = 0; i < lamps->dmx.n_universes; i++) {
        struct output *output = &lamps->outputs[i];
        output->polls[output->n_polls++] = now;
    }
}

static void look(struct dmx *dmx, gboolean urgent, gboolean lit) {
    struct artnet_lamps *lamps = (struct artnet_lamps *)dmx;
    const gint64 now = clock_now_us(dmx->bank->device.clock);
    artnet_socket_receive(lamps->socket);
    for (int i = 0; i < dmx->n_universes; i++) {
        struct output *output = &lamps->outputs[i];
        while (output->n_polls > 0 && output->polls[0] < now - ANSWERED_MS * 1000)
            drop_poll(output);
    }
    const gboolean due =
        urgent ? now - POLL_MS * 1000 >= lamps->polled_us || lamps->polled_us < dmx->sent_us
               : lit && now >= lamps->lit_polled_us + POLL_LIT_MS * 1000;
    if (due && has_space(lamps))
        send_poll(lamps, now);
}

static gint64 alive_us(const struct dmx *dmx) {
    const struct artnet_lamps *lamps = (const struct artnet_lamps *)dmx;
    gint64 least = G_MAXINT64;
    for (int i = 0; i < dmx->n_universes; i++)
        least = MIN(least, lamps->outputs[i].alive_us);
    return least;
}

static GError *fault(const struct dmx *dmx) {
    const struct artnet_lamps *lamps = (const struct artnet_lamps *)dmx;
    for (int i = 0; i < dmx->n_universes; i++) {
        const struct output *output = &lamps->outputs[i];
        const char *what =
            !output->known                         ? NULL
            : output->state & ARTNET_OUTPUT_MERGES ? "another controller also sends "
                                                     "to it" ERROR_ADVICE "end the other controller"
            : output->state & ARTNET_OUTPUT_SHORT  ? "its output has a short circuit" ERROR_ADVICE
                                                    "check its cable"
            : output->state & ARTNET_OUTPUT_SACN ? "its output listens to sACN" ERROR_ADVICE
                                                   "set it to Art-Net, or use the driver sacn-lamps"
            : !(output->state & ARTNET_OUTPUT_SENDING)
                ? "the node does not send it to the lamps" ERROR_ADVICE
                  "check the settings of the output"
                : NULL;
        if (what)
            return device_error_new(DEVICE_ERROR_PROTOCOL, dmx->bank->device.who,
                                    "universe %d of the Art-Net node %s: %s", dmx_universe(dmx, i),
                                    dmx->address, what);
    }
    return NULL;
}

static GError *silence(const struct dmx *dmx) {
    const struct artnet_lamps *lamps = (const struct artnet_lamps *)dmx;
    const char *who = dmx->bank->device.who;
    for (int i = 0; i < dmx->n_universes && lamps->answered; i++)
        if (!lamps->outputs[i].known)
            return device_error_new(DEVICE_ERROR_PROTOCOL, who,
                                    "the Art-Net node %s has no output with universe "
                                    "%d" ERROR_ADVICE "set an output of the node to net %d, "
                                    "sub-net %d, universe %d, or change universe",
                                    dmx->address, dmx_universe(dmx, i), dmx_universe(dmx, i) >> 8,
                                    dmx_universe(dmx, i) >> 4 & 15, dmx_universe(dmx, i) & 15);
    return device_error_new(DEVICE_ERROR_TIMEOUT, who,
                            "the Art-Net node %s has not answered" ERROR_ADVICE
                            "check its power, its cable and address",
                            dmx->address);
}

static char *unit(const struct dmx *dmx, int i) {
    return g_strdup_printf("universe %d of the Art-Net node %s", dmx_universe(dmx, i),
                           dmx->address);
}

static const struct dmx_protocol protocol = {
    .name = "Art-Net",
    .min_universe = 0,
    .max_universe = ARTNET_MAX_UNIVERSE,
    .unit = unit,
    .send = send_levels,
    .look = look,
    .alive_us = alive_us,
    .fault = fault,
    .silence = silence,
};

static void leave(struct artnet_lamps *lamps) {
    dmx_leave(&lamps->dmx);
    if (lamps->socket)
        artnet_socket_unlisten(lamps->socket, lamps);
    g_clear_pointer(&lamps->socket, artnet_socket_unref);
    g_clear_pointer(&lamps->outputs, g_free);
}

static gboolean connect_node(struct artnet_lamps *lamps, GError **error) {
    struct dmx *dmx = &lamps->dmx;
    guint32 local;
    dmx_address(dmx->address, &lamps->node);
    dmx_address(dmx->local_address, &local);
    if (!dmx_lock(dmx, error))
        return FALSE;
    lamps->socket = artnet_socket_get(local, error);
    if (!lamps->socket)
        return FALSE;
    artnet_socket_listen(lamps->socket, lamps->node, on_reply, lamps);
    return TRUE;
}

static gboolean open_lamps(LampBank *bank, GError **error) {
    struct artnet_lamps *lamps = bank->device.priv;
    if (!device_check_real_clock(&bank->device, error))
        return FALSE;
    dmx_init(&lamps->dmx, &protocol, bank);
    lamps->outputs = g_new0(struct output, lamps->dmx.n_universes);
    for (int i = 0; i < lamps->dmx.n_universes; i++)
        lamps->outputs[i].alive_us = UNHEARD;
    if (!connect_node(lamps, error)) {
        error_details_add_subject(error, bank->device.who);
    } else if (dmx_start(&lamps->dmx, OPEN_ANSWER_MS, error)) {
        device_set_identity(&bank->device, "Art-Net node", NULL, lamps->dmx.address);
        return TRUE;
    }
    leave(lamps);
    return FALSE;
}

static void close_lamps(LampBank *bank) {
    struct artnet_lamps *lamps = bank->device.priv;
    dmx_stop(&lamps->dmx, CLOSE_ANSWER_MS);
    leave(lamps);
}

static gboolean set_lamp(LampBank *bank, int index, gboolean on, GError **error) {
    return dmx_set(bank->device.priv, index, on, error);
}

static void check(gconstpointer given, const struct config_section *section, Mistakes *mistakes) {
    const struct dmx *dmx = given;
    guint32 address;
    dmx_check(dmx, &protocol, section, mistakes);
    if (!dmx_address(dmx->address, &address) || address == 0 || address >> 28 >= 14)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "address",
                       "“%s” is not the IPv4 address of one node, such as 10.0.0.7: Art-Net 4 "
                       "forbids broadcasts",
                       dmx->address);
}

static void needs(gconstpointer given, GPtrArray *to) {
    dmx_needs(given, &protocol, to);
}

const struct lamps_driver artnet_lamps_driver = {
    .info = {"lamps", "artnet-lamps", "Lamps on DMX512 behind an Art-Net node", options,
             sizeof(struct artnet_lamps), check, needs, "sent, and the node answers"},
    .open = open_lamps,
    .close = close_lamps,
    .set = set_lamp,
};
