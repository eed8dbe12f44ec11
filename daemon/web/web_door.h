/*
 * Accepts the connections of the web server, gives them to libsoup, and limits their number and
 * their duration, because libsoup has no such limits. libsoup gets a connection when the head of
 * its request (request line and headers) is complete and has no mistake, because libsoup 3.2 leaks
 * memory with each request whose length is malformed. A connection carries one request.
 *
 * A peer is an IPv4 address, or the first 64 bits of an IPv6 address, because one computer may use
 * all addresses with the same first 64 bits. A new connection is always accepted. If there are too
 * many connections, one connection of the peer that has the most is closed. Among the connections
 * of that peer, it is the oldest one in the lowest phase (enum web_phase). A request that is sent
 * promptly is therefore answered, no matter how many connections other peers hold open.
 *
 * All functions belong to the main loop's thread.
 */
#pragma once

#include <libsoup/soup.h>

#define WEB_DOOR_PEER_CONNECTIONS 64
#define WEB_DOOR_CONNECTIONS      256
#define WEB_DOOR_PEER_STREAMS     16
#define WEB_DOOR_STREAMS          64
#define WEB_DOOR_MAX_HEAD         (64 << 10) /* bytes of request line and headers */
#define WEB_DOOR_MAX_READ         (64 << 10) /* bytes of the body of a request */
/* time limit from the connection to the end of the request */
#define WEB_DOOR_REQUEST_S 10
/* time limit from the end of the request to the end of the answer */
#define WEB_DOOR_ANSWER_S      90
#define WEB_DOOR_MAX_PENALTY_S 60  /* longest wait after wrong tokens */
#define WEB_DOOR_FORGIVEN_S    900 /* time after which a peer's wrong tokens are forgotten */

/* The phases of a connection, the lowest first. Connections in lower phases are closed first. */
enum web_phase {
    WEB_ASKS,    /* the request is not complete; limited to WEB_DOOR_REQUEST_S */
    WEB_READS,   /* the answer is made or sent; limited to WEB_DOOR_ANSWER_S */
    WEB_STREAMS, /* the connection receives events, without a time limit */
    WEB_ACTS,    /* the daemon carries out the request; limited to WEB_DOOR_ANSWER_S */
};

typedef struct WebDoor WebDoor;
typedef struct WebVisitor WebVisitor; /* a connection */

/* Listens on an IP address and a port. If address is NULL, listens only on the loopback addresses
 * of IPv4 and, if the computer has it, IPv6. Port 0 means any free port. soup is not owned and must
 * live longer than the door. Returns NULL with an error if it cannot listen. */
WebDoor *web_door_new(SoupServer *soup, const char *address, guint port, GError **error);
void web_door_free(WebDoor *door); /* NULL is ignored; closes all connections */

guint web_door_port(const WebDoor *door);

/* Returns the connection of a message. Returns NULL if the connection has ended; the message must
 * then not be unpaused. */
WebVisitor *web_door_visitor(SoupServerMessage *message);

/* Call it once for each message of the SoupServer, before any other function. It makes libsoup drop
 * the request's body, and closes the connection if the body has more than WEB_DOOR_MAX_READ
 * bytes. */
void web_visitor_begin(WebVisitor *visitor, SoupServerMessage *message);

void web_visitor_set_phase(WebVisitor *visitor, enum web_phase phase);

/* Sets the phase to WEB_STREAMS. If WEB_DOOR_STREAMS streams are already open, closes a stream of a
 * peer that has more streams than the peer of this connection. Returns FALSE and changes nothing if
 * no peer has more streams, or if the peer of this connection already has WEB_DOOR_PEER_STREAMS. */
gboolean web_visitor_stream(WebVisitor *visitor);

/* Closes the connection. status is an HTTP status such as "408 Request Timeout". It is sent before
 * the connection is closed if no answer has begun. If status is NULL, nothing is sent. */
void web_visitor_close(WebVisitor *visitor, const char *status);

/* Returns the number of seconds until the peer of this connection may send a token again, or 0 if
 * it may send one now. After n wrong tokens in a row a peer waits 2^n / 8 s, and at most
 * WEB_DOOR_MAX_PENALTY_S. */
double web_visitor_penalty_s(const WebVisitor *visitor);
/* Records that the peer has sent a token, and whether the token was right. */
void web_visitor_token(WebVisitor *visitor, gboolean right);
