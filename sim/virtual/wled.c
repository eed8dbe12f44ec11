#include "wled.h"

#include <arpa/inet.h>
#include <errno.h>
#include <json-glib/json-glib.h>
#include <libsoup/soup.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define UDP_PORT 21324
#define DNRGB    4

struct VirtualWled {
    char *address;
    int n, fd, port;
    GThread *thread;
    GMainContext *context;
    gint quits; /* atomic */
    SoupServer *server;

    GMutex mutex; /* guards the following members */
    struct virtual_wled_faults faults;
    struct virtual_wled_state state;
    guint8 received[VIRTUAL_WLED_LEDS][3];
    int brightness, last_brightness; /* brightness is 0 while the controller is off */
    gint64 live_until_us;
    char from[INET_ADDRSTRLEN];
    guint n_received;
};

/* Computes what the LEDs show. Levels that come by UDP are shown with the brightness that WLED last
 * had. */
static void show(VirtualWled *wled) {
    struct virtual_wled_state *state = &wled->state;
    const int brightness = wled->brightness ? wled->brightness : wled->last_brightness;
    if (state->live && g_get_monotonic_time() > wled->live_until_us) {
        state->live = FALSE;
        state->n_returns++;
    }
    state->on = wled->brightness > 0;
    state->lit = FALSE;
    for (int i = 0; i < wled->n; i++)
        for (int k = 0; k < 3; k++) {
            state->leds[i][k] =
                (guint8)(state->live ? wled->received[i][k] * brightness / 255 : wled->brightness);
            state->lit |= state->leds[i][k] > 0;
        }
}

static void take_packet(VirtualWled *wled, const guint8 *bytes, int n,
                        const struct sockaddr_in *from) {
    const int first = n >= 4 ? bytes[2] << 8 | bytes[3] : 0;
    if (n < 7 || bytes[0] != DNRGB || (n - 4) % 3 || n > 4 + 3 * 489) {
        wled->state.n_damaged++;
        return;
    }
    wled->state.n_packets++;
    wled->state.live = TRUE;
    wled->live_until_us =
        bytes[1] == 255 ? G_MAXINT64 : g_get_monotonic_time() + bytes[1] * G_USEC_PER_SEC;
    inet_ntop(AF_INET, &from->sin_addr, wled->from, sizeof wled->from);
    for (int i = 0; i < (n - 4) / 3 && first + i < wled->n; i++)
        memcpy(wled->received[first + i], bytes + 4 + 3 * i, 3);
}

static void receive(VirtualWled *wled) {
    guint8 bytes[1500];
    struct sockaddr_in from = {0};
    socklen_t length = sizeof from;
    for (gssize n; (n = recvfrom(wled->fd, bytes, sizeof bytes, MSG_DONTWAIT,
                                 (struct sockaddr *)&from, &length)) >= 0;) {
        const struct virtual_wled_faults *faults = &wled->faults;
        if (!faults->cut && !faults->deaf &&
            !(faults->lose > 0 && ++wled->n_received % (guint)faults->lose == 0))
            take_packet(wled, bytes, (int)n, &from);
    }
    show(wled);
}

static gboolean on_tick(gpointer data) {
    VirtualWled *wled = data;
    g_mutex_lock(&wled->mutex);
    receive(wled);
    g_mutex_unlock(&wled->mutex);
    return G_SOURCE_CONTINUE;
}

static void change(VirtualWled *wled, const char *text, gsize n) {
    g_autoptr(JsonParser) parser = json_parser_new();
    if (wled->faults.stays || !json_parser_load_from_data(parser, text, (gssize)n, NULL))
        return;
    JsonObject *to = json_node_get_object(json_parser_get_root(parser));
    if (json_object_has_member(to, "bri"))
        wled->brightness = (int)json_object_get_int_member(to, "bri");
    if (json_object_has_member(to, "on") &&
        json_object_get_boolean_member(to, "on") != (wled->brightness > 0)) {
        if (wled->brightness > 0)
            wled->last_brightness = wled->brightness;
        wled->brightness = wled->brightness > 0 ? 0 : wled->last_brightness;
    }
    if (json_object_has_member(to, "live") && !json_object_get_boolean_member(to, "live"))
        wled->state.live = FALSE;
}

