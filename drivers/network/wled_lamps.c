/*
 * Lamps on a WLED controller.
 *
 * Levels go by UDP (DNRGB), with a time after which WLED returns to its own state, which is "off".
 * The levels of single LEDs cannot be read back. While a lamp is lit, a command is confirmed when
 * WLED says by HTTP, after the levels were sent, that it shows what this computer sends. When no
 * lamp is lit, WLED is told by HTTP to end the reception of UDP and to be off, and its answer says
 * that it is off.
 */
#include "devices.h"
#include "dmx.h"
#include "drivers/recording.h"
#include "udp.h"
#include "wled_http.h"

#include <arpa/inet.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define WLED_PORT       21324
#define DNRGB           4
#define DARK_S          3 /* time without levels after which WLED returns to its own state */
#define LEDS_IN_FRAME   170
#define LIT_MS          1000 /* time between two requests while a lamp is lit */
#define AGAIN_MS        100  /* time before a request is repeated */
#define OPEN_ANSWER_MS  4000
#define CLOSE_ANSWER_MS 1000

struct wled_lamps {
    struct dmx dmx;
    int first_led, leds, http_port;
    guint32 node, own;
    int fd; /* -1 if it is not open */
    WledHttp *http;
    gint64 asked_us, alive_us;
    GError *why; /* why the last answer confirms nothing */
    int n_leds;
    char version[32];
};

static const struct option options[] = {
    {"address", OPTION_STRING, .offset = DMX_FIELD(address),
     .help = "IPv4 address of the controller, such as 10.0.0.7"},
    {"http_port", OPTION_INT, NULL, 1, 65535, "80", NULL,
     G_STRUCT_OFFSET(struct wled_lamps, http_port), "Port of the controller for HTTP"},
    {"n", OPTION_INT, NULL, 1, DMX_MAX_LAMPS, NULL, NULL, DMX_FIELD(n), "Number of lamps"},
    {"first_led", OPTION_INT, NULL, 0, 65535, "0", NULL,
     G_STRUCT_OFFSET(struct wled_lamps, first_led), "First LED of lamp 0"},
    {"leds", OPTION_INT, NULL, 1, LEDS_IN_FRAME, "1", NULL,
     G_STRUCT_OFFSET(struct wled_lamps, leds), "Number of LEDs of each lamp, one after another"},
    {"levels", OPTION_DOUBLES, NULL, 1, 255, "255", NULL, DMX_FIELD(levels),
     "Red, green and blue of the lamps that are on: one number for all lamps, or one for each "
     "lamp"},
    {"local_address", OPTION_STRING, .fallback = "", .offset = DMX_FIELD(local_address),
     .help = "Address of this computer in the network of the lamps. Needed if the computer has "
             "several networks"},
    {"warm_up_s", OPTION_DOUBLE, "s", 0, 36000, "0", NULL, DMX_FIELD(warm_up_s),
     "Time from switching on until the output is stable"},
    {NULL},
};

static gboolean send_levels(struct dmx *dmx, int i, GError **error) {
    struct wled_lamps *lamps = (struct wled_lamps *)dmx;
    const int n = LEDS_IN_FRAME / lamps->leds * lamps->leds; /* LEDs of a frame */
    const int first = lamps->first_led + i * n;
    const int last = MIN(first + n, lamps->first_led + dmx->n * lamps->leds);
    guint8 packet[4 + DMX_CHANNELS] = {DNRGB, DARK_S, (guint8)(first >> 8), first & 0xff};
    if (dmx->n_burst == 0 && dmx_is_dark(dmx))
        return TRUE; /* WLED is off by itself */
    const gsize n_bytes = 3 * (gsize)(last - first);
    memcpy(packet + 4, dmx->frames[i], n_bytes);
    const gsize size = 4 + n_bytes;
    int why = udp_send(lamps->fd, lamps->node, WLED_PORT, packet, size);
    /* the kernel has reported the failure of an earlier packet instead of sending this one */
    if (why)
        why = udp_send(lamps->fd, lamps->node, WLED_PORT, packet, size);
    return why == 0 ||
           device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                            "cannot send to WLED at %s: %s" ERROR_ADVICE
                            "check its power, its address and the network of this computer",
                            dmx->address, g_strerror(why));
}

