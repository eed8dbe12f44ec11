/*
 * The pseudo-terminal of a virtual device on a serial port. The port is a symbolic link to the
 * pseudo-terminal, as in /dev/serial/by-id. Functions set errno on failure. A struct belongs to one
 * thread at a time.
 */
#pragma once

#include <glib.h>

struct terminal {
    /* the device's end of the pseudo-terminal, which does not block; −1 if the device is
     * unplugged */
    int wire;
    int slave; /* the program's end, if the device also holds it open; otherwise −1 */
    int kept;  /* the program's end of the pseudo-terminal that was unplugged last, or −1 */
};

#define TERMINAL_CLOSED                                                                            \
    { -1, -1, -1 }

/* Opens a new pseudo-terminal, and makes the link to it. If reports_opening is TRUE, poll() on the
 * wire reports POLLHUP while no program has the port open. */
gboolean terminal_open(struct terminal *terminal, const char *link, gboolean reports_opening);

/* Closes the wire. The system then tells the program at the port that the line has hung up.
 *
 * The number of the pseudo-terminal stays in use until the next call of terminal_unplug() or
 * terminal_close(), so that no other program gets it. This is necessary because a driver keeps its
 * lock on this number until it opens the port again. */
void terminal_unplug(struct terminal *terminal);

/* Closes all descriptors. */
void terminal_close(struct terminal *terminal);
