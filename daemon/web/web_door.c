#include "web_door.h"

#include "web_log.h"

#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>

#define BACKLOG     128         /* connections that wait to be accepted */
#define SEND_BUFFER (256 << 10) /* bytes that the kernel buffers for a client that reads slowly */
/* Time after which a connection whose peer acknowledges no bytes is closed. */
#define READER_GONE_MS  60000
#define LOOK_MS         500  /* time between two checks of the time limits */
#define ACCEPT_AGAIN_MS 200  /* pause after an accept() that failed */
#define MAX_PEERS       1024 /* number of peers from which on forget_peers() is called */
/* maximum number of attempts to find a port that is free on both loopback addresses */
#define FREE_PORTS 8

struct peer {
    char *name;
    int connections, streams;
    int failures; /* wrong tokens in a row */
    gint64 failed_us, allowed_us;
    /* time of the last log line that the peer has too many connections; 0 if there was none */
    gint64 told_us;
};

struct WebVisitor {
    WebDoor *door;
    struct peer *peer; /* NULL after leave() */
    GSocket *socket;
    SoupServerMessage *message; /* not owned; NULL before the message begins and after it ends */
    enum web_phase phase;
    gint64 since_us; /* beginning of the phase */
    gsize read;      /* bytes of the request's body */
    gboolean answering, closing;
    /* waits for the head of the request or for the end of a stream; NULL if neither */
    GSource *watch;
    GIOStream *stream; /* NULL after libsoup has taken it */
};

struct WebDoor {
    SoupServer *soup;
    GPtrArray *listeners; /* of GSocket */
    GPtrArray *sources;   /* of GSource, one for each listener */
    /* visitors that have not left (leave()); each is freed with its stream */
    GPtrArray *visitors;
    GHashTable *peers; /* name → struct peer */
    guint look_id, again_id;
    int streams;
    /* time of the last log line that all peers have too many connections; 0 if there was none */
    gint64 told_us;
};

static void listen_again(WebDoor *door);

static void peer_free(gpointer data) {
    struct peer *peer = data;
    g_free(peer->name);
    g_free(peer);
}

static char *peer_name(GSocketAddress *address) {
    GInetAddress *inet = g_inet_socket_address_get_address(G_INET_SOCKET_ADDRESS(address));
    const guint8 *bytes = g_inet_address_to_bytes(inet);
    static const guint8 mapped[12] = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
    if (g_inet_address_get_family(inet) != G_SOCKET_FAMILY_IPV6)
        return g_inet_address_to_string(inet);
    if (memcmp(bytes, mapped, sizeof mapped) == 0) {
        g_autoptr(GInetAddress) inner =
            g_inet_address_new_from_bytes(bytes + sizeof mapped, G_SOCKET_FAMILY_IPV4);
        return g_inet_address_to_string(inner);
    }
    guint8 network[16] = {0};
    memcpy(network, bytes, 8);
    g_autoptr(GInetAddress) first = g_inet_address_new_from_bytes(network, G_SOCKET_FAMILY_IPV6);
    g_autofree char *text = g_inet_address_to_string(first);
    return g_strconcat(text, "/64", NULL);
}

static gboolean is_forgiven(const struct peer *peer) {
    return peer->failures == 0 ||
           g_get_monotonic_time() - peer->failed_us > WEB_DOOR_FORGIVEN_S * G_USEC_PER_SEC;
}

/* Forgets the peers without connections whose wrong tokens are forgiven. If there are still too
 * many peers, also forgets the peer without connections whose last wrong token is the oldest. */
static void forget_peers(WebDoor *door) {
    GHashTableIter iter;
    gpointer value;
    const struct peer *oldest = NULL;
    g_hash_table_iter_init(&iter, door->peers);
    while (g_hash_table_iter_next(&iter, NULL, &value)) {
        const struct peer *peer = value;
        if (peer->connections == 0 && is_forgiven(peer))
            g_hash_table_iter_remove(&iter);
        else if (peer->connections == 0 && (!oldest || peer->failed_us < oldest->failed_us))
            oldest = peer;
    }
    if (oldest && g_hash_table_size(door->peers) >= MAX_PEERS)
        g_hash_table_remove(door->peers, oldest->name);
}

