/* A virtual USB relay board, for tests and for mesorig-rig. It behaves like the firmware of
 * https://github.com/pavel-a/usb-relay-hid. */
#pragma once

#include "usb_device.h"
#include "world_link.h"

typedef struct VirtualRelays VirtualRelays;

/* Makes a board. name is "USBRelay4" for a board of four relays. Another name makes a different
 * device with the same USB ids. The last character of the name is the number of relays. If second
 * is TRUE, the HID interface has number 1 and follows another interface. */
VirtualRelays *virtual_relays_new(const char *name, const char *serial, int port, gboolean second);
void virtual_relays_free(VirtualRelays *relays);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualRelays, virtual_relays_free)

VirtualUsb *virtual_relays_usb(VirtualRelays *relays);

/* Lets a relay, counted from 0, power a lamp or laser of the world ("lamp NAME", "laser NAME"). */
gboolean virtual_relays_link(VirtualRelays *relays, int relay, World *world, const char *part,
                             GError **error);

guint virtual_relays_state(VirtualRelays *relays); /* one bit per relay */
/* Makes the relays in mask stick, so that they no longer switch. */
void virtual_relays_stick(VirtualRelays *relays, guint mask);
/* Imitates a power failure of the board: all relays go off. */
void virtual_relays_lose_power(VirtualRelays *relays);
