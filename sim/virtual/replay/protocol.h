/* This module has what a replayer must know about the protocol of a bus. Any thread may call the
 * functions. */
#pragma once

#include <glib.h>

struct replay_protocol {
    const char *kind;         /* kind of bus, such as "serial" */
    const char *const *words; /* the sections of the bus contain one of them; NULL for any */

    /* Returns the length of the first request of a stream, or 0 if it is not complete. NULL if each
     * message is a request. */
    gsize (*cut)(const char *bytes, gsize n);

    /* Returns the request without what changes from run to run, such as its number;
     * g_bytes_unref(). Returns NULL if the request is to be ignored. */
    GBytes *(*key)(const guint8 *bytes, gsize n);

    /* Returns the name of the stream of a request; g_free(). Streams are polls, writes to a
     * watchdog, and levels that are sent again and again. A request that repeats the last one of
     * its stream is no news: it may come more often or less often than in the recording, as long as
     * its answer does not change. Commands are in the stream "", in which everything is news.
     * sections is the text of the rig file's sections. */
    char *(*stream)(const guint8 *key, gsize n, const char *sections);

    /* Returns whether a message is an answer to this request, and not one that the device sends by
     * itself or to another request. NULL if every message up to the next request is an answer. */
    gboolean (*answers)(const guint8 *request, gsize n, const guint8 *message, gsize size);

    /* Returns the message with the number of the request; g_bytes_unref(). NULL if messages have no
     * numbers. */
    GBytes *(*adapt)(GBytes *message, const guint8 *request, gsize n);
};

/* Returns the protocol of a bus, or NULL if it cannot be replayed. sections is the text of the rig
 * file's sections. */
const struct replay_protocol *replay_protocol_find(const char *kind, const char *sections);