static struct peer *find_peer(WebDoor *door, GSocketAddress *address) {
    g_autofree char *name = peer_name(address);
    struct peer *peer = g_hash_table_lookup(door->peers, name);
    if (!peer) {
        if (g_hash_table_size(door->peers) >= MAX_PEERS)
            forget_peers(door);
        peer = g_new0(struct peer, 1);
        peer->name = g_steal_pointer(&name);
        g_hash_table_insert(door->peers, peer->name, peer);
    }
    return peer;
}

static void source_free(gpointer data) {
    g_source_destroy(data);
    g_source_unref(data);
}

static void visitor_free(WebVisitor *visitor) {
    g_clear_pointer(&visitor->watch, source_free);
    g_clear_weak_pointer(&visitor->message);
    g_object_unref(visitor->socket);
    g_free(visitor);
}

/* Removes a connection from the list and the counts when libsoup closes the connection or has
 * closed it. Does nothing the second time. */
static void leave(WebVisitor *visitor) {
    WebDoor *door = visitor->door;
    struct peer *peer = g_steal_pointer(&visitor->peer);
    if (!peer)
        return;
    peer->connections--;
    if (visitor->phase == WEB_STREAMS) {
        peer->streams--;
        door->streams--;
    }
    g_clear_pointer(&visitor->watch, source_free);
    g_ptr_array_remove_fast(door->visitors, visitor);
    if (peer->connections == 0 && is_forgiven(peer))
        g_hash_table_remove(door->peers, peer->name);
}

/* Called when the stream of a connection was freed. This may be some time after the end of the
 * connection, because a reference to the message keeps the stream alive. */
static void on_stream_gone(gpointer data, GObject *stream) {
    leave(data);
    visitor_free(data);
}

static void on_headers_written(SoupServerMessage *message, gpointer data) {
    ((WebVisitor *)data)->answering = TRUE;
}

static void on_finished(SoupServerMessage *message, gpointer data) {
    leave(data);
}

WebVisitor *web_door_visitor(SoupServerMessage *message) {
    GSocketAddress *remote = soup_server_message_get_remote_address(message);
    WebVisitor *visitor = remote ? g_object_get_data(G_OBJECT(remote), "visitor") : NULL;
    return visitor && visitor->peer ? visitor : NULL;
}

static void on_chunk(SoupServerMessage *message, GBytes *chunk, gpointer data) {
    WebVisitor *visitor = data;
    visitor->read += g_bytes_get_size(chunk);
    if (visitor->read > WEB_DOOR_MAX_READ)
        web_visitor_close(visitor, "413 Content Too Large");
}

void web_visitor_begin(WebVisitor *visitor, SoupServerMessage *message) {
    g_set_weak_pointer(&visitor->message, message);
    soup_message_body_set_accumulate(soup_server_message_get_request_body(message), FALSE);
    g_signal_connect(message, "got-chunk", G_CALLBACK(on_chunk), visitor);
    g_signal_connect(message, "wrote-headers", G_CALLBACK(on_headers_written), visitor);
    g_signal_connect(message, "finished", G_CALLBACK(on_finished), visitor);
}

void web_visitor_set_phase(WebVisitor *visitor, enum web_phase phase) {
    visitor->phase = phase;
    visitor->since_us = g_get_monotonic_time();
}

void web_visitor_close(WebVisitor *visitor, const char *status) {
    if (visitor->closing)
        return;
    visitor->closing = TRUE;
    if (status && !visitor->answering) {
        g_autofree char *answer = g_strdup_printf(
            "HTTP/1.1 %s\r\nConnection: close\r\nContent-Length: 0\r\n\r\n", status);
        g_socket_send_with_blocking(visitor->socket, answer, strlen(answer), FALSE, NULL, NULL);
    }
    /* on_head() and libsoup notice the shutdown when they read or write, and close the connection.
     * A paused message does neither, so it is unpaused. */
    g_socket_shutdown(visitor->socket, TRUE, TRUE, NULL);
    if (!visitor->message || visitor->phase == WEB_ASKS)
        return;
    if (visitor->phase == WEB_STREAMS) /* gives libsoup something to write, which fails */
        soup_message_body_append(soup_server_message_get_response_body(visitor->message),
                                 SOUP_MEMORY_STATIC, "\n", 1);
    soup_server_message_unpause(visitor->message);
}

/* Returns whether connection a is to be closed before connection b. */
static gboolean is_less(const WebVisitor *a, const WebVisitor *b) {
    if (a->peer->connections != b->peer->connections)
        return a->peer->connections > b->peer->connections;
    if (a->phase != b->phase)
        return a->phase < b->phase;
    return a->since_us < b->since_us;
}

