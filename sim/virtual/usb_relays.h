/* A USB relay board that behaves like its firmware (https://github.com/pavel-a/usb-relay-hid), for
 * tests. */
#pragma once

#include "usb_device.h"
#include "world_link.h"

typedef struct VirtualRelays VirtualRelays;

/* name: "USBRelay4" for a board of four relays; another name for another device with the same ids.
 * second: the HID interface has number 1, after another interface. */
VirtualRelays *virtual_relays_new(const char *name, const char *serial, int port, gboolean second);
void virtual_relays_free(VirtualRelays *relays);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualRelays, virtual_relays_free)

VirtualUsb *virtual_relays_usb(VirtualRelays *relays);

/* relay, from 0 on, powers a lamp or laser of the world ("lamp NAME", "laser NAME"). */
gboolean virtual_relays_link(VirtualRelays *relays, int relay, World *world, const char *part,
                             GError **error);

guint virtual_relays_state(VirtualRelays *relays); /* one bit per relay */
/* The relays in mask no longer switch. */
void virtual_relays_stick(VirtualRelays *relays, guint mask);
void virtual_relays_lose_power(VirtualRelays *relays); /* as when unplugged: all fall off */