static void on_request(SoupServer *server, SoupServerMessage *message, const char *path,
                       GHashTable *query, gpointer data) {
    VirtualWled *wled = data;
    const gboolean post = g_str_equal(soup_server_message_get_method(message), "POST");
    g_mutex_lock(&wled->mutex);
    receive(wled);
    const SoupMessageBody *body = soup_server_message_get_request_body(message);
    *(post ? &wled->state.n_posts : &wled->state.n_gets) += 1;
    if (post && !wled->faults.cut)
        change(wled, body->data, (gsize)body->length);
    show(wled);
    g_autofree char *text =
        wled->faults.garbage
            ? g_strdup("<html>no JSON</html>")
            : g_strdup_printf("{\"state\":{\"on\":%s,\"bri\":%d},\"info\":{\"ver\":\"0.14.4\","
                              "\"leds\":{\"count\":%d},\"live\":%s,\"lm\":\"%s\",\"lip\":\"%s\","
                              "\"name\":\"Virtual WLED\",\"mac\":\"021bc5471109\",\"ip\":\"%s\","
                              "\"wifi\":{\"bssid\":\"02:1B:C5:47:11:0A\"}}}",
                              wled->state.on ? "true" : "false", wled->last_brightness, wled->n,
                              wled->state.live ? "true" : "false", wled->state.live ? "UDP" : "",
                              !wled->state.live    ? ""
                              : wled->faults.other ? "10.9.8.7"
                                                   : wled->from,
                              wled->address);
    const struct virtual_wled_faults faults = wled->faults;
    g_mutex_unlock(&wled->mutex);
    soup_server_message_set_status(message, faults.refuses ? 500 : 200, NULL);
    soup_server_message_set_response(message, "application/json", SOUP_MEMORY_COPY, text,
                                     strlen(text));
    if (faults.cut || faults.silent)
        soup_server_message_pause(message);
}

static gpointer run(gpointer data) {
    VirtualWled *wled = data;
    g_main_context_push_thread_default(wled->context);
    while (!g_atomic_int_get(&wled->quits))
        g_main_context_iteration(wled->context, TRUE);
    g_main_context_pop_thread_default(wled->context);
    return NULL;
}

static gboolean open_sockets(VirtualWled *wled, const char *address, GError **error) {
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_port = htons(UDP_PORT)};
    inet_pton(AF_INET, address, &at.sin_addr);
    wled->fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (wled->fd < 0 || bind(wled->fd, (struct sockaddr *)&at, sizeof at) < 0) {
        g_set_error(error, G_IO_ERROR, g_io_error_from_errno(errno),
                    "virtual WLED: cannot listen at %s, UDP port %d: %s", address, UDP_PORT,
                    g_strerror(errno));
        return FALSE;
    }
    g_autoptr(GSocketAddress) http = g_inet_socket_address_new_from_string(address, 0);
    wled->server = soup_server_new(NULL, NULL);
    soup_server_add_handler(wled->server, "/json", on_request, wled, NULL);
    g_main_context_push_thread_default(wled->context);
    const gboolean listens = soup_server_listen(wled->server, http, 0, error);
    g_main_context_pop_thread_default(wled->context);
    if (!listens)
        return FALSE;
    GSList *uris = soup_server_get_uris(wled->server);
    wled->port = g_uri_get_port(uris->data);
    g_slist_free_full(uris, (GDestroyNotify)g_uri_unref);
    return TRUE;
}

VirtualWled *virtual_wled_new(const char *address, int n, GError **error) {
    VirtualWled *wled = g_new0(VirtualWled, 1);
    g_mutex_init(&wled->mutex);
    wled->address = g_strdup(address);
    wled->n = n;
    wled->brightness = wled->last_brightness = 128;
    wled->context = g_main_context_new();
    if (!open_sockets(wled, address, error)) {
        virtual_wled_free(wled);
        return NULL;
    }
    g_autoptr(GSource) tick = g_timeout_source_new(2);
    g_source_set_callback(tick, on_tick, wled, NULL);
    g_source_attach(tick, wled->context);
    wled->thread = g_thread_new("virtual-wled", run, wled);
    return wled;
}

void virtual_wled_free(VirtualWled *wled) {
    if (!wled)
        return;
    if (wled->thread) {
        g_atomic_int_set(&wled->quits, TRUE);
        g_main_context_wakeup(wled->context);
        g_thread_join(wled->thread);
    }
    if (wled->server) {
        g_main_context_push_thread_default(wled->context);
        soup_server_disconnect(wled->server);
        g_clear_object(&wled->server);
        g_main_context_pop_thread_default(wled->context);
    }
    if (wled->fd >= 0)
        close(wled->fd);
    g_main_context_unref(wled->context);
    g_mutex_clear(&wled->mutex);
    g_free(wled->address);
    g_free(wled);
}

int virtual_wled_http_port(const VirtualWled *wled) {
    return wled->port;
}

void virtual_wled_fail(VirtualWled *wled, const struct virtual_wled_faults *faults) {
    g_mutex_lock(&wled->mutex);
    receive(wled);
    wled->faults = *faults;
    g_mutex_unlock(&wled->mutex);
}

void virtual_wled_press(VirtualWled *wled) {
    g_mutex_lock(&wled->mutex);
    wled->brightness = wled->last_brightness;
    show(wled);
    g_mutex_unlock(&wled->mutex);
}

void virtual_wled_state(VirtualWled *wled, struct virtual_wled_state *ret) {
    g_mutex_lock(&wled->mutex);
    receive(wled);
    *ret = wled->state;
    g_mutex_unlock(&wled->mutex);
}
