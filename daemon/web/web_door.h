/*
 * Who may come in. Accepts connections, gives them to libsoup, and closes those that take too long
 * or are too many. libsoup itself has no limit of this kind. libsoup gets a connection when the
 * head of its request (request line and headers) is complete and has no mistake: libsoup 3.2 loses
 * memory with each request whose length is malformed.
 *
 * A peer is an IPv4 address, or the first 64 bits of an IPv6 address, since one computer may use
 * all addresses below these. A new connection is always accepted: when there are too many, another
 * one is closed for it, of the peer that has most, and the one that is least worth keeping. So a
 * request that comes promptly is answered whatever others hold open. A connection carries one
 * request.
 *
 * One thread, the one that runs the main loop.
 */
#pragma once

#include <libsoup/soup.h>

#define WEB_DOOR_PEER_CONNECTIONS 64
#define WEB_DOOR_CONNECTIONS      256
#define WEB_DOOR_PEER_STREAMS     16
#define WEB_DOOR_STREAMS          64
#define WEB_DOOR_MAX_HEAD         (64 << 10) /* bytes of request line and headers */
#define WEB_DOOR_MAX_READ         (64 << 10)
#define WEB_DOOR_REQUEST_S        10  /* from the connection to the last byte of the request */
#define WEB_DOOR_ANSWER_S         90  /* from there to the last byte of the answer */
#define WEB_DOOR_MAX_PENALTY_S    60  /* after wrong tokens */
#define WEB_DOOR_FORGIVEN_S       900 /* after the last of them */

/* What a connection does, least worth keeping first. */
enum web_phase {
    WEB_ASKS,    /* its request is not complete; within WEB_DOOR_REQUEST_S */
    WEB_READS,   /* an answer is made or sent; within WEB_DOOR_ANSWER_S */
    WEB_STREAMS, /* it gets events, for as long as it likes */
    WEB_ACTS,    /* the daemon does what it has asked for; within WEB_DOOR_ANSWER_S */
};

typedef struct WebDoor WebDoor;
typedef struct WebVisitor WebVisitor; /* a connection */

/* Listens on an IP address (NULL: loopback only, IPv4 and, where there is one, IPv6) and port (0:
 * any that is free). Borrows soup, which must outlive it. */
WebDoor *web_door_new(SoupServer *soup, const char *address, guint port, GError **error);
void web_door_free(WebDoor *door); /* NULL is ignored; closes all connections */

guint web_door_port(const WebDoor *door);

/* The connection of a message; NULL: it has ended, and the message must not be unpaused. */
WebVisitor *web_door_visitor(SoupServerMessage *message);

/* To be called once for each message of the SoupServer, before anything is done with it. The body
 * of its request is dropped, and the connection closed after WEB_DOOR_MAX_READ bytes of it. */
void web_visitor_begin(WebVisitor *visitor, SoupServerMessage *message);

void web_visitor_set_phase(WebVisitor *visitor, enum web_phase phase);

/* Sets the phase to WEB_STREAMS. FALSE: too many streams are open; nothing has changed. */
gboolean web_visitor_stream(WebVisitor *visitor);

/* Closes the connection. status: a line such as "408 Request Timeout", which is sent if no answer
 * has begun; NULL: none. */
void web_visitor_close(WebVisitor *visitor, const char *status);

/* Seconds until this peer may send a token again; 0: now. After n wrong tokens in a row it waits
 * 2^n / 8 s, WEB_DOOR_MAX_PENALTY_S at most. */
double web_visitor_penalty_s(const WebVisitor *visitor);
void web_visitor_token(WebVisitor *visitor, gboolean right);
