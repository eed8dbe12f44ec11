/*
 * Virtual USB devices: models behind umockdev's usbfs, which libusb uses like the kernel's. For
 * tests. A process sees them only after testbed_enter().
 *
 * The models' functions run in umockdev's thread, with the device locked; so do the functions here.
 */
#pragma once

#include <glib.h>

typedef struct VirtualUsb VirtualUsb;

struct virtual_usb_class {
    guint16 vendor, product;
    const char *name; /* the product's string */
    const char *serial;
    const guint8 *config; /* configuration descriptor, with all it contains */
    gsize config_size;
    /* A control request: setup has 8 bytes, data setup's length. Returns how many bytes of data are
     * the answer, or -EPIPE to stall. */
    int (*control)(gpointer model, const guint8 *setup, guint8 *data);

    /* The following members may be left out. */
    guint8 device_class[3]; /* class, subclass, protocol */
    int speed_mbit_s;       /* 5000 for SuperSpeed; 0: 12, full speed */
    const char *manufacturer;
    const char *const *strings; /* further ones, numbered from 4 on, NULL-terminated */
    /* A transfer to a bulk endpoint; -EPIPE to stall. */
    int (*bulk_out)(gpointer model, guint8 endpoint, const guint8 *data, int n);
    /* A request for no more than size bytes from a bulk endpoint. It is repeated while it returns
     * -EAGAIN. */
    int (*bulk_in)(gpointer model, guint8 endpoint, guint8 *data, int size);
};

enum virtual_usb_fault {
    VIRTUAL_USB_WELL,
    VIRTUAL_USB_STALLS, /* every request of the class's own, and every bulk transfer */
    VIRTUAL_USB_SILENT, /* never answers them */
    VIRTUAL_USB_SHORT,  /* answers with half of the data */
};

/* Plugged into port 1 to 9 of bus 1. model must outlive it. */
VirtualUsb *virtual_usb_new(const struct virtual_usb_class *class, int port, gpointer model);
void virtual_usb_free(VirtualUsb *usb);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualUsb, virtual_usb_free)

void virtual_usb_unplug(VirtualUsb *usb);
void virtual_usb_plug(VirtualUsb *usb); /* with a new address, as on a real bus */

/* Requests under way are answered (or not) as before. */
void virtual_usb_set_fault(VirtualUsb *usb, enum virtual_usb_fault fault);
int virtual_usb_n_requests(VirtualUsb *usb); /* of the class's own, so far */

/* This endpoint stalls until the host clears it. */
void virtual_usb_halt(VirtualUsb *usb, guint8 endpoint);

/* A test calls these around code that reads or changes a model. */
void virtual_usb_lock(VirtualUsb *usb);
void virtual_usb_unlock(VirtualUsb *usb);
