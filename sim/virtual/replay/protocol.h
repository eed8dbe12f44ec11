/* What a replayer must know about the protocol of a bus. Any thread may call the functions. */
#pragma once

#include <glib.h>

struct replay_protocol {
    const char *kind; /* kind of bus, such as "serial" */
    /* The protocol is used if the rig file contains one of these words. NULL: for any rig file. */
    const char *const *words;

    /* Returns the length of the first request in bytes, or 0 if the request is not complete. The
     * pointer is NULL if each message is one request. */
    gsize (*cut)(const char *bytes, gsize n);

    /* Returns the request without the parts that change from run to run, such as the number of the
     * request. Free the result with g_bytes_unref(). Returns NULL if the request must be
     * ignored. */
    GBytes *(*key)(const guint8 *bytes, gsize n);

    /* Returns the name of the stream of a request. Free it with g_free(). sections is the text of
     * the rig file's sections.
     *
     * Polls, writes to a watchdog, and levels that are sent again and again each have a stream. A
     * request that repeats the last request of its stream may come more often or less often than in
     * the recording, as long as its answer does not change.
     *
     * Commands are in the stream "". In this stream every request must come as in the recording,
     * even if it repeats the last one. */
    char *(*stream)(const guint8 *key, gsize n, const char *sections);

    /* Returns whether a message is the answer to this request. If not, the message answers another
     * request, or the device sends it by itself. The pointer is NULL if every message up to the
     * next request is an answer. */
    gboolean (*answers)(const guint8 *request, gsize n, const guint8 *message, gsize size);

    /* Returns the recorded message with its number replaced by the number of this request. Free it
     * with g_bytes_unref(). The pointer is NULL if messages have no numbers. */
    GBytes *(*adapt)(GBytes *message, const guint8 *request, gsize n);
};

/* Returns the protocol of a kind of bus, or NULL if such a bus cannot be replayed. sections is the
 * text of the rig file's sections. */
const struct replay_protocol *replay_protocol_find(const char *kind, const char *sections);
