/*
 * USB devices, by libusb's asynchronous transfers in the main loop. A source of the default main
 * context polls libusb's descriptors and makes every callback. No callback is made from within the
 * call that started the request.
 *
 * All functions belong to the main loop's thread. usb_open() and usb_control_sync() wait at most
 * USB_SYNC_MS per request. usb_open() may also wait for the lock of the device (LOCK_OWNER in
 * drivers/lock.h). usb_close() waits at most one second. No other function waits.
 */
#pragma once

#include <glib.h>

#define USB_SYNC_MS 250

typedef struct UsbDevice UsbDevice;

/* Selects a device and one of its interfaces. Empty strings and NULL match anything. */
struct usb_match {
    const char *who; /* the beginning of every error message, such as "axis turntable" */
    guint16 vendor;
    const guint16 *products; /* product ids; the last is 0 */
    /* text with which the name of the product must begin; NULL allows any name */
    const char *product_prefix;
    guint8 interface_class; /* the first interface of this class is claimed */
    const char *serial;
    const char *path; /* for example "1-2.4": the bus, then the port at each hub */
    /* Reads the serial number of a device that has none in its string descriptors. Free the result
     * with g_free(). NULL if the string descriptors contain the serial number. */
    char *(*read_serial)(UsbDevice *usb);
};

/* Called when a request has ended. `data` points to the n bytes that an IN request has read. The
 * bytes are valid during the call. error is NULL on success; otherwise n is 0. */
typedef void (*UsbFunc)(UsbDevice *usb, const guint8 *data, gsize n, const GError *error,
                        gpointer user);
/* Called once after the device was unplugged and all its requests have ended. The owner of the
 * device then closes it with usb_close(). */
typedef void (*UsbLostFunc)(UsbDevice *usb, gpointer user);

/* Opens the device that matches, and detaches a kernel driver from the interface. Returns NULL with
 * an error:
 * - DEVICE_ERROR_DISCONNECTED: no device matches
 * - DEVICE_ERROR_RANGE: more than one device matches
 * - DEVICE_ERROR_BUSY: another program uses the device
 * - DEVICE_ERROR_UNSUPPORTED: this user may not open the device, or there is no USB
 * - DEVICE_ERROR_PROTOCOL: the device has no such interface */
UsbDevice *usb_open(const struct usb_match *match, UsbLostFunc lost, gpointer user, GError **error);

/* Closes the device and cancels its requests. No callback is made afterwards. NULL is ignored. */
void usb_close(UsbDevice *usb);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(UsbDevice, usb_close)

struct usb_request {
    guint8 type, request; /* bmRequestType, bRequest */
    guint16 value, index;
    const guint8 *data; /* bytes that an OUT request sends; they are copied */
    guint16 length;
};

/* Starts a control transfer, which ends with one call of func. Requests are carried out in the
 * order in which they were started. If the transfer cannot be started, returns FALSE with an error
 * and does not call func.
 *
 * The error, returned or passed to func, is one of these:
 * - DEVICE_ERROR_TIMEOUT: there is no answer after timeout_ms
 * - DEVICE_ERROR_DISCONNECTED: the device is gone
 * - DEVICE_ERROR_PROTOCOL: the device stalls the request, or the transfer fails for another
 *   reason */
gboolean usb_control(UsbDevice *usb, const struct usb_request *request, guint timeout_ms,
                     UsbFunc func, gpointer user, GError **error);

/* Makes a control transfer and waits for its end, USB_SYNC_MS at most. An IN request writes up to
 * request->length bytes to `answer`; for an OUT request, `answer` is NULL. Returns the number of
 * bytes that were transferred, or -1 with an error like those of usb_control(). */
int usb_control_sync(UsbDevice *usb, const struct usb_request *request, guint8 *answer,
                     GError **error);

struct libusb_device;
char *usb_path_of(struct libusb_device *device); /* path as in struct usb_match; g_free() */

/* Returns words for messages that name the device that a section selects: "the Tic with serial
 * 00123456", "the Tic at 1-2.4" or "the only Tic". Here `what` is "Tic". Free it with g_free(). */
char *usb_words(const char *what, const char *serial, const char *path);

guint8 usb_interface(const UsbDevice *usb); /* number of the interface that was claimed */
/* Return texts that belong to the device. They are empty if the device has none. */
const char *usb_product(const UsbDevice *usb);
const char *usb_serial(const UsbDevice *usb);
