#include "web_server.h"

#include "base/json.h"

#include <libsoup/soup.h>
#include <string.h>

#define MOST_STREAMS 64
#define MOST_BODY    4096        /* bytes of a request */
#define MOST_PENDING (256 << 10) /* bytes that a reader of a stream may lag behind */
#define KEEP_ALIVE_S 20          /* between two lines of a stream, at most */
#define API          "/api/v1/"
#define RESOURCES    "/org/mesorig/web"

struct stream {
    SoupServerMessage *message;
    WebServer *server;
    gsize pending;
};

struct WebServer {
    SoupServer *soup;
    WebRig *rig;
    char *token;
    GPtrArray *hosts; /* lower case, without port */
    GPtrArray *streams;
    guint keep_alive_id;
};

static void respond(SoupServerMessage *message, guint status, const char *type, const char *text) {
    soup_server_message_set_status(message, status, NULL);
    soup_server_message_set_response(message, type, SOUP_MEMORY_COPY, text, strlen(text));
}

static void refuse(SoupServerMessage *message, guint status, const char *why) {
    g_autoptr(GString) json = g_string_new("{\"error\": ");
    json_append_string(json, why);
    g_string_append(json, "}\n");
    respond(message, status, "application/json", json->str);
}

/* Forbids caching, framing, guessing of types and loading from elsewhere. */
static void add_headers(SoupServerMessage *message) {
    SoupMessageHeaders *headers = soup_server_message_get_response_headers(message);
    soup_message_headers_replace(headers, "Cache-Control", "no-store");
    soup_message_headers_replace(headers, "X-Content-Type-Options", "nosniff");
    soup_message_headers_replace(headers, "X-Frame-Options", "DENY");
    soup_message_headers_replace(headers, "Referrer-Policy", "no-referrer");
    soup_message_headers_replace(headers, "Cross-Origin-Resource-Policy", "same-origin");
    soup_message_headers_replace(headers, "Content-Security-Policy",
                                 "default-src 'none'; script-src 'self'; style-src 'self'; img-src "
                                 "'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
                                 "frame-ancestors 'none'");
}

/* "name:port" or "[v6]:port" → name, lower case; g_free(). */
static char *host_name(const char *host) {
    const char *end = *host == '[' ? strchr(host, ']') : strchr(host, ':');
    const gsize n = !end ? strlen(host) : (gsize)(end - host) + (*host == '[');
    g_autofree char *name = g_strndup(host, n);
    return g_ascii_strdown(name, -1);
}

static gboolean is_our_host(const WebServer *server, const char *host) {
    if (!host)
        return FALSE;
    g_autofree char *name = host_name(host);
    return g_ptr_array_find_with_equal_func(server->hosts, name, g_str_equal, NULL);
}

/* Compares in a time that does not depend on the content. */
static gboolean has_token(const WebServer *server, SoupServerMessage *message) {
    const char *header = soup_message_headers_get_one(
        soup_server_message_get_request_headers(message), "Authorization");
    if (!server->token || !header || !g_str_has_prefix(header, "Bearer "))
        return FALSE;
    g_autofree char *given = g_compute_checksum_for_string(G_CHECKSUM_SHA256, header + 7, -1);
    g_autofree char *right = g_compute_checksum_for_string(G_CHECKSUM_SHA256, server->token, -1);
    int different = 0;
    for (int i = 0; right[i]; i++)
        different |= given[i] ^ right[i];
    return different == 0;
}

