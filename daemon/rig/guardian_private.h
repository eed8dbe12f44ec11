/* Messages between the daemon and its guardian: packets on a pair of sockets (SOCK_SEQPACKET). */
#pragma once

#include <glib.h>

/* Messages from the daemon. Each is one byte. */
enum message {
    BEAT = 'b',
    PAUSE = 'p',   /* a heartbeat; a missing BEAT after it does not mean a hang */
    GOODBYE = 'q', /* the rig is safe */
    FAILED = 'f',  /* the rig could not be opened and must be made safe */
};

/* Answer of the guardian to a heartbeat. Instead of its first answer, the guardian may send the
 * reason why the daemon must not open the rig. */
struct answer {
    gint64 at_us;   /* time of the answer by g_get_monotonic_time(), one clock for both processes */
    char refusal[]; /* reason, up to the end of the packet; empty if there is none */
};

#define ANSWER_MAX 4096