/* Closes one connection of this peer, or of any peer if peer is NULL, to make room for a new
 * one. */
static void make_room(WebDoor *door, const struct peer *peer) {
    WebVisitor *least = NULL;
    for (guint i = 0; i < door->visitors->len; i++) {
        WebVisitor *visitor = door->visitors->pdata[i];
        if (!visitor->closing && (!peer || visitor->peer == peer) &&
            (!least || is_less(visitor, least)))
            least = visitor;
    }
    if (!least)
        return;
    gint64 *told_us = peer ? &least->peer->told_us : &door->told_us;
    const gint64 now_us = g_get_monotonic_time();
    if (*told_us == 0 || now_us - *told_us > 60 * G_USEC_PER_SEC) {
        g_autofree char *whose =
            peer ? g_strconcat(peer->name, " has", NULL) : g_strdup("all peers together have");
        *told_us = now_us;
        web_log("%s %u connections, which is the maximum; an old one is closed for each new one",
                whose, peer ? (guint)peer->connections : door->visitors->len);
    }
    web_visitor_close(least, "503 Service Unavailable");
}

/* Closes the connections that have exceeded their time limit. */
static gboolean look(gpointer data) {
    WebDoor *door = data;
    const gint64 now_us = g_get_monotonic_time();
    for (guint i = 0; i < door->visitors->len; i++) {
        WebVisitor *visitor = door->visitors->pdata[i];
        const int limit_s = visitor->phase == WEB_ASKS ? WEB_DOOR_REQUEST_S : WEB_DOOR_ANSWER_S;
        if (visitor->phase != WEB_STREAMS && now_us - visitor->since_us > limit_s * G_USEC_PER_SEC)
            web_visitor_close(visitor, visitor->phase == WEB_ASKS ? "408 Request Timeout"
                                                                  : "504 Gateway Timeout");
    }
    if (door->visitors->len > 0)
        return G_SOURCE_CONTINUE;
    door->look_id = 0;
    return G_SOURCE_REMOVE;
}

/* Returns the length of the head of a request, without the empty line at its end. Returns 0 if the
 * head is not complete. libsoup finds the same end: it accepts an empty line from the third byte
 * on. */
static gsize head_length(const char *text, gsize n) {
    const char *line = text;
    for (const char *end; (end = memchr(line, '\n', n - (gsize)(line - text))); line = end + 1) {
        const gsize before = (gsize)(line - text), length = (gsize)(end - line) + 1;
        if ((length == 1 && before >= 2) || (length == 2 && *line == '\r' && before >= 3))
            return before;
    }
    return 0;
}

/* Returns the status with which a head is refused, or NULL if libsoup may get it. libsoup 3.2 does
 * not free the path of a request whose length it cannot read, or whose Host contains a slash. */
static const char *refuse_head(const char *text, gsize n) {
    SoupMessageHeaders *headers = soup_message_headers_new(SOUP_MESSAGE_HEADERS_REQUEST);
    g_autofree char *method = NULL, *path = NULL;
    SoupHTTPVersion version;
    const char *ret = NULL;
    if (soup_headers_parse_request(text, (int)n, headers, &method, &path, &version) !=
        SOUP_STATUS_OK) {
        ret = "400 Bad Request";
    } else if (soup_message_headers_get_encoding(headers) == SOUP_ENCODING_UNRECOGNIZED) {
        ret = soup_message_headers_get_list(headers, "Transfer-Encoding") ? "501 Not Implemented"
                                                                          : "400 Bad Request";
    } else {
        const char *host = soup_message_headers_get_one(headers, "Host");
        ret = host && strchr(host, '/') ? "400 Bad Request" : NULL;
    }
    soup_message_headers_unref(headers);
    return ret;
}

static gboolean is_at_end(int fd) {
    struct pollfd at = {.fd = fd, .events = POLLRDHUP};
    return poll(&at, 1, 0) > 0;
}

/* Sends a status and closes the connection. First reads the n bytes that were peeked at, because
 * the kernel may discard the answer if a socket is closed with unread bytes. Releases the stream,
 * which frees the visitor. */