/* What every request must satisfy; FALSE: it was answered. */
static gboolean admit(const WebServer *server, SoupServerMessage *message, gboolean acts) {
    SoupMessageHeaders *headers = soup_server_message_get_request_headers(message);
    const char *method = soup_server_message_get_method(message);
    const char *origin = soup_message_headers_get_one(headers, "Origin");
    const char *site = soup_message_headers_get_one(headers, "Sec-Fetch-Site");
    const char *of_origin = origin ? strstr(origin, "://") : NULL;
    const gboolean reads = strcmp(method, "GET") == 0 || strcmp(method, "HEAD") == 0;
    add_headers(message);
    if (!is_our_host(server, soup_message_headers_get_one(headers, "Host")))
        refuse(
            message, SOUP_STATUS_MISDIRECTED_REQUEST,
            "the host name is not one of this server's: start it with --host NAME to add the name");
    else if (acts ? strcmp(method, "POST") != 0 : !reads) {
        refuse(message, SOUP_STATUS_METHOD_NOT_ALLOWED, acts ? "use POST" : "use GET");
        soup_message_headers_replace(soup_server_message_get_response_headers(message), "Allow",
                                     acts ? "POST" : "GET, HEAD");
    } else if ((of_origin && !is_our_host(server, of_origin + 3)) || (origin && !of_origin) ||
               (acts && site && strcmp(site, "same-origin") != 0 && strcmp(site, "none") != 0))
        refuse(message, SOUP_STATUS_FORBIDDEN, "requests from pages of other sites are refused");
    else if (acts && !server->token)
        refuse(message, SOUP_STATUS_FORBIDDEN,
               "this server is read-only: start it with --token-file to allow commands");
    else if (acts && !has_token(server, message)) {
        refuse(message, SOUP_STATUS_UNAUTHORIZED, "the token is missing or wrong");
        soup_message_headers_replace(soup_server_message_get_response_headers(message),
                                     "WWW-Authenticate", "Bearer");
    } else
        return TRUE;
    return FALSE;
}

/* Larger requests are not read to their end. */
static void on_headers(SoupServerMessage *message, gpointer data) {
    SoupMessageHeaders *headers = soup_server_message_get_request_headers(message);
    if (soup_message_headers_get_encoding(headers) == SOUP_ENCODING_CHUNKED ||
        soup_message_headers_get_content_length(headers) > MOST_BODY) {
        refuse(message, SOUP_STATUS_REQUEST_ENTITY_TOO_LARGE,
               "the request's body is too large, or is sent in chunks");
        soup_message_headers_replace(soup_server_message_get_response_headers(message),
                                     "Connection", "close");
    }
}

static void on_request(SoupServer *soup, SoupServerMessage *message, gpointer data) {
    g_signal_connect(message, "got-headers", G_CALLBACK(on_headers), data);
}

/* The page, from the resources in this program. */
static void on_page(SoupServer *soup, SoupServerMessage *message, const char *path,
                    GHashTable *query, gpointer data) {
    static const struct {
        const char *path, *file, *type;
    } files[] = {{"/", "index.html", "text/html; charset=utf-8"},
                 {"/style.css", "style.css", "text/css; charset=utf-8"},
                 {"/app.js", "app.js", "text/javascript; charset=utf-8"}};
    if (!admit(data, message, FALSE))
        return;
    for (gsize i = 0; i < G_N_ELEMENTS(files); i++) {
        if (strcmp(path, files[i].path) != 0)
            continue;
        g_autofree char *name = g_build_path("/", RESOURCES, files[i].file, NULL);
        g_autoptr(GBytes) bytes = g_resources_lookup_data(name, 0, NULL);
        soup_server_message_set_status(message, SOUP_STATUS_OK, NULL);
        soup_server_message_set_response(message, files[i].type, SOUP_MEMORY_COPY,
                                         g_bytes_get_data(bytes, NULL), g_bytes_get_size(bytes));
        return;
    }
    refuse(message, SOUP_STATUS_NOT_FOUND, "there is no such page");
}

static void send(struct stream *stream, const char *text) {
    const gsize n = strlen(text);
    stream->pending += n;
    if (stream->pending > MOST_PENDING) {
        /* The client does not read: the next state contains what it misses. */
        g_socket_shutdown(soup_server_message_get_socket(stream->message), TRUE, TRUE, NULL);
        return;
    }
    soup_message_body_append(soup_server_message_get_response_body(stream->message),
                             SOUP_MEMORY_COPY, text, n);
    soup_server_message_unpause(stream->message);
}

static void on_news(const char *name, const char *json, gpointer data) {
    WebServer *server = data;
    g_autofree char *text = g_strdup_printf("event: %s\ndata: %s\n\n", name, json);
    for (guint i = 0; i < server->streams->len; i++)
        send(server->streams->pdata[i], text);
}

static gboolean keep_alive(gpointer data) {
    WebServer *server = data;
    for (guint i = 0; i < server->streams->len; i++)
        send(server->streams->pdata[i], ": still here\n\n");
    return G_SOURCE_CONTINUE;
}