static void note(struct wled_lamps *lamps, GError *why) {
    g_clear_error(&lamps->why);
    lamps->why = why;
}

/* Takes an answer. Sends the levels again if WLED does not show them. */
static void take(struct wled_lamps *lamps, struct wled_answer *answer) {
    struct dmx *dmx = &lamps->dmx;
    const gboolean dark = dmx_is_dark(dmx);
    const char *who = dmx->bank->device.who;
    g_autofree char *from = udp_name(answer->from);
    if (answer->error) {
        error_details_add_subject(&answer->error, who);
        note(lamps, g_steal_pointer(&answer->error));
        return;
    }
    lamps->n_leds = answer->n_leds;
    g_strlcpy(lamps->version, answer->version, sizeof lamps->version);
    if (answer->on)
        note(lamps, device_error_new(DEVICE_ERROR_PROTOCOL, who,
                                     "WLED at %s is on by itself" ERROR_ADVICE
                                     "check what else switches it: its buttons, presets and "
                                     "timers, or an app",
                                     dmx->address));
    else if (dark && (!answer->off || answer->live))
        note(lamps, device_error_new(DEVICE_ERROR_PROTOCOL, who,
                                     "WLED at %s still shows what it gets from %s" ERROR_ADVICE
                                     "end the other program that sends to it",
                                     dmx->address, from));
    else if (!dark && (answer->off || !answer->live || answer->from != lamps->own))
        note(lamps, device_error_new(DEVICE_ERROR_PROTOCOL, who,
                                     "WLED at %s does not show what this computer sends, but "
                                     "%s" ERROR_ADVICE "let WLED receive UDP realtime in its sync "
                                     "settings, and end other programs that send to it",
                                     dmx->address, answer->live ? from : "its own state"));
    else
        lamps->alive_us = answer->asked_us;
    if (!dark && lamps->alive_us != answer->asked_us)
        dmx->n_burst = MAX(dmx->n_burst, 1);
}

static void look(struct dmx *dmx, gboolean urgent, gboolean lit) {
    struct wled_lamps *lamps = (struct wled_lamps *)dmx;
    const gint64 now = clock_now_us(dmx->bank->device.clock);
    struct wled_answer *answer = wled_http_take(lamps->http);
    if (answer) {
        take(lamps, answer);
        wled_answer_free(answer);
    }
    const gint64 since_us = now - lamps->asked_us;
    const gboolean due = urgent ? since_us >= AGAIN_MS * 1000 || lamps->asked_us < dmx->sent_us
                                : lit && since_us >= LIT_MS * 1000;
    if (due && !wled_http_is_busy(lamps->http)) {
        lamps->asked_us = now;
        wled_http_ask(lamps->http, dmx_is_dark(dmx), now);
    }
}

static gint64 alive_us(const struct dmx *dmx) {
    return ((const struct wled_lamps *)dmx)->alive_us;
}

static GError *fault(const struct dmx *dmx) {
    return NULL;
}

static GError *silence(const struct dmx *dmx) {
    const struct wled_lamps *lamps = (const struct wled_lamps *)dmx;
    return lamps->why ? g_error_copy(lamps->why)
                      : device_error_new(DEVICE_ERROR_TIMEOUT, dmx->bank->device.who,
                                         "WLED at %s has not answered" ERROR_ADVICE
                                         "check its power, its network and address",
                                         dmx->address);
}

/* All universes are LEDs of one controller. */
static char *unit(const struct dmx *dmx, int i) {
    return i == 0 ? g_strdup_printf("WLED at %s", dmx->address) : NULL;
}

static const struct dmx_protocol protocol = {
    .name = "WLED",
    .max_universe = G_MAXINT,
    .unit = unit,
    .send = send_levels,
    .look = look,
    .alive_us = alive_us,
    .fault = fault,
    .silence = silence,
};

static void leave(struct wled_lamps *lamps) {
    dmx_leave(&lamps->dmx);
    g_clear_pointer(&lamps->http, wled_http_free);
    g_clear_error(&lamps->why);
    if (lamps->fd >= 0)
        close(lamps->fd);
    lamps->fd = -1;
}