static void turn_away(WebVisitor *visitor, const char *status, char *text, gsize n) {
    g_autoptr(GIOStream) stream = g_steal_pointer(&visitor->stream);
    if (recv(g_socket_get_fd(visitor->socket), text, n, MSG_DONTWAIT) > 0)
        web_visitor_close(visitor, status);
}

/* Called when bytes have arrived. Peeks at them. When the head of the request is complete, gives
 * the connection to libsoup, or refuses it if the head has a mistake, is too large or will not
 * become complete. */
static gboolean on_head(GSocket *socket, GIOCondition condition, gpointer data) {
    WebVisitor *visitor = data;
    const int fd = g_socket_get_fd(socket);
    if (visitor->closing) { /* a complete head must not be given to libsoup any more */
        g_clear_pointer(&visitor->watch, source_free);
        g_clear_object(&visitor->stream);
        return G_SOURCE_REMOVE;
    }
    g_autofree char *text = g_malloc(WEB_DOOR_MAX_HEAD + 1);
    const gssize got = recv(fd, text, WEB_DOOR_MAX_HEAD, MSG_PEEK | MSG_DONTWAIT);
    if (got < 0 && (errno == EAGAIN || errno == EINTR))
        return G_SOURCE_CONTINUE;
    const gsize n = got > 0 ? (gsize)got : 0, head = head_length(text, n);
    if (head == 0 && n > 0 && n < WEB_DOOR_MAX_HEAD && !is_at_end(fd)) {
        /* Without this, the incomplete head would wake this function again and again. */
        g_socket_set_option(socket, SOL_SOCKET, SO_RCVLOWAT, (int)n + 1, NULL);
        return G_SOURCE_CONTINUE;
    }
    text[head] = '\0';
    const char *refused = head > 0                 ? refuse_head(text, head)
                          : n == WEB_DOOR_MAX_HEAD ? "431 Request Header Fields Too Large"
                                                   : "400 Bad Request";
    g_clear_pointer(&visitor->watch, source_free);
    if (refused) {
        turn_away(visitor, refused, text, n);
        return G_SOURCE_REMOVE;
    }
    g_autoptr(GIOStream) stream = g_steal_pointer(&visitor->stream);
    g_autoptr(GSocketAddress) remote = g_socket_get_remote_address(socket, NULL);
    g_autoptr(GSocketAddress) local = g_socket_get_local_address(socket, NULL);
    if (!remote || !local) /* the peer has closed the connection already */
        return G_SOURCE_REMOVE;
    g_socket_set_option(socket, SOL_SOCKET, SO_RCVLOWAT, 1, NULL);
    g_object_set_data(G_OBJECT(remote), "visitor", visitor);
    soup_server_accept_iostream(visitor->door->soup, stream, local, remote, NULL);
    return G_SOURCE_REMOVE;
}

static void count_in(WebDoor *door, GSocket *socket) {
    g_autoptr(GSocketAddress) remote = g_socket_get_remote_address(socket, NULL);
    if (!remote) /* the peer has closed the connection already */
        return;
    struct peer *peer = find_peer(door, remote);
    if (peer->connections >= WEB_DOOR_PEER_CONNECTIONS)
        make_room(door, peer);
    else if (door->visitors->len >= WEB_DOOR_CONNECTIONS)
        make_room(door, NULL);
    g_socket_set_blocking(socket, FALSE);
    g_socket_set_option(socket, IPPROTO_TCP, TCP_NODELAY, TRUE, NULL);
    g_socket_set_option(socket, IPPROTO_TCP, TCP_USER_TIMEOUT, READER_GONE_MS, NULL);
    g_socket_set_option(socket, SOL_SOCKET, SO_SNDBUF, SEND_BUFFER, NULL);
    GSocketConnection *stream = g_socket_connection_factory_create_connection(socket);
    WebVisitor *visitor = g_new0(WebVisitor, 1);
    visitor->door = door;
    visitor->stream = G_IO_STREAM(stream);
    visitor->peer = peer;
    visitor->socket = g_object_ref(socket);
    visitor->since_us = g_get_monotonic_time();
    peer->connections++;
    g_ptr_array_add(door->visitors, visitor);
    g_object_weak_ref(G_OBJECT(stream), on_stream_gone, visitor);
    if (!door->look_id)
        door->look_id = g_timeout_add(LOOK_MS, look, door);
    visitor->watch = g_socket_create_source(socket, G_IO_IN | G_IO_HUP, NULL);
    g_source_set_callback(visitor->watch, G_SOURCE_FUNC(on_head), visitor, NULL);
    g_source_attach(visitor->watch, NULL);
}