static void on_written(SoupServerMessage *message, guint n, gpointer data) {
    struct stream *stream = data;
    stream->pending -= MIN(stream->pending, n);
}

static void on_finished(SoupServerMessage *message, gpointer data) {
    struct stream *stream = data;
    g_signal_handlers_disconnect_by_data(message, stream);
    g_ptr_array_remove_fast(stream->server->streams, stream);
}

static void stream_free(gpointer data) {
    struct stream *stream = data;
    g_object_unref(stream->message);
    g_free(stream);
}

static void open_stream(WebServer *server, SoupServerMessage *message) {
    if (server->streams->len >= MOST_STREAMS) {
        refuse(message, SOUP_STATUS_SERVICE_UNAVAILABLE,
               "too many pages are open on this rig: close one");
        return;
    }
    SoupMessageHeaders *headers = soup_server_message_get_response_headers(message);
    SoupMessageBody *body = soup_server_message_get_response_body(message);
    struct stream *stream = g_new0(struct stream, 1);
    g_autofree char *state = web_rig_state(server->rig);
    g_autofree char *first = g_strdup_printf("retry: 2000\nevent: state\ndata: %s\n\n", state);
    stream->message = g_object_ref(message);
    stream->server = server;
    g_ptr_array_add(server->streams, stream);
    soup_server_message_set_status(message, SOUP_STATUS_OK, NULL);
    soup_message_headers_set_content_type(headers, "text/event-stream", NULL);
    soup_message_headers_set_encoding(headers, SOUP_ENCODING_CHUNKED);
    soup_message_body_set_accumulate(body, FALSE);
    g_signal_connect(message, "wrote-body-data", G_CALLBACK(on_written), stream);
    g_signal_connect(message, "finished", G_CALLBACK(on_finished), stream);
    stream->pending = strlen(first);
    soup_message_body_append(body, SOUP_MEMORY_COPY, first, strlen(first));
}

static void on_picture(const struct web_picture *picture, const GError *error, gpointer data) {
    SoupServerMessage *message = data;
    const gboolean as_json = g_object_get_data(G_OBJECT(message), "json") != NULL;
    if (!picture) {
        refuse(message, SOUP_STATUS_NOT_FOUND, error->message);
    } else if (as_json) {
        respond(message, SOUP_STATUS_OK, "application/json", picture->json);
    } else {
        soup_server_message_set_status(message, SOUP_STATUS_OK, NULL);
        soup_server_message_set_response(message, "image/png", SOUP_MEMORY_COPY,
                                         g_bytes_get_data(picture->png, NULL),
                                         g_bytes_get_size(picture->png));
    }
    soup_server_message_unpause(message);
    g_object_unref(message);
}

/* cameras/NAME.png or cameras/NAME.json */
static gboolean answer_picture(WebServer *server, SoupServerMessage *message, const char *what) {
    const gboolean png = g_str_has_suffix(what, ".png"), json = g_str_has_suffix(what, ".json");
    if (!g_str_has_prefix(what, "cameras/") || !(png || json))
        return FALSE;
    const char *name = what + strlen("cameras/");
    g_autofree char *camera = g_strndup(name, (gsize)(strrchr(name, '.') - name));
    if (!g_utf8_validate(camera, -1, NULL))
        return FALSE;
    if (json)
        g_object_set_data(G_OBJECT(message), "json", GINT_TO_POINTER(1));
    soup_server_message_pause(message);
    web_rig_picture(server->rig, camera, on_picture, g_object_ref(message));
    return TRUE;
}

static void on_done(const GError *error, gpointer data) {
    SoupServerMessage *message = data;
    if (error)
        refuse(message, SOUP_STATUS_CONFLICT, error->message);
    else
        respond(message, SOUP_STATUS_OK, "application/json", "{}\n");
    soup_server_message_unpause(message);
    g_object_unref(message);
}

