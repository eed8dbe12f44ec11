/*
 * A virtual DMX512 node on UDP, in a separate thread and in real time: an Art-Net 4 node at port
 * 6454, or a receiver of sACN (ANSI E1.31-2018) at port 5568. It was written from the published
 * layouts and shares no code with the drivers. It is for tests.
 *
 * Any thread may call these functions, except virtual_dmx_new() and virtual_dmx_free().
 */
#pragma once

#include <glib.h>

#define VIRTUAL_DMX_UNIVERSES 4

typedef struct VirtualDmx VirtualDmx;

/* Returns an address of the loopback interface that depends on the process and on i (0 to 7). Tests
 * that run at the same time in different processes therefore get different addresses. */
const char *virtual_dmx_address(int i);

struct virtual_dmx_options {
    gboolean sacn;
    const char *address; /* address of the node, such as that of virtual_dmx_address() */
    int universe, n;     /* number of the first universe, and number of universes */
    gboolean page_each;  /* Art-Net: each output has its own reply, as in Art-Net 4 */
    /* sACN: the node also joins the multicast groups of its universes, at `address` */
    gboolean multicast;
    /* sACN: the outputs keep their levels after loss of data, as with some receivers */
    gboolean holds_last;
};

VirtualDmx *virtual_dmx_new(const struct virtual_dmx_options *options, GError **error);
void virtual_dmx_free(VirtualDmx *node); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualDmx, virtual_dmx_free)

struct virtual_dmx_faults {
    gboolean cut;       /* nothing arrives, and nothing is sent */
    gboolean silent;    /* obeys, but does not answer */
    gboolean unplugged; /* the socket is closed, so the system refuses packets */
    int lose;           /* n: every n-th packet to the node is lost; 0: none is lost */
    int lose_answers;   /* n: every n-th answer is lost; 0: none is lost */
    int late_ms;        /* delay of answers */
    guint8 state;       /* these bits of GoodOutputA are inverted */
    gboolean garbage;   /* before each answer, packets are sent that are not answers */
    gboolean other;     /* answers are for other universes */
};
void virtual_dmx_fail(VirtualDmx *node, const struct virtual_dmx_faults *faults);

struct virtual_dmx_state {
    guint8 levels[VIRTUAL_DMX_UNIVERSES][512]; /* true levels of the outputs */
    gboolean lit;                              /* any level is above 0 */
    int n_levels;                              /* packets with levels for a universe of the node */
    int n_polls, n_damaged;
    int n_foreign;     /* packets with levels for other universes */
    int n_old;         /* sACN: packets dropped because of their sequence number */
    int n_lost;        /* sACN: number of times that no packet came for 2.5 s */
    int n_terminated;  /* sACN: ends of a stream that were announced */
    int priority;      /* sACN: priority of the last packet */
    gint64 longest_us; /* longest time between two packets for the first universe */
};
void virtual_dmx_state(VirtualDmx *node, struct virtual_dmx_state *ret);
