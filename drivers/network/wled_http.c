#include "wled_http.h"

#include "dmx.h"
#include "drivers/recording.h"

#include <json-glib/json-glib.h>
#include <libsoup/soup.h>
#include <string.h>

#define TIMEOUT_S  1
#define MAX_ANSWER 65536

/* Members of the request that makes WLED dark:
 * - "bri" is the brightness of the levels that come by UDP. WLED keeps it while it is off.
 * - "live": false ends the reception of UDP.
 * - "v": true requests the new state as the answer. */
#define OFF "{\"on\":false,\"bri\":255,\"live\":false,\"transition\":0,\"v\":true}"

struct WledHttp {
    char *address;
    char *state_url, *both_url;
    SoupSession *session;
    GThread *thread;
    GAsyncQueue *requests, *answers; /* of struct wled_answer */
    GCancellable *cancellable;
    gboolean busy;
};

void wled_answer_free(struct wled_answer *answer) {
    g_clear_error(&answer->error);
    g_free(answer);
}

static JsonObject *object_of(JsonObject *parent, const char *name) {
    JsonNode *node = parent ? json_object_get_member(parent, name) : NULL;
    return node && JSON_NODE_HOLDS_OBJECT(node) ? json_node_get_object(node) : NULL;
}

static JsonNode *value_of(JsonObject *parent, const char *name) {
    JsonNode *node = parent ? json_object_get_member(parent, name) : NULL;
    return node && JSON_NODE_HOLDS_VALUE(node) ? node : NULL;
}

/* Hides from a recording what WLED says about the network and its owner. */
static void hide_names(JsonObject *info) {
    JsonNode *nodes[] = {value_of(info, "name"), value_of(info, "mac"), value_of(info, "ip"),
                         value_of(object_of(info, "wifi"), "bssid")};
    for (gsize i = 0; i < G_N_ELEMENTS(nodes); i++) {
        const char *text = nodes[i] ? json_node_get_string(nodes[i]) : NULL;
        if (text && strcmp(text, "WLED") != 0)
            recording_hide(text, NULL);
    }
}

gboolean wled_answer_read(const char *text, gssize n, struct wled_answer *ret, GError **error) {
    g_autoptr(JsonParser) parser = json_parser_new();
    if (n > 0 && g_utf8_validate(text, n, NULL) &&
        json_parser_load_from_data(parser, text, n, NULL)) {
        JsonNode *root = json_parser_get_root(parser);
        JsonObject *top = root && JSON_NODE_HOLDS_OBJECT(root) ? json_node_get_object(root) : NULL;
        JsonObject *info = object_of(top, "info");
        JsonNode *on = value_of(object_of(top, "state"), "on"), *live = value_of(info, "live");
        JsonNode *from = value_of(info, "lip"), *version = value_of(info, "ver");
        JsonNode *count = value_of(object_of(info, "leds"), "count");
        const char *name = version ? json_node_get_string(version) : NULL;
        const char *address = from ? json_node_get_string(from) : NULL;
        if (on && live && count && json_node_get_value_type(on) == G_TYPE_BOOLEAN &&
            json_node_get_value_type(live) == G_TYPE_BOOLEAN) {
            ret->on = json_node_get_boolean(on);
            ret->live = json_node_get_boolean(live);
            ret->n_leds = (int)CLAMP(json_node_get_int(count), 0, G_MAXINT);
            hide_names(info);
            if (!dmx_address(address ? address : "", &ret->from))
                ret->from = 0;
            g_strlcpy(ret->version, name ? name : "", sizeof ret->version);
            return TRUE;
        }
    }
    return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                            "the answer is not the state of WLED" ERROR_ADVICE
                            "check address, and update WLED");
}

static void record_request(const WledHttp *http, gboolean off) {
    static const char *const requests[] = {"GET /json/si\n", "POST /json/state " OFF "\n"};
    recording_text((struct recording_bus){"http", http->address}, RECORDING_SENT, requests[off],
                   strlen(requests[off]));
}