static void on_api(SoupServer *soup, SoupServerMessage *message, const char *path,
                   GHashTable *query, gpointer data) {
    static const char *const actions[][2] = {
        {"pause", "Pause"}, {"continue", "Continue"}, {"abort", "Abort"}, {"safe", "SafeState"}};
    static const struct {
        const char *name;
        char *(*text)(const WebRig *rig);
    } shown[] = {{"state", web_rig_state}, {"log", web_rig_events}, {"progress", web_rig_progress}};
    WebServer *server = data;
    const char *what = g_str_has_prefix(path, API) ? path + strlen(API) : "";
    for (gsize i = 0; i < G_N_ELEMENTS(actions); i++)
        if (strcmp(what, actions[i][0]) == 0) {
            if (!admit(server, message, TRUE))
                return;
            soup_server_message_pause(message);
            web_rig_call(server->rig, actions[i][1], on_done, g_object_ref(message));
            return;
        }
    if (!admit(server, message, FALSE))
        return;
    for (gsize i = 0; i < G_N_ELEMENTS(shown); i++)
        if (strcmp(what, shown[i].name) == 0) {
            g_autofree char *text = shown[i].text(server->rig);
            respond(message, SOUP_STATUS_OK, "application/json", text);
            return;
        }
    if (strcmp(what, "access") == 0) {
        respond(message, SOUP_STATUS_OK, "application/json",
                server->token ? "{\"acts\": true}" : "{\"acts\": false}");
        return;
    }
    if (strcmp(what, "events") == 0 && strcmp(soup_server_message_get_method(message), "GET") == 0)
        open_stream(server, message);
    else if (!answer_picture(server, message, what))
        refuse(message, SOUP_STATUS_NOT_FOUND, "this path does not exist: see docs/web.md");
}

static gboolean listen_on(WebServer *server, const struct web_options *options, GError **error) {
    if (!options->address)
        return soup_server_listen_local(server->soup, options->port, 0, error);
    g_autoptr(GSocketAddress) address =
        g_inet_socket_address_new_from_string(options->address, options->port);
    if (!address) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "%s is not an IP address to listen on: 0.0.0.0 listens on all IPv4 addresses",
                    options->address);
        return FALSE;
    }
    return soup_server_listen(server->soup, address, 0, error);
}

WebServer *web_server_new(WebRig *rig, const struct web_options *options, GError **error) {
    static const char *const local[] = {"localhost", "127.0.0.1", "[::1]"};
    WebServer *server = g_new0(WebServer, 1);
    server->rig = rig;
    server->token = g_strdup(options->token);
    server->hosts = g_ptr_array_new_with_free_func(g_free);
    server->streams = g_ptr_array_new_with_free_func(stream_free);
    server->soup = soup_server_new("server-header", "mesorig-web", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(local); i++)
        g_ptr_array_add(server->hosts, g_strdup(local[i]));
    if (options->address)
        g_ptr_array_add(server->hosts, strchr(options->address, ':')
                                           ? g_strdup_printf("[%s]", options->address)
                                           : g_strdup(options->address));
    for (int i = 0; options->hosts && options->hosts[i]; i++)
        g_ptr_array_add(server->hosts, g_ascii_strdown(options->hosts[i], -1));
    soup_server_add_handler(server->soup, "/", on_page, server, NULL);
    soup_server_add_handler(server->soup, API, on_api, server, NULL);
    g_signal_connect(server->soup, "request-started", G_CALLBACK(on_request), server);
    web_rig_listen(rig, on_news, server);
    server->keep_alive_id = g_timeout_add_seconds(KEEP_ALIVE_S, keep_alive, server);
    if (listen_on(server, options, error))
        return server;
    web_server_free(server);
    return NULL;
}

void web_server_free(WebServer *server) {
    if (!server)
        return;
    web_rig_listen(server->rig, NULL, NULL);
    g_source_remove(server->keep_alive_id);
    while (server->streams->len > 0) {
        struct stream *stream = server->streams->pdata[0];
        on_finished(stream->message, stream);
    }
    soup_server_disconnect(server->soup);
    g_object_unref(server->soup);
    g_ptr_array_unref(server->streams);
    g_ptr_array_unref(server->hosts);
    g_free(server->token);
    g_free(server);
}

char *web_server_uri(const WebServer *server) {
    GSList *uris = soup_server_get_uris(server->soup);
    char *ret = uris ? g_uri_to_string(uris->data) : g_strdup("");
    g_slist_free_full(uris, (GDestroyNotify)g_uri_unref);
    return ret;
}
