#include "usb_relays.h"

#include <errno.h>
#include <string.h>

#define MAX_RELAYS 8

struct VirtualRelays {
    VirtualUsb *usb;
    struct virtual_usb_class class;
    char serial[6];
    int interface, n;
    guint state, stuck;
    struct world_part parts[MAX_RELAYS]; /* the lamp or laser that each relay powers */
};

#define INTERFACE(number, n_endpoints, class_) 9, 4, number, 0, n_endpoints, class_, 0, 0, 0
#define HID                                    9, 0x21, 1, 1, 0, 1, 0x22, 22, 0
#define INTERRUPT(address)                     7, 5, address, 3, 8, 0, 20

/* clang-format off */
static const guint8 config[] = {
    9, 2, 34, 0, 1, 1, 0, 0x80, 50, INTERFACE(0, 1, 3), HID, INTERRUPT(0x81)};
/* A board with two interfaces: the relays are the second one, with another endpoint address. */
static const guint8 config_second[] = {
    9, 2, 43, 0, 2, 1, 0, 0x80, 50, INTERFACE(0, 0, 0xff), INTERFACE(1, 1, 3), HID, INTERRUPT(0x85)};
/* clang-format on */

static void usb_relays_set_state(VirtualRelays *relays, guint state) {
    guint changed = relays->state ^ state;
    relays->state = state;
    for (int i = 0; i < MAX_RELAYS; i++)
        if (changed & 1u << i)
            world_part_switch(&relays->parts[i], (state & 1u << i) != 0, g_get_monotonic_time());
}

static void set_relays(VirtualRelays *relays, guint mask, gboolean on) {
    mask &= ((1u << relays->n) - 1) & ~relays->stuck;
    usb_relays_set_state(relays, on ? relays->state | mask : relays->state & ~mask);
}

static int usb_relays_control(gpointer model, const guint8 *setup, guint8 *data) {
    VirtualRelays *relays = model;
    int value = setup[2] | setup[3] << 8, index = setup[4] | setup[5] << 8;
    int length = setup[6] | setup[7] << 8;
    if (value != 0x0300 || index != relays->interface || length != 8)
        return -EPIPE;
    if (setup[0] == 0x21 && setup[1] == 9) {
        guint one = data[1] >= 1 && data[1] <= 8 ? 1u << (data[1] - 1) : 0;
        if (data[0] != 0xff && data[0] != 0xfe && data[0] != 0xfd && data[0] != 0xfc)
            return -EPIPE;
        set_relays(relays, data[0] & 1 ? one : 0xff, data[0] >= 0xfe);
        return 8;
    }
    if (setup[0] != 0xa1 || setup[1] != 1)
        return -EPIPE;
    memset(data, 0, 8);
    memcpy(data, relays->serial, 5);
    data[7] = (guint8)relays->state;
    return 8;
}

VirtualRelays *virtual_relays_new(const char *name, const char *serial, int port, gboolean second) {
    VirtualRelays *relays = g_new0(VirtualRelays, 1);
    relays->class =
        (struct virtual_usb_class){.vendor = 0x16c0,
                                   .product = 0x05df,
                                   .name = name,
                                   .serial = "",
                                   .config = second ? config_second : config,
                                   .config_size = second ? sizeof config_second : sizeof config,
                                   .control = usb_relays_control};
    g_strlcpy(relays->serial, serial, sizeof relays->serial);
    relays->interface = second ? 1 : 0;
    relays->n = name[strlen(name) - 1] - '0';
    relays->usb = virtual_usb_new(&relays->class, port, relays);
    return relays;
}

void virtual_relays_free(VirtualRelays *relays) {
    if (!relays)
        return;
    virtual_usb_free(relays->usb);
    for (int i = 0; i < MAX_RELAYS; i++)
        world_part_clear(&relays->parts[i]);
    g_free(relays);
}

VirtualUsb *virtual_relays_usb(VirtualRelays *relays) {
    return relays->usb;
}

gboolean virtual_relays_link(VirtualRelays *relays, int relay, World *world, const char *part,
                             GError **error) {
    struct world_part found = {0};
    g_return_val_if_fail(relay >= 0 && relay < relays->n, FALSE);
    if (!world_part_find(world, part, &found, error))
        return FALSE;
    virtual_usb_lock(relays->usb);
    struct world_part before = relays->parts[relay];
    relays->parts[relay] = found;
    world_part_switch(&found, (relays->state & 1u << relay) != 0, g_get_monotonic_time());
    virtual_usb_unlock(relays->usb);
    world_part_clear(&before);
    return TRUE;
}

guint virtual_relays_state(VirtualRelays *relays) {
    virtual_usb_lock(relays->usb);
    guint state = relays->state;
    virtual_usb_unlock(relays->usb);
    return state;
}

void virtual_relays_stick(VirtualRelays *relays, guint mask) {
    virtual_usb_lock(relays->usb);
    relays->stuck = mask;
    virtual_usb_unlock(relays->usb);
}

void virtual_relays_lose_power(VirtualRelays *relays) {
    virtual_usb_lock(relays->usb);
    usb_relays_set_state(relays, 0);
    virtual_usb_unlock(relays->usb);
}
