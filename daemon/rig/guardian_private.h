/* What daemon and guardian send each other through a pair of sockets, in packets (SOCK_SEQPACKET).
 */
#pragma once

#include <glib.h>

/* From the daemon: one byte. */
enum message {
    BEAT = 'b',
    PAUSE = 'p',   /* a beat; silence until the next one is not a hang */
    GOODBYE = 'q', /* the rig is safe */
    FAILED = 'f',  /* the rig could not be opened: make it safe */
};

/* From the guardian: an answer to a beat, or once, instead of the first answer, why the daemon must
 * not open the rig. */
struct answer {
    gint64 at_us;   /* g_get_monotonic_time(), the same clock for both */
    char refusal[]; /* up to the end of the packet; empty: none */
};

#define ANSWER_MAX 4096
