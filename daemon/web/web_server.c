#include "web_server.h"

#include "base/json.h"
#include "web_calibrations.h"
#include "web_door.h"
#include "web_material.h"
#include "web_origin.h"
#include "web_products.h"
#include "web_snaps.h"
#include "web_tasks.h"

#include <string.h>

#define MAX_BODY 4096 /* maximum number of bytes of a request's body */
/* maximum number of bytes that wait to be sent to the client of a stream */
#define MAX_PENDING  (256 << 10)
#define KEEP_ALIVE_S 20  /* maximum time between two lines of a stream */
#define MAX_CALLS    256 /* maximum number of calls that wait for the daemon's answer */
#define API          "/api/v1/"
#define RESOURCES    "/org/mesorig/web"

struct stream {
    SoupServerMessage *message;
    WebServer *server;
    gsize pending;
};

/* A call of SafeState that is under way. */
struct safe_call {
    WebServer *server; /* NULL after the server was freed */
    GPtrArray *asked;  /* messages that receive the answer */
};

struct WebServer {
    SoupServer *soup;
    WebDoor *door;
    WebRig *rig;
    WebMaterial *material;
    char *token;
    gboolean safe_needs_token;
    WebSnaps *snaps;
    WebProducts *products;
    WebCalibrations *calibrations;
    WebChild *child;
    char *sessions;     /* folder of sessions; NULL if there is none */
    char *address;      /* address on which the server listens */
    GPtrArray *origins; /* of char *: origins of the server's names (web_origin.h) */
    GPtrArray *streams;
    /* Number of calls that wait for the daemon's answer, without SafeState. Made by
     * g_rc_box_new(), because the calls may outlive the server. */
    int *calls;
    struct safe_call *safe_call; /* NULL if no call of SafeState is under way */
    /* messages that wait for the next call of SafeState; NULL if there are none */
    GPtrArray *safe_next;
    guint keep_alive_id;
};

static void respond(SoupServerMessage *message, guint status, const char *type, const char *text) {
    soup_server_message_set_status(message, status, NULL);
    soup_server_message_set_response(message, type, SOUP_MEMORY_COPY, text, strlen(text));
}

/* Answers with bytes, which are not copied. */
static void respond_bytes(SoupServerMessage *message, const char *type, GBytes *bytes) {
    SoupMessageHeaders *headers = soup_server_message_get_response_headers(message);
    soup_server_message_set_status(message, SOUP_STATUS_OK, NULL);
    soup_message_headers_set_content_type(headers, type, NULL);
    soup_message_body_append_bytes(soup_server_message_get_response_body(message), bytes);
}

static void refuse(SoupServerMessage *message, guint status, const char *why) {
    g_autoptr(GString) json = g_string_new("{\"error\": ");
    json_append_string(json, why);
    g_string_append(json, "}\n");
    respond(message, status, "application/json", json->str);
}

/* Adds headers that close the connection after the answer and forbid caching, framing, guessing of
 * content types, and loading from other sites. */
static void add_headers(SoupServerMessage *message) {
    SoupMessageHeaders *headers = soup_server_message_get_response_headers(message);
    soup_message_headers_replace(headers, "Connection", "close");
    soup_message_headers_replace(headers, "Cache-Control", "no-store");
    soup_message_headers_replace(headers, "X-Content-Type-Options", "nosniff");
    soup_message_headers_replace(headers, "X-Frame-Options", "DENY");
    soup_message_headers_replace(headers, "Referrer-Policy", "no-referrer");
    soup_message_headers_replace(headers, "Cross-Origin-Resource-Policy", "same-origin");
    soup_message_headers_replace(
        headers, "Content-Security-Policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src "
        "'self'; connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'");
}

/* Replaces headers for a page that was made of a session. Its scripts may only draw: they belong to
 * no origin, and cannot send requests or read the token. Only the page of this server may show it
 * in a frame. */