static gboolean accept_again(gpointer data) {
    WebDoor *door = data;
    door->again_id = 0;
    listen_again(door);
    return G_SOURCE_REMOVE;
}

static gboolean on_connection(GSocket *listener, GIOCondition condition, gpointer data) {
    WebDoor *door = data;
    g_autoptr(GError) error = NULL;
    g_autoptr(GSocket) socket = g_socket_accept(listener, NULL, &error);
    if (socket) {
        count_in(door, socket);
    } else if (!g_error_matches(error, G_IO_ERROR, G_IO_ERROR_WOULD_BLOCK) && !door->again_id) {
        /* If, for instance, no file descriptor is left, the listening socket stays ready, which
         * would make the main loop spin. No listening socket is therefore watched for
         * ACCEPT_AGAIN_MS. */
        web_log("cannot accept a connection: %s", error->message);
        g_ptr_array_set_size(door->sources, 0);
        door->again_id = g_timeout_add(ACCEPT_AGAIN_MS, accept_again, door);
    }
    return G_SOURCE_CONTINUE;
}

static void listen_again(WebDoor *door) {
    for (guint i = 0; i < door->listeners->len; i++) {
        GSource *source = g_socket_create_source(door->listeners->pdata[i], G_IO_IN, NULL);
        g_source_set_callback(source, G_SOURCE_FUNC(on_connection), door, NULL);
        g_source_attach(source, NULL);
        g_ptr_array_add(door->sources, source);
    }
}

static GSocket *listen_at(GSocketAddress *address, GError **error) {
    const GSocketFamily family = g_socket_address_get_family(address);
    g_autoptr(GSocket) socket =
        g_socket_new(family, G_SOCKET_TYPE_STREAM, G_SOCKET_PROTOCOL_TCP, error);
    if (!socket)
        return NULL;
    g_socket_set_blocking(socket, FALSE);
    g_socket_set_listen_backlog(socket, BACKLOG);
    if (family == G_SOCKET_FAMILY_IPV6)
        g_socket_set_option(socket, IPPROTO_IPV6, IPV6_V6ONLY, TRUE, NULL);
    if (!g_socket_bind(socket, address, TRUE, error) || !g_socket_listen(socket, error)) {
        g_autofree char *text = g_socket_connectable_to_string(G_SOCKET_CONNECTABLE(address));
        g_prefix_error(error, "cannot listen on %s (choose another --port or --listen): ", text);
        return NULL;
    }
    return g_steal_pointer(&socket);
}

static gboolean add_listener(WebDoor *door, const char *ip, guint port, GError **error) {
    g_autoptr(GSocketAddress) address = g_inet_socket_address_new_from_string(ip, port);
    if (!address) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "cannot listen on %s, because it is not an IP address; use 0.0.0.0 for all "
                    "IPv4 addresses of this machine",
                    ip);
        return FALSE;
    }
    GSocket *socket = listen_at(address, error);
    if (socket)
        g_ptr_array_add(door->listeners, socket);
    return socket != NULL;
}

/* Listens on the loopback addresses of IPv4 and IPv6 with the same port. If the port is in use on
 * the IPv6 address, tries another port or, if the port is given, fails. If the IPv6 address cannot
 * be used for another reason, listens only on that of IPv4. */
static gboolean add_loopback(WebDoor *door, guint port, GError **error) {
    for (int i = 0;; i++) {
        g_autoptr(GError) why = NULL;
        g_ptr_array_set_size(door->listeners, 0);
        if (!add_listener(door, "127.0.0.1", port, error))
            return FALSE;
        if (add_listener(door, "::1", web_door_port(door), &why) ||
            !g_error_matches(why, G_IO_ERROR, G_IO_ERROR_ADDRESS_IN_USE))
            return TRUE;
        if (port != 0 || i + 1 == FREE_PORTS) {
            g_propagate_error(error, g_steal_pointer(&why));
            return FALSE;
        }
    }
}