/* Records status and body as one line. */
static void record_answer(const WledHttp *http, int status, const char *body, gsize n) {
    if (!recording_is_on())
        return;
    g_autofree char *text = g_strdup_printf("%d %.*s", status, (int)n, body);
    g_strdelimit(text, "\r\n", ' ');
    g_autofree char *line = g_strconcat(text, "\n", NULL);
    recording_text((struct recording_bus){"http", http->address}, RECORDING_RECEIVED, line,
                   strlen(line));
}

static gboolean ask(WledHttp *http, struct wled_answer *answer, GError **error) {
    g_autoptr(SoupMessage) message = soup_message_new(
        answer->off ? "POST" : "GET", answer->off ? http->state_url : http->both_url);
    if (answer->off) {
        g_autoptr(GBytes) body = g_bytes_new_static(OFF, sizeof OFF - 1);
        soup_message_set_request_body_from_bytes(message, "application/json", body);
    }
    soup_message_headers_append(soup_message_get_request_headers(message), "Connection", "close");
    record_request(http, answer->off);
    g_autoptr(GInputStream) stream =
        soup_session_send(http->session, message, http->cancellable, error);
    g_autofree char *text = g_malloc(MAX_ANSWER);
    gsize n;
    if (!stream || !g_input_stream_read_all(stream, text, MAX_ANSWER, &n, http->cancellable, error))
        return FALSE;
    record_answer(http, (int)soup_message_get_status(message), text, n);
    if (soup_message_get_status(message) != SOUP_STATUS_OK)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "it answers with the HTTP status %d instead of 200" ERROR_ADVICE
                                "check address and http_port",
                                (int)soup_message_get_status(message));
    return wled_answer_read(text, (gssize)n, answer, error);
}

static gpointer run(gpointer data) {
    WledHttp *http = data;
    struct wled_answer *answer;
    while ((answer = g_async_queue_pop(http->requests))->asked_us != G_MAXINT64) {
        if (!ask(http, answer, &answer->error) && answer->error->domain != DEVICE_ERROR) {
            g_autoptr(GError) failed = g_steal_pointer(&answer->error);
            answer->error =
                device_error_new(DEVICE_ERROR_TIMEOUT, NULL,
                                 "its state cannot be read by HTTP: %s" ERROR_ADVICE
                                 "check its power, its network and address, and http_port",
                                 failed->message);
        }
        g_async_queue_push(http->answers, answer);
    }
    wled_answer_free(answer);
    return NULL;
}

static void answer_free(gpointer answer) {
    wled_answer_free(answer);
}

WledHttp *wled_http_new(const char *address, int port) {
    WledHttp *http = g_new0(WledHttp, 1);
    http->address = g_strdup(address);
    http->state_url = g_strdup_printf("http://%s:%d/json/state", address, port);
    http->both_url = g_strdup_printf("http://%s:%d/json/si", address, port);
    http->session = soup_session_new_with_options("timeout", TIMEOUT_S, NULL);
    soup_session_set_proxy_resolver(http->session, NULL);
    http->requests = g_async_queue_new();
    http->answers = g_async_queue_new_full(answer_free);
    http->cancellable = g_cancellable_new();
    http->thread = g_thread_new("wled", run, http);
    return http;
}

void wled_http_free(WledHttp *http) {
    if (!http)
        return;
    struct wled_answer *last = g_new0(struct wled_answer, 1);
    last->asked_us = G_MAXINT64;
    g_cancellable_cancel(http->cancellable);
    g_async_queue_push(http->requests, last);
    g_thread_join(http->thread);
    g_async_queue_unref(http->requests);
    g_async_queue_unref(http->answers);
    g_object_unref(http->session);
    g_object_unref(http->cancellable);
    g_free(http->address);
    g_free(http->state_url);
    g_free(http->both_url);
    g_free(http);
}

gboolean wled_http_is_busy(const WledHttp *http) {
    return http->busy;
}

void wled_http_ask(WledHttp *http, gboolean off, gint64 asked_us) {
    struct wled_answer *answer = g_new0(struct wled_answer, 1);
    answer->off = off;
    answer->asked_us = asked_us;
    http->busy = TRUE;
    g_async_queue_push(http->requests, answer);
}

struct wled_answer *wled_http_take(WledHttp *http) {
    struct wled_answer *answer = g_async_queue_try_pop(http->answers);
    http->busy = http->busy && !answer;
    return answer;
}