static void confine(SoupServerMessage *message) {
    SoupMessageHeaders *headers = soup_server_message_get_response_headers(message);
    soup_message_headers_replace(headers, "X-Frame-Options", "SAMEORIGIN");
    soup_message_headers_replace(
        headers, "Content-Security-Policy",
        "sandbox allow-scripts allow-downloads; default-src 'none'; script-src "
        "'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'self'");
}

static gboolean has_origin(const WebServer *server, SoupServerMessage *message,
                           const char *origin) {
    if (g_ptr_array_find_with_equal_func(server->origins, origin, g_str_equal, NULL))
        return TRUE;
    /* The IP address on which the connection was accepted is allowed as well. Unlike a name,
     * an IP address cannot be made to lead to this server by somebody else. */
    GInetSocketAddress *local =
        G_INET_SOCKET_ADDRESS(soup_server_message_get_local_address(message));
    g_autofree char *ip = g_inet_address_to_string(g_inet_socket_address_get_address(local));
    g_autofree char *of_ip = g_strdup_printf(strchr(ip, ':') ? "http://[%s]:%u" : "http://%s:%u",
                                             ip, g_inet_socket_address_get_port(local));
    return strcmp(origin, of_ip) == 0;
}

/* Returns the value of a header that occurs exactly once, and otherwise NULL. *ret_n is the number
 * of occurrences; ret_n may be NULL. */
static const char *only_header(SoupServerMessage *message, const char *name, int *ret_n) {
    SoupMessageHeadersIter iter;
    const char *key, *value, *found = NULL;
    int n = 0;
    soup_message_headers_iter_init(&iter, soup_server_message_get_request_headers(message));
    while (soup_message_headers_iter_next(&iter, &key, &value))
        if (g_ascii_strcasecmp(key, name) == 0) {
            found = value;
            n++;
        }
    if (ret_n)
        *ret_n = n;
    return n == 1 ? found : NULL;
}

/* Returns host and port of the URI that libsoup has made from the request line and the header Host.
 * Returns NULL if the URI has a user name. */
static char *authority(GUri *uri) {
    const char *host = g_uri_get_host(uri);
    const char *form = strchr(host, ':') ? "[%s]:%d" : "%s:%d";
    const int port = g_uri_get_port(uri);
    return g_uri_get_userinfo(uri) ? NULL : g_strdup_printf(form, host, port > 0 ? port : 80);
}

/* Returns the origins of this server that the request may be meant for, at most one per scheme. The
 * list is empty if the request is meant for another server. */
static GPtrArray *find_origins(const WebServer *server, SoupServerMessage *message) {
    static const char *const schemes[] = {"http", "https"};
    GPtrArray *found = g_ptr_array_new_with_free_func(g_free);
    const char *host = only_header(message, "Host", NULL);
    GUri *uri = soup_server_message_get_uri(message);
    g_autofree char *of_uri = authority(uri);
    /* The request line may also name a host. It must be the same as in the header Host. */
    g_autofree char *uri_origin = of_uri ? web_origin_of_host("http", of_uri) : NULL;
    g_autofree char *host_origin = host ? web_origin_of_host("http", host) : NULL;
    if (!host_origin || g_strcmp0(host_origin, uri_origin) != 0)
        return found;
    for (gsize i = 0; i < G_N_ELEMENTS(schemes); i++) {
        g_autofree char *origin = web_origin_of_host(schemes[i], host);
        if (has_origin(server, message, origin))
            g_ptr_array_add(found, g_steal_pointer(&origin));
    }
    return found;
}

/* Returns whether a request comes from a page of this server, or from no page. acts is TRUE for a
 * request that does more than read. The header Sec-Fetch-Site is then checked, too. */
static gboolean is_from_here(SoupServerMessage *message, const GPtrArray *origins, gboolean acts) {
    int n;
    const char *header = only_header(message, "Origin", &n);
    const char *site = soup_message_headers_get_one(
        soup_server_message_get_request_headers(message), "Sec-Fetch-Site");
    g_autofree char *origin = header ? web_origin_parse(header) : NULL;
    if (n > 0 && !(origin && g_ptr_array_find_with_equal_func((GPtrArray *)origins, origin,
                                                              g_str_equal, NULL)))
        return FALSE;
    return !acts || !site || strcmp(site, "same-origin") == 0 || strcmp(site, "none") == 0;
}