WebDoor *web_door_new(SoupServer *soup, const char *address, guint port, GError **error) {
    WebDoor *door = g_new0(WebDoor, 1);
    door->soup = soup;
    door->listeners = g_ptr_array_new_with_free_func(g_object_unref);
    door->sources = g_ptr_array_new_with_free_func(source_free);
    door->visitors = g_ptr_array_new();
    door->peers = g_hash_table_new_full(g_str_hash, g_str_equal, NULL, peer_free);
    if (address ? add_listener(door, address, port, error) : add_loopback(door, port, error)) {
        listen_again(door);
        return door;
    }
    web_door_free(door);
    return NULL;
}

void web_door_free(WebDoor *door) {
    if (!door)
        return;
    g_clear_handle_id(&door->again_id, g_source_remove);
    g_clear_handle_id(&door->look_id, g_source_remove);
    g_ptr_array_unref(door->sources);
    g_ptr_array_unref(door->listeners);
    for (guint i = 0; i < door->visitors->len; i++)
        web_visitor_close(door->visitors->pdata[i], NULL);
    /* Lets libsoup close the connections. */
    while (door->visitors->len > 0 && g_main_context_iteration(NULL, FALSE))
        ;
    while (door->visitors->len > 0) {
        WebVisitor *visitor = door->visitors->pdata[0];
        leave(visitor);
        g_clear_object(&visitor->stream);
    }
    g_ptr_array_unref(door->visitors);
    g_hash_table_unref(door->peers);
    g_free(door);
}

guint web_door_port(const WebDoor *door) {
    g_autoptr(GSocketAddress) address = g_socket_get_local_address(door->listeners->pdata[0], NULL);
    return address ? g_inet_socket_address_get_port(G_INET_SOCKET_ADDRESS(address)) : 0;
}

/* Returns the stream that is closed to make room for a new stream of this peer: the oldest stream
 * of the peer that has the most. Returns NULL if no peer has at least two streams more than this
 * peer, so that the other peer never has fewer afterwards. */
static WebVisitor *find_stream(WebDoor *door, const struct peer *peer) {
    WebVisitor *found = NULL;
    for (guint i = 0; i < door->visitors->len; i++) {
        WebVisitor *visitor = door->visitors->pdata[i];
        if (visitor->phase != WEB_STREAMS || visitor->closing ||
            visitor->peer->streams <= peer->streams + 1)
            continue;
        if (!found || visitor->peer->streams > found->peer->streams ||
            (visitor->peer->streams == found->peer->streams && visitor->since_us < found->since_us))
            found = visitor;
    }
    return found;
}

/* Closes a stream whose client has gone. libsoup does not notice the end of a connection while it
 * has nothing to write. */
static gboolean on_stream_readable(GSocket *socket, GIOCondition condition, gpointer data) {
    web_visitor_close(data, NULL);
    return G_SOURCE_REMOVE;
}

gboolean web_visitor_stream(WebVisitor *visitor) {
    WebDoor *door = visitor->door;
    if (visitor->peer->streams >= WEB_DOOR_PEER_STREAMS)
        return FALSE;
    if (door->streams >= WEB_DOOR_STREAMS) {
        WebVisitor *other = find_stream(door, visitor->peer);
        if (!other)
            return FALSE;
        web_visitor_close(other, NULL);
    }
    web_visitor_set_phase(visitor, WEB_STREAMS);
    visitor->peer->streams++;
    door->streams++;
    visitor->watch = g_socket_create_source(visitor->socket, G_IO_IN | G_IO_HUP, NULL);
    g_source_set_callback(visitor->watch, G_SOURCE_FUNC(on_stream_readable), visitor, NULL);
    g_source_attach(visitor->watch, NULL);
    return TRUE;
}

double web_visitor_penalty_s(const WebVisitor *visitor) {
    const gint64 left_us = visitor->peer->allowed_us - g_get_monotonic_time();
    return left_us > 0 ? (double)left_us / G_USEC_PER_SEC : 0;
}

void web_visitor_token(WebVisitor *visitor, gboolean right) {
    struct peer *peer = visitor->peer;
    if (right) {
        peer->failures = 0;
        return;
    }
    if (is_forgiven(peer))
        peer->failures = 0;
    peer->failures++;
    const double wait_s = MIN((double)(1 << MIN(peer->failures, 20)) / 8, WEB_DOOR_MAX_PENALTY_S);
    peer->failed_us = g_get_monotonic_time();
    peer->allowed_us = peer->failed_us + (gint64)(wait_s * G_USEC_PER_SEC);
    web_log("%s has sent a wrong token, number %d in a row; its next token is accepted in %g s",
            peer->name, peer->failures, wait_s);
}
