/*
 * A virtual LED controller on a pseudo-terminal, in a separate thread and in real time. It speaks
 * the protocol of docs/build-a-rig/led-controller.md. It was written from that page and shares no
 * code with the driver. It is for tests, and for mesorig-rig.
 *
 * Any thread may call these functions, except virtual_leds_new() and virtual_leds_free().
 */
#pragma once

#include <glib.h>

#define VIRTUAL_LEDS_MAX 64

typedef struct VirtualLeds VirtualLeds;

struct virtual_leds_options {
    int n;                   /* number of lamps */
    int dark_ms;             /* time without a request after which the lamps go off */
    int boot_ms;             /* time from a reset until the controller listens */
    gboolean resets_on_open; /* opening the port resets the controller, as on an Arduino */
};

VirtualLeds *virtual_leds_new(const struct virtual_leds_options *options, GError **error);
void virtual_leds_free(VirtualLeds *leds); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualLeds, virtual_leds_free)

/* Returns the value of "port" for a section of a rig file. The value is the path of a link to the
 * pseudo-terminal, as in /dev/serial/by-id. */
const char *virtual_leds_port(const VirtualLeds *leds);

/* The faults that virtual_leds_fail() sets. If a member lose_… or damage_… is n, every n-th byte is
 * lost or damaged. 0 means that no byte is lost or damaged. */
struct virtual_leds_faults {
    gboolean cut;                       /* nothing arrives, and nothing is sent */
    gboolean silent;                    /* obeys, but sends nothing */
    int late_ms;                        /* delay of everything that is sent */
    int lose_sent, damage_sent;         /* bytes from the controller to the program */
    int lose_received, damage_received; /* bytes from the program to the controller */
    gboolean noise;                     /* sends a line of noise before each line */
    /* a bit for each lamp that "off" and the watchdog do not switch off */
    guint64 stuck;
    guint64 dead; /* a bit for each lamp that does not go on */
};
void virtual_leds_fail(VirtualLeds *leds, const struct virtual_leds_faults *faults);

void virtual_leds_reset(VirtualLeds *leds);
/* Closes the pseudo-terminal, or opens a new one at the same link. The controller continues to
 * run. */
void virtual_leds_unplug(VirtualLeds *leds);
void virtual_leds_plug(VirtualLeds *leds);
/* Sends a line to the program. */
void virtual_leds_send(VirtualLeds *leds, const char *line);
/* Gives the controller bytes as if the program had sent them. */
void virtual_leds_receive(VirtualLeds *leds, const char *bytes);

struct virtual_leds_state {
    guint8 levels[VIRTUAL_LEDS_MAX];      /* true levels of the outputs */
    gboolean lit;                         /* any level is above 0 */
    int n_requests, n_damaged, n_refused; /* numbers of valid, damaged and refused requests */
    int n_pings, n_sets, n_offs;          /* numbers of requests of each kind */
    int n_resets;
    int n_watchdog; /* number of times that the watchdog has switched lit lamps off */
};
void virtual_leds_state(VirtualLeds *leds, struct virtual_leds_state *ret);