/* Returns whether the request has the right token. The time of the comparison does not depend on
 * the tokens, because their checksums are compared completely. */
static gboolean has_token(const WebServer *server, SoupServerMessage *message) {
    const char *header = only_header(message, "Authorization", NULL);
    if (!header || !g_str_has_prefix(header, "Bearer "))
        return FALSE;
    g_autofree char *given = g_compute_checksum_for_string(G_CHECKSUM_SHA256, header + 7, -1);
    g_autofree char *right = g_compute_checksum_for_string(G_CHECKSUM_SHA256, server->token, -1);
    int different = 0;
    for (int i = 0; right[i]; i++)
        different |= given[i] ^ right[i];
    return different == 0;
}

/* Checks the token of a request. Returns FALSE if the request was refused, and thus answered. */
static gboolean admit_token(const WebServer *server, SoupServerMessage *message) {
    SoupMessageHeaders *headers = soup_server_message_get_response_headers(message);
    WebVisitor *visitor = web_door_visitor(message);
    const gboolean given =
        soup_message_headers_get_one(soup_server_message_get_request_headers(message),
                                     "Authorization") != NULL;
    if (!server->token) {
        refuse(message, SOUP_STATUS_FORBIDDEN,
               "this server accepts no commands; start mesorig-web with --token-file to allow "
               "them");
        return FALSE;
    }
    /* During the penalty even the right token is refused. Otherwise the answer would say whether a
     * guess is right. */
    const double penalty_s = given ? web_visitor_penalty_s(visitor) : 0;
    if (penalty_s > 0) {
        g_autofree char *after = g_strdup_printf("%d", (int)penalty_s + 1);
        g_autofree char *why =
            g_strdup_printf("this address has sent wrong tokens; try again in %s s", after);
        refuse(message, 429, why);
        soup_message_headers_replace(headers, "Retry-After", after);
        return FALSE;
    }
    const gboolean right = given && has_token(server, message);
    if (given)
        web_visitor_token(visitor, right);
    if (!right) {
        refuse(message, SOUP_STATUS_UNAUTHORIZED,
               given
                   ? "the token is wrong: send the first line of the file of --token-file"
                   : "this request needs a token: send the first line of the file of --token-file");
        soup_message_headers_replace(headers, "WWW-Authenticate", "Bearer");
    }
    return right;
}

/* What a request needs: no token (ACCESS_LOOK), the token if safe_needs_token is set (ACCESS_SAFE),
 * or the token (ACCESS_TOKEN). */
enum access { ACCESS_LOOK, ACCESS_SAFE, ACCESS_TOKEN };

/* Checks the conditions of a request. Returns FALSE if the request was refused, and thus
 * answered. */
static gboolean admit(const WebServer *server, SoupServerMessage *message, enum access access) {
    const char *method = soup_server_message_get_method(message);
    const gboolean acts = access != ACCESS_LOOK;
    const gboolean reads = strcmp(method, "GET") == 0 || strcmp(method, "HEAD") == 0;
    g_autoptr(GPtrArray) origins = find_origins(server, message);
    if (origins->len == 0) {
        refuse(message, SOUP_STATUS_MISDIRECTED_REQUEST,
               "the header Host is not a name of this server; start mesorig-web with --host "
               "NAME[:PORT] to add the name");
    } else if (acts ? strcmp(method, "POST") != 0 : !reads) {
        refuse(message, SOUP_STATUS_METHOD_NOT_ALLOWED,
               acts ? "this path accepts only POST" : "this path accepts only GET and HEAD");
        soup_message_headers_replace(soup_server_message_get_response_headers(message), "Allow",
                                     acts ? "POST" : "GET, HEAD");
    } else if (!is_from_here(message, origins, acts)) {
        refuse(message, SOUP_STATUS_FORBIDDEN,
               "the header Origin or Sec-Fetch-Site says that a page of another site sent this "
               "request; open the page of this server");
    } else if (access == ACCESS_TOKEN || (access == ACCESS_SAFE && server->safe_needs_token)) {
        return admit_token(server, message);
    } else {
        return TRUE;
    }
    return FALSE;
}

