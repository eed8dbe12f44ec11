/*
 * A virtual WLED controller, in a separate thread and in real time. It has UDP realtime (DNRGB) at
 * port 21324, and the part of the JSON interface that the driver uses. It was written from the
 * documentation of WLED and shares no code with the driver. It is for tests.
 *
 * Any thread may call these functions, except virtual_wled_new() and virtual_wled_free().
 */
#pragma once

#include <glib.h>

#define VIRTUAL_WLED_LEDS 600

typedef struct VirtualWled VirtualWled;

/* Makes a controller with n LEDs at this address. Like a new WLED, the controller is on until a
 * program switches it off. */
VirtualWled *virtual_wled_new(const char *address, int n, GError **error);
void virtual_wled_free(VirtualWled *wled); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualWled, virtual_wled_free)

int virtual_wled_http_port(const VirtualWled *wled);

struct virtual_wled_faults {
    gboolean cut;     /* nothing arrives, and nothing is answered */
    gboolean silent;  /* obeys, but does not answer by HTTP */
    gboolean deaf;    /* does not take UDP */
    gboolean stays;   /* does not go off */
    gboolean other;   /* reports that it shows levels that come from another address */
    gboolean garbage; /* answers with a text that is not JSON */
    gboolean refuses; /* answers with status 500 */
    int lose;         /* n: every n-th UDP packet is lost; 0: none is lost */
};
void virtual_wled_fail(VirtualWled *wled, const struct virtual_wled_faults *faults);
/* Switches the controller on, as by its button. */
void virtual_wled_press(VirtualWled *wled);

struct virtual_wled_state {
    guint8 leds[VIRTUAL_WLED_LEDS][3]; /* what the LEDs show */
    gboolean lit, on;
    gboolean live; /* it shows the levels that came by UDP */
    int n_packets, n_damaged, n_gets, n_posts;
    /* number of times that no packet came, so that the controller returned to its own state */
    int n_returns;
};
void virtual_wled_state(VirtualWled *wled, struct virtual_wled_state *ret);
