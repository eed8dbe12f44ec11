/*
 * The JSON interface of WLED, by HTTP in a thread. One request is under way at a time. Only the
 * main thread may call the functions.
 */
#pragma once

#include <glib.h>

typedef struct WledHttp WledHttp;

struct wled_answer {
    gint64 asked_us; /* the time that was given to wled_http_ask() */
    gboolean off;    /* the `off` that was given to wled_http_ask() */
    GError *error;   /* DEVICE_ERROR without a subject; NULL if the members below are valid */
    gboolean on;     /* WLED shows colours of its own */
    gboolean live;   /* WLED shows what it gets by UDP from the address `from` */
    guint32 from;
    int n_leds;
    char version[32];
};
void wled_answer_free(struct wled_answer *answer);

WledHttp *wled_http_new(const char *address, int port);
/* Ends a request that is under way. NULL is ignored. */
void wled_http_free(WledHttp *http);

gboolean wled_http_is_busy(const WledHttp *http);
/* Begins a request for the state. If off is TRUE, WLED is first told to end the reception of UDP
 * and to go off. */
void wled_http_ask(WledHttp *http, gboolean off, gint64 asked_us);
/* Returns the answer to the last request, or NULL if it has not come yet or was returned before.
 * Free it with wled_answer_free(). */
struct wled_answer *wled_http_take(WledHttp *http);

/* For tests: reads the text of an answer. */
gboolean wled_answer_read(const char *text, gssize n, struct wled_answer *ret, GError **error);