/* Returns whether the request has no body, or has a body of at most MAX_BODY bytes and gives this
 * length in digits. */
static gboolean has_small_body(SoupServerMessage *message) {
    SoupMessageHeaders *headers = soup_server_message_get_request_headers(message);
    int n;
    const char *length = only_header(message, "Content-Length", &n);
    if (soup_message_headers_get_one(headers, "Transfer-Encoding") || n > 1)
        return FALSE;
    return n == 0 ||
           (*length && strlen(length) <= 10 && strspn(length, "0123456789") == strlen(length) &&
            g_ascii_strtoull(length, NULL, 10) <= MAX_BODY);
}

static void on_headers(SoupServerMessage *message, gpointer data) {
    /* With the header Range, a client could request many overlapping parts and get much more than
     * the whole. */
    soup_message_headers_remove(soup_server_message_get_request_headers(message), "Range");
    add_headers(message);
    if (has_small_body(message))
        return;
    refuse(message, SOUP_STATUS_REQUEST_ENTITY_TOO_LARGE,
           "a request may have a body of at most 4096 bytes, and must give its length in the "
           "header Content-Length");
    /* libsoup reads the body before it answers. It takes a length of 2^64 − 1 as −1, and then reads
     * until the connection ends. */
    const goffset length =
        soup_message_headers_get_content_length(soup_server_message_get_request_headers(message));
    if (length < 0 || length > WEB_DOOR_MAX_READ)
        web_visitor_close(web_door_visitor(message), "413 Content Too Large");
}

/* Called when a request was read completely, before its handler. */
static void on_request_read(SoupServer *soup, SoupServerMessage *message, gpointer data) {
    web_visitor_set_phase(web_door_visitor(message), WEB_READS);
}

static void on_request(SoupServer *soup, SoupServerMessage *message, gpointer data) {
    web_visitor_begin(web_door_visitor(message), message);
    g_signal_connect(message, "got-headers", G_CALLBACK(on_headers), NULL);
}

/* Answers with a file of daemon/web/page, which is a resource of this program. */
static void respond_file(SoupServerMessage *message, const char *file, const char *type) {
    g_autofree char *name = g_build_path("/", RESOURCES, file, NULL);
    g_autoptr(GBytes) bytes = g_resources_lookup_data(name, 0, NULL);
    respond_bytes(message, type, bytes);
}

/* Answers a request for the page with one of its files. */
static void on_page(SoupServer *soup, SoupServerMessage *message, const char *path,
                    GHashTable *query, gpointer data) {
    static const struct {
        const char *path, *file, *type;
    } files[] = {{"/", "index.html", "text/html; charset=utf-8"},
                 {"/style.css", "style.css", "text/css; charset=utf-8"},
                 {"/app.js", "app.js", "text/javascript; charset=utf-8"},
                 {"/sessions.js", "sessions.js", "text/javascript; charset=utf-8"},
                 {"/calibrate.js", "calibrate.js", "text/javascript; charset=utf-8"},
                 {"/hands.js", "hands.js", "text/javascript; charset=utf-8"},
                 {"/snaps.js", "snaps.js", "text/javascript; charset=utf-8"},
                 {"/material.js", "material.js", "text/javascript; charset=utf-8"}};
    if (!admit(data, message, ACCESS_LOOK))
        return;
    for (gsize i = 0; i < G_N_ELEMENTS(files); i++) {
        if (strcmp(path, files[i].path) != 0)
            continue;
        respond_file(message, files[i].file, files[i].type);
        return;
    }
    refuse(message, SOUP_STATUS_NOT_FOUND, "this page does not exist; the page of the rig is /");
}