static gboolean connect_node(struct wled_lamps *lamps, GError **error) {
    struct dmx *dmx = &lamps->dmx;
    struct sockaddr_in own = {0};
    socklen_t length = sizeof own;
    guint32 local;
    dmx_address(dmx->address, &lamps->node);
    dmx_address(dmx->local_address, &local);
    if (!dmx_lock(dmx, error))
        return FALSE;
    lamps->fd = udp_open(local, 0, error);
    if (lamps->fd < 0)
        return FALSE;
    const struct sockaddr_in to = {
        .sin_family = AF_INET, .sin_port = htons(WLED_PORT), .sin_addr.s_addr = htonl(lamps->node)};
    if (connect(lamps->fd, (const struct sockaddr *)&to, sizeof to) < 0 ||
        getsockname(lamps->fd, (struct sockaddr *)&own, &length) < 0)
        return device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                                "there is no way to WLED at %s" ERROR_ADVICE
                                "check address, and the network of this computer",
                                dmx->address);
    lamps->own = ntohl(own.sin_addr.s_addr);
    g_autofree char *own_name = udp_name(lamps->own);
    recording_hide(own_name, "{computer}");
    lamps->http = wled_http_new(dmx->address, lamps->http_port);
    return TRUE;
}

static gboolean check_leds(const struct wled_lamps *lamps, GError **error) {
    const struct dmx *dmx = &lamps->dmx;
    const int needed = lamps->first_led + dmx->n * lamps->leds;
    return lamps->n_leds >= needed ||
           config_set_error(error, CONFIG_ERROR_VALUE, dmx->bank->device.section, "n",
                            "the lamps need %d LEDs, but WLED at %s has %d; change n, leds or "
                            "first_led, or the LED settings of WLED",
                            needed, dmx->address, lamps->n_leds);
}

static void set_layout(struct wled_lamps *lamps) {
    lamps->dmx.start = 1;
    lamps->dmx.bits = 8;
    lamps->dmx.n_same = 3 * lamps->leds - 1;
}

static gboolean open_lamps(LampBank *bank, GError **error) {
    struct wled_lamps *lamps = bank->device.priv;
    lamps->fd = -1;
    if (!device_check_real_clock(&bank->device, error))
        return FALSE;
    set_layout(lamps);
    dmx_init(&lamps->dmx, &protocol, bank);
    lamps->alive_us = G_MININT64;
    if (!connect_node(lamps, error)) {
        error_details_add_subject(error, bank->device.who);
    } else if (dmx_start(&lamps->dmx, OPEN_ANSWER_MS, error) && check_leds(lamps, error)) {
        g_autofree char *model = g_strdup_printf("WLED %s", lamps->version);
        bank->watchdog_s = DARK_S;
        device_set_identity(&bank->device, model, NULL, lamps->dmx.address);
        return TRUE;
    }
    leave(lamps);
    return FALSE;
}

static void close_lamps(LampBank *bank) {
    struct wled_lamps *lamps = bank->device.priv;
    dmx_stop(&lamps->dmx, CLOSE_ANSWER_MS);
    leave(lamps);
}

static gboolean set_lamp(LampBank *bank, int index, gboolean on, GError **error) {
    return dmx_set(bank->device.priv, index, on, error);
}

static void check(gconstpointer given, const struct config_section *section, Mistakes *mistakes) {
    const struct wled_lamps *lamps = given;
    struct wled_lamps copy = *lamps;
    guint32 address;
    set_layout(&copy);
    dmx_check(&copy.dmx, &protocol, section, mistakes);
    if (!dmx_address(lamps->dmx.address, &address) || address == 0 || address >> 28 >= 14)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "address",
                       "“%s” is not the IPv4 address of a controller, such as 10.0.0.7",
                       lamps->dmx.address);
}

static void needs(gconstpointer given, GPtrArray *to) {
    g_ptr_array_add(to, unit(given, 0));
}

const struct lamps_driver wled_lamps_driver = {
    .info = {"lamps", "wled-lamps", "LEDs on a WLED controller", options, sizeof(struct wled_lamps),
             check, needs},
    .open = open_lamps,
    .close = close_lamps,
    .set = set_lamp,
};
