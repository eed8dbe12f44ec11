/*
 * The result of a scan of a bus, for `mesorig devices`. Each folder of drivers that can search for
 * its devices offers one function
 *
 *     gboolean NAME_scan(GPtrArray *to, GError **error);
 *
 * The function appends a struct found for each device. It fails only if the bus cannot be searched.
 * A bus that does not exist has no devices. The function may wait for one or two seconds. It
 * changes nothing on a device.
 */
#pragma once

#include <glib.h>

struct found {     /* strings are owned */
    char *bus;     /* "usb", "video", "gige", "usb3-vision", "serial", "modbus" */
    char *address; /* address on its bus: "1-2.4", "/dev/video0", "192.168.0.10" */
    char *what;    /* names of maker and device, as the device reports them */
    char *serial;  /* empty if the device reports none */
    /* a section for a rig file, ready to paste: "[camera NAME]\ndriver = …\n"; NULL if no driver
     * fits the device */
    char *section;
    /* Why the device cannot be used as it is, what it can be used for, or what it offers. NULL if
     * there is nothing to say. */
    char *note;
};

/* Appends a device to the list and returns it. Its members `section` and `note` are NULL; the
 * caller may set them. `what` and `serial` may be NULL. */
struct found *found_add(GPtrArray *to, const char *bus, const char *address, const char *what,
                        const char *serial);
GPtrArray *found_list_new(void); /* an array of struct found, which it owns */