static void send(struct stream *stream, const char *text) {
    const gsize n = strlen(text);
    stream->pending += n;
    if (stream->pending > MAX_PENDING) {
        /* The client does not read. When it opens a new stream, it gets the complete state. */
        web_visitor_close(web_door_visitor(stream->message), NULL);
        return;
    }
    soup_message_body_append(soup_server_message_get_response_body(stream->message),
                             SOUP_MEMORY_COPY, text, n);
    soup_server_message_unpause(stream->message);
}

static void on_news(const char *name, const char *json, gpointer data) {
    WebServer *server = data;
    web_material_follow(server->material, web_rig_session(server->rig));
    g_autofree char *text = g_strdup_printf("event: %s\ndata: %s\n\n", name, json);
    for (guint i = 0; i < server->streams->len; i++)
        send(server->streams->pdata[i], text);
}

static void on_material(const char *json, gpointer data) {
    on_news("material", json, data);
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

static void on_stream_finished(SoupServerMessage *message, gpointer data) {
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
    if (!web_visitor_stream(web_door_visitor(message))) {
        refuse(message, SOUP_STATUS_SERVICE_UNAVAILABLE,
               "too many pages of this rig are open; close one");
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
    g_signal_connect(message, "finished", G_CALLBACK(on_stream_finished), stream);
    stream->pending = strlen(first);
    soup_message_body_append(body, SOUP_MEMORY_COPY, first, strlen(first));
}

/* A request that waits for the daemon's answer. */
struct waiting {
    SoupServerMessage *message;
    int *calls; /* reference to the counter of the server */
    gboolean as_json;
};

/* Continues a paused message, unless its connection has ended. Releases the message. */
static void go_on(SoupServerMessage *message) {
    if (web_door_visitor(message))
        soup_server_message_unpause(message);
    g_object_unref(message);
}

/* Pauses a message until the daemon answers. Returns NULL if too many requests wait; the message
 * was then answered. */
static struct waiting *begin_waiting(WebServer *server, SoupServerMessage *message) {
    if (*server->calls >= MAX_CALLS) {
        refuse(message, SOUP_STATUS_SERVICE_UNAVAILABLE,
               "too many requests wait for an answer of mesorigd; try again later");
        return NULL;
    }
    struct waiting *waiting = g_new0(struct waiting, 1);
    waiting->message = g_object_ref(message);
    waiting->calls = g_rc_box_acquire(server->calls);
    ++*waiting->calls;
    soup_server_message_pause(message);
    return waiting;
}

static void end_waiting(struct waiting *waiting) {
    --*waiting->calls;
    g_rc_box_release(waiting->calls);
    go_on(waiting->message);
    g_free(waiting);
}

static void on_picture(const struct web_picture *picture, const GError *error, gpointer data) {
    struct waiting *waiting = data;
    if (!picture)
        refuse(waiting->message, SOUP_STATUS_NOT_FOUND, error->message);
    else if (waiting->as_json)
        respond(waiting->message, SOUP_STATUS_OK, "application/json", picture->json);
    else
        respond_bytes(waiting->message, "image/png", picture->png);
    end_waiting(waiting);
}

/* Answers a request for cameras/NAME.png or cameras/NAME.json. Returns FALSE for any other path. */
static gboolean answer_picture(WebServer *server, SoupServerMessage *message, const char *what) {
    const gboolean png = g_str_has_suffix(what, ".png"), json = g_str_has_suffix(what, ".json");
    if (!g_str_has_prefix(what, "cameras/") || !(png || json))
        return FALSE;
    const char *name = what + strlen("cameras/");
    g_autofree char *camera = g_strndup(name, (gsize)(strrchr(name, '.') - name));
    if (!g_utf8_validate(camera, -1, NULL))
        return FALSE;
    struct waiting *waiting = begin_waiting(server, message);
    if (!waiting)
        return TRUE;
    waiting->as_json = json;
    web_rig_picture(server->rig, camera, on_picture, waiting);
    return TRUE;
}

static void on_texels(GBytes *picture, const GError *error, gpointer data) {
    struct waiting *waiting = data;
    if (picture)
        respond_bytes(waiting->message, "application/octet-stream", picture);
    else
        refuse(waiting->message, SOUP_STATUS_NOT_FOUND, error->message);
    end_waiting(waiting);
}

/* Answers a request for material or material/PAIR. Returns FALSE for any other path. */
static gboolean answer_material(WebServer *server, SoupServerMessage *message, const char *what) {
    guint64 pair;
    if (strcmp(what, "material") == 0) {
        g_autoptr(GError) error = NULL;
        g_autofree char *text = web_material_text(server->material, &error);
        if (text)
            respond(message, SOUP_STATUS_OK, "application/json", text);
        else
            refuse(message, SOUP_STATUS_NOT_FOUND, error->message);
        return TRUE;
    }
    if (!g_str_has_prefix(what, "material/") ||
        !g_ascii_string_to_unsigned(what + strlen("material/"), 10, 0, G_MAXINT, &pair, NULL))
        return FALSE;
    struct waiting *waiting = begin_waiting(server, message);
    if (waiting)
        web_material_picture(server->material, (int)pair, on_texels, waiting);
    return TRUE;
}

static void on_done(GVariant *answer, const GError *error, gpointer data) {
    struct waiting *waiting = data;
    if (error)
        refuse(waiting->message, SOUP_STATUS_CONFLICT, error->message);
    else
        respond(waiting->message, SOUP_STATUS_OK, "application/json", "{}\n");
    end_waiting(waiting);
}

static void do_action(WebServer *server, SoupServerMessage *message, const char *method) {
    struct waiting *waiting = begin_waiting(server, message);
    if (!waiting)
        return;
    web_visitor_set_phase(web_door_visitor(message), WEB_ACTS);
    web_rig_call(server->rig, method, on_done, waiting);
}

/* Returns the answer of SafeState as JSON: {"safe": …, "devices": [{"class": …, "name": …, "state":
 * …}, …]}. */
static char *safe_text(GVariant *answer) {
    GVariantBuilder to, devices;
    const char *class_name, *name, *state;
    gboolean safe;
    g_autoptr(GVariant) list = NULL;
    GVariantIter iter;
    g_variant_get(answer, "(b@a(sss))", &safe, &list);
    g_variant_builder_init(&devices, G_VARIANT_TYPE("aa{ss}"));
    g_variant_iter_init(&iter, list);
    while (g_variant_iter_next(&iter, "(&s&s&s)", &class_name, &name, &state)) {
        g_variant_builder_open(&devices, G_VARIANT_TYPE("a{ss}"));
        g_variant_builder_add(&devices, "{ss}", "class", class_name);
        g_variant_builder_add(&devices, "{ss}", "name", name);
        g_variant_builder_add(&devices, "{ss}", "state", state);
        g_variant_builder_close(&devices);
    }
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&to, "{sv}", "safe", g_variant_new_boolean(safe));
    g_variant_builder_add(&to, "{sv}", "devices", g_variant_builder_end(&devices));
    return json_text(g_variant_builder_end(&to));
}

static void ask_safe(WebServer *server);

static void on_safe(GVariant *answer, const GError *error, gpointer data) {
    g_autofree struct safe_call *call = data;
    WebServer *server = call->server;
    g_autofree char *text = answer && g_variant_is_of_type(answer, G_VARIANT_TYPE("(ba(sss))"))
                                ? safe_text(answer)
                                : g_strdup("{}\n");
    for (guint i = 0; i < call->asked->len; i++) {
        if (error)
            refuse(call->asked->pdata[i], SOUP_STATUS_CONFLICT, error->message);
        else
            respond(call->asked->pdata[i], SOUP_STATUS_OK, "application/json", text);
        go_on(g_object_ref(call->asked->pdata[i]));
    }
    g_ptr_array_unref(call->asked);
    if (!server)
        return;
    server->safe_call = NULL;
    if (server->safe_next)
        ask_safe(server);
}

static void ask_safe(WebServer *server) {
    struct safe_call *call = g_new(struct safe_call, 1);
    *call = (struct safe_call){server, g_steal_pointer(&server->safe_next)};
    server->safe_call = call;
    web_rig_call(server->rig, "SafeState", on_safe, call);
}

/* Answers a request for the safe state. Only one call of SafeState is under way at a time.
 * Requests that come meanwhile share the next call. */
static void answer_safe(WebServer *server, SoupServerMessage *message) {
    if (!server->safe_next)
        server->safe_next = g_ptr_array_new_with_free_func(g_object_unref);
    for (guint i = server->safe_next->len; i-- > 0;) /* drops messages whose connection has ended */
        if (!web_door_visitor(server->safe_next->pdata[i]))
            g_ptr_array_remove_index_fast(server->safe_next, i);
    soup_server_message_pause(message);
    web_visitor_set_phase(web_door_visitor(message), WEB_ACTS);
    g_ptr_array_add(server->safe_next, g_object_ref(message));
    if (!server->safe_call)
        ask_safe(server);
}

static void on_task(guint status, const char *type, GBytes *body, gpointer data) {
    struct waiting *waiting = data;
    respond_bytes(waiting->message, type, body);
    soup_server_message_set_status(waiting->message, status, NULL);
    if (g_str_has_prefix(type, "text/html"))
        confine(waiting->message);
    end_waiting(waiting);
}

static void do_task(WebServer *server, SoupServerMessage *message, const struct web_task_path *path,
                    const char *name, GHashTable *query) {
    struct waiting *waiting = begin_waiting(server, message);
    if (!waiting)
        return;
    if (path->acts)
        web_visitor_set_phase(web_door_visitor(message), WEB_ACTS);
    path->run(&(struct web_task){.rig = server->rig,
                                 .folder = server->sessions,
                                 .products = server->products,
                                 .calibrations = server->calibrations,
                                 .child = server->child,
                                 .snaps = server->snaps,
                                 .name = name,
                                 .query = query,
                                 .back = on_task,
                                 .data = waiting});
}

static void on_api(SoupServer *soup, SoupServerMessage *message, const char *path,
                   GHashTable *query, gpointer data) {
    static const char *const actions[][2] = {{"pause", "Pause"},
                                             {"continue", "Continue"},
                                             {"finish", "Finish"},
                                             {"abort", "Abort"},
                                             {"release", "Release"}};
    static const struct {
        const char *name;
        char *(*text)(const WebRig *rig);
    } shown[] = {{"state", web_rig_state}, {"log", web_rig_events}, {"progress", web_rig_progress}};
    WebServer *server = data;
    const char *what = g_str_has_prefix(path, API) ? path + strlen(API) : "";
    for (gsize i = 0; i < G_N_ELEMENTS(actions); i++)
        if (strcmp(what, actions[i][0]) == 0) {
            if (admit(server, message, ACCESS_TOKEN))
                do_action(server, message, actions[i][1]);
            return;
        }
    if (strcmp(what, "safe") == 0) {
        if (admit(server, message, ACCESS_SAFE))
            answer_safe(server, message);
        return;
    }
    g_autofree char *name = NULL;
    const struct web_task_path *task = web_tasks_find(what, &name);
    if (task) {
        if (admit(server, message, task->acts ? ACCESS_TOKEN : ACCESS_LOOK))
            do_task(server, message, task, name, query);
        return;
    }
    if (!admit(server, message, ACCESS_LOOK))
        return;
    for (gsize i = 0; i < G_N_ELEMENTS(shown); i++)
        if (strcmp(what, shown[i].name) == 0) {
            g_autofree char *text = shown[i].text(server->rig);
            respond(message, SOUP_STATUS_OK, "application/json", text);
            return;
        }
    if (strcmp(what, "access") == 0) {
        g_autofree char *text = g_strdup_printf("{\"acts\": %s, \"safe_needs_token\": %s}",
                                                server->token ? "true" : "false",
                                                server->safe_needs_token ? "true" : "false");
        respond(message, SOUP_STATUS_OK, "application/json", text);
        return;
    }
    if (strcmp(what, "openapi.json") == 0)
        respond_file(message, what, "application/json");
    else if (strcmp(what, "events") == 0 &&
             strcmp(soup_server_message_get_method(message), "GET") == 0)
        open_stream(server, message);
    else if (!answer_material(server, message, what) && !answer_picture(server, message, what))
        refuse(message, SOUP_STATUS_NOT_FOUND,
               "this path does not exist; docs/operate/web.md lists the paths");
}

/* Adds the origins of the server's names. Fails if a value of --host is not a name. */
static gboolean add_origins(WebServer *server, const struct web_options *options, GError **error) {
    static const char *const local[] = {"localhost", "127.0.0.1", "[::1]"};
    const guint port = web_door_port(server->door);
    for (gsize i = 0; i < G_N_ELEMENTS(local); i++)
        g_ptr_array_add(server->origins, web_origin_of_option(local[i], port));
    for (int i = 0; options->hosts && options->hosts[i]; i++) {
        char *origin = web_origin_of_option(options->hosts[i], port);
        if (!origin) {
            g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                        "--host %s is not the name of a server; write NAME, NAME:PORT, or "
                        "https://NAME behind a proxy with TLS",
                        options->hosts[i]);
            return FALSE;
        }
        g_ptr_array_add(server->origins, origin);
    }
    return TRUE;
}

