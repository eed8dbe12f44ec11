/* A virtual USB relay board, for tests and for mesorig-rig. It behaves like the firmware of
 * https://github.com/pavel-a/usb-relay-hid. */
#pragma once

#include "usb_device.h"
#include "world_link.h"

typedef struct VirtualRelays VirtualRelays;

/* Makes a board. name is "USBRelay4" for a board of four relays; its last character is the number
 * of relays. A name of another form makes a different device with the same USB ids. If second is
 * TRUE, the HID interface is the second interface and has number 1. */
VirtualRelays *virtual_relays_new(const char *name, const char *serial, int port, gboolean second);
void virtual_relays_free(VirtualRelays *relays);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualRelays, virtual_relays_free)

VirtualUsb *virtual_relays_usb(VirtualRelays *relays);

/* Connects a relay, counted from 0, to a lamp or laser of the world ("lamp NAME", "laser NAME").
 * The relay then powers this lamp or laser. */
gboolean virtual_relays_link(VirtualRelays *relays, int relay, World *world, const char *part,
                             GError **error);

guint virtual_relays_state(VirtualRelays *relays); /* one bit per relay */
/* Makes the relays of mask stick, so that they no longer switch. Bit i stands for relay i. */
void virtual_relays_stick(VirtualRelays *relays, guint mask);
/* Imitates a power failure of the board: all relays go off. */
void virtual_relays_lose_power(VirtualRelays *relays);
