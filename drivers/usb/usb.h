/*
 * USB devices, by libusb's asynchronous transfers in the main loop: a source of
 * the default main context polls libusb's descriptors and makes every callback, never from within
 * the call that started the request.
 *
 * All functions belong to the main loop's thread. Only usb_open(), usb_control_sync() and
 * usb_close() wait, at most USB_SYNC_MS per request.
 */
#pragma once

#include <glib.h>

#define USB_SYNC_MS 250

typedef struct UsbDevice UsbDevice;

/* Selects a device and one of its interfaces. Empty strings match anything. */
struct usb_match {
    const char *who; /* "axis turntable": begins every error message */
    guint16 vendor;
    const guint16 *products;    /* ends with 0 */
    const char *product_prefix; /* the product's name begins so; NULL: any name */
    guint8 interface_class;     /* the first interface of this class is claimed */
    const char *serial;
    const char *path; /* "1-2.4": bus, then a port at each hub */
    /* For devices whose serial number is not in the string descriptor. */
    char *(*read_serial)(UsbDevice *usb);
};

/* data: the n bytes that an IN request has read, valid during the call. With an error, n is 0. */
typedef void (*UsbFunc)(UsbDevice *usb, const guint8 *data, gsize n, const GError *error,
                        gpointer user);
/* The device was unplugged. Called once, after all its requests have ended. Close it then. */
typedef void (*UsbLostFunc)(UsbDevice *usb, gpointer user);

/* Fails if none fits, or more than one. Takes the interface from a kernel driver. */
UsbDevice *usb_open(const struct usb_match *match, UsbLostFunc lost, gpointer user, GError **error);

/* Cancels what is under way; nothing is called afterwards. NULL is ignored. */
void usb_close(UsbDevice *usb);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(UsbDevice, usb_close)

struct usb_request {
    guint8 type, request; /* bmRequestType, bRequest */
    guint16 value, index;
    const guint8 *data; /* sent by an OUT request; copied */
    guint16 length;
};

/* Starts a control transfer, which ends by one call of func. Requests are done in the order in
 * which they were started. One without answer after timeout_ms is DEVICE_ERROR_TIMEOUT, one that
 * the device stalls DEVICE_ERROR_PROTOCOL, and a device that is gone DEVICE_ERROR_DISCONNECTED. */
gboolean usb_control(UsbDevice *usb, const struct usb_request *request, guint timeout_ms,
                     UsbFunc func, gpointer user, GError **error);

/* The same, waiting for it. Writes up to request->length bytes to answer; its length, or -1. */
int usb_control_sync(UsbDevice *usb, const struct usb_request *request, guint8 *answer,
                     GError **error);

struct libusb_device;
char *usb_path_of(struct libusb_device *device); /* as in usb_match; g_free() */

/* "the Tic with serial 00123456", "the Tic at 1-2.4" or "the only Tic", as a section says which it
 * is. g_free() */
char *usb_words(const char *what, const char *serial, const char *path);

guint8 usb_interface(const UsbDevice *usb); /* number of the one that was claimed */
const char *usb_product(const UsbDevice *usb);
const char *usb_serial(const UsbDevice *usb); /* "": it has none */