WebServer *web_server_new(WebRig *rig, const struct web_options *options, GError **error) {
    WebServer *server = g_new0(WebServer, 1);
    server->rig = rig;
    server->token = g_strdup(options->token);
    server->safe_needs_token = options->safe_needs_token;
    server->sessions = g_strdup(options->sessions);
    server->snaps = web_snaps_new();
    server->products = web_products_new();
    server->calibrations = web_calibrations_new();
    server->child = web_child_new();
    server->calls = g_rc_box_new0(int);
    server->address = g_strdup(options->address ? options->address : "127.0.0.1");
    server->origins = g_ptr_array_new_with_free_func(g_free);
    server->streams = g_ptr_array_new_with_free_func(stream_free);
    server->soup = soup_server_new("server-header", "mesorig-web", NULL);
    soup_server_add_handler(server->soup, "/", on_page, server, NULL);
    soup_server_add_handler(server->soup, API, on_api, server, NULL);
    g_signal_connect(server->soup, "request-started", G_CALLBACK(on_request), server);
    g_signal_connect(server->soup, "request-read", G_CALLBACK(on_request_read), server);
    server->material = web_material_new(on_material, server);
    web_material_follow(server->material, web_rig_session(rig));
    web_rig_listen(rig, on_news, server);
    server->keep_alive_id = g_timeout_add_seconds(KEEP_ALIVE_S, keep_alive, server);
    server->door = web_door_new(server->soup, options->address, options->port, error);
    if (server->door && add_origins(server, options, error))
        return server;
    web_server_free(server);
    return NULL;
}

void web_server_free(WebServer *server) {
    if (!server)
        return;
    web_rig_listen(server->rig, NULL, NULL);
    web_material_free(server->material);
    g_source_remove(server->keep_alive_id);
    while (server->streams->len > 0) {
        struct stream *stream = server->streams->pdata[0];
        on_stream_finished(stream->message, stream);
    }
    web_door_free(server->door);
    if (server->safe_call)
        server->safe_call->server = NULL;
    g_rc_box_release(server->calls);
    g_clear_pointer(&server->safe_next, g_ptr_array_unref);
    g_object_unref(server->soup);
    g_ptr_array_unref(server->streams);
    g_ptr_array_unref(server->origins);
    web_snaps_unref(server->snaps);
    web_child_free(server->child);
    web_products_free(server->products);
    web_calibrations_free(server->calibrations);
    g_free(server->sessions);
    g_free(server->address);
    g_free(server->token);
    g_free(server);
}

char *web_server_uri(const WebServer *server) {
    const char *form = strchr(server->address, ':') ? "http://[%s]:%u/" : "http://%s:%u/";
    return g_strdup_printf(form, server->address, web_door_port(server->door));
}
