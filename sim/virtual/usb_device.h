/*
 * Virtual USB devices, for tests and for mesorig-rig. Each is a model behind umockdev's usbfs,
 * which libusb uses like the kernel's usbfs. A process sees the devices only after testbed_enter().
 *
 * The functions of a model run in umockdev's thread, with the device locked. The functions of this
 * header lock the device while they use it.
 */
#pragma once

#include <glib.h>

typedef struct VirtualUsb VirtualUsb;

struct virtual_usb_class {
    guint16 vendor, product;
    const char *name; /* product string */
    const char *serial;
    const guint8 *config; /* configuration descriptor, including all descriptors in it */
    gsize config_size;
    /* Answers a control request. setup has 8 bytes. data has the length that setup gives, and
     * receives the answer. Returns the number of bytes of the answer, or -EPIPE to stall. */
    int (*control)(gpointer model, const guint8 *setup, guint8 *data);

    /* The following members are optional. */
    guint8 device_class[3]; /* class, subclass, protocol */
    int speed_mbit_s;       /* 5000 for SuperSpeed; 0 means 12, full speed */
    const char *manufacturer;
    const char *const *strings; /* further strings, with numbers from 4 on, NULL-terminated */
    /* Takes data that the host sends to a bulk endpoint. Returns -EPIPE to stall. */
    int (*bulk_out)(gpointer model, guint8 endpoint, const guint8 *data, int n);
    /* Sets data to at most size bytes for the host, from a bulk endpoint. Returns the number of
     * bytes, or -EPIPE to stall. Returns -EAGAIN if there is no data yet; the function is then
     * called again later. */
    int (*bulk_in)(gpointer model, guint8 endpoint, guint8 *data, int size);
};

enum virtual_usb_fault {
    VIRTUAL_USB_WELL,
    VIRTUAL_USB_STALLS, /* stalls every request of the class and every bulk transfer */
    VIRTUAL_USB_SILENT, /* never answers requests of the class or bulk transfers */
    VIRTUAL_USB_SHORT,  /* answers with half of the data */
};

/* Makes a device that is plugged into a port from 1 to 9 of bus 1. model must exist longer than the
 * device. */
VirtualUsb *virtual_usb_new(const struct virtual_usb_class *class, int port, gpointer model);
void virtual_usb_free(VirtualUsb *usb);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualUsb, virtual_usb_free)

void virtual_usb_unplug(VirtualUsb *usb);
void virtual_usb_plug(VirtualUsb *usb); /* gives a new address, as on a real bus */

/* Sets the fault. Requests that have already begun are not affected. */
void virtual_usb_set_fault(VirtualUsb *usb, enum virtual_usb_fault fault);
/* Returns the number of requests to the class since the device was made. */
int virtual_usb_n_requests(VirtualUsb *usb);

/* Makes this endpoint stall until the host clears the stall. */
void virtual_usb_halt(VirtualUsb *usb, guint8 endpoint);

/* Lock and unlock the device. A test calls these functions around code that reads or changes a
 * model. */
void virtual_usb_lock(VirtualUsb *usb);
void virtual_usb_unlock(VirtualUsb *usb);
