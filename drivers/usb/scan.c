#include "scan.h"

#include "usb.h"

#include "drivers/device.h"

#include <libusb.h>
#include <string.h>
#include <unistd.h>

#define VENDOR_POLOLU 0x1ffb
#define VENDOR_VUSB   0x16c0
#define PRODUCT_VUSB  0x05df

#define VISION_CLASS    0xef /* USB3 Vision: class miscellaneous */
#define VISION_SUBCLASS 0x05 /* subclass of USB3 Vision */

static const guint16 tics[] = {0x00b3, 0x00b5, 0x00bd, 0x00c9, 0x00cb};

static char *scan_read_attribute(const char *path, const char *name) {
    g_autofree char *file = g_build_filename("/sys/bus/usb/devices", path, name, NULL);
    char *text = NULL;
    if (!g_file_get_contents(file, &text, NULL, NULL))
        return g_strdup("");
    return g_strstrip(text);
}

static gboolean is_camera(libusb_device *device) {
    struct libusb_config_descriptor *config;
    gboolean is = FALSE;
    if (libusb_get_active_config_descriptor(device, &config))
        return FALSE;
    for (int i = 0; i < config->bNumInterfaces; i++) {
        const struct libusb_interface *interface = &config->interface[i];
        if (interface->num_altsetting < 1)
            continue;
        guint8 class = interface->altsetting[0].bInterfaceClass;
        is |= class == LIBUSB_CLASS_VIDEO ||
              (class == VISION_CLASS &&
               interface->altsetting[0].bInterfaceSubClass == VISION_SUBCLASS);
    }
    libusb_free_config_descriptor(config);
    return is;
}

static void add_device(libusb_device *device, GPtrArray *to) {
    struct libusb_device_descriptor descriptor;
    if (libusb_get_device_descriptor(device, &descriptor) ||
        descriptor.bDeviceClass == LIBUSB_CLASS_HUB || is_camera(device))
        return;
    g_autofree char *path = usb_path_of(device);
    g_autofree char *maker = scan_read_attribute(path, "manufacturer");
    g_autofree char *product = scan_read_attribute(path, "product");
    g_autofree char *serial = scan_read_attribute(path, "serial");
    g_autofree char *what =
        *maker || *product
            ? g_strdup_printf("%s%s%s", maker, *maker ? " " : "", product)
            : g_strdup_printf("%04x:%04x", descriptor.idVendor, descriptor.idProduct);
    struct found *found = found_add(to, "usb", path, what, serial);
    gboolean tic = FALSE;
    for (gsize i = 0; i < G_N_ELEMENTS(tics); i++)
        tic |= descriptor.idVendor == VENDOR_POLOLU && descriptor.idProduct == tics[i];
    if (tic)
        found->section = g_strdup_printf("[axis NAME]\ndriver = tic-axis\n%s = %s\n"
                                         "# steps_per_deg = microsteps in a degree of the axis\n",
                                         *found->serial ? "serial" : "path",
                                         *found->serial ? found->serial : path);
    else if (descriptor.idVendor == VENDOR_VUSB && descriptor.idProduct == PRODUCT_VUSB &&
             g_str_has_prefix(product, "USBRelay"))
        found->section = g_strdup_printf("[lamps NAME]\ndriver = usb-relays\npath = %s\n"
                                         "# or, where it switches a laser:\n"
                                         "# [laser NAME]\n# driver = usb-relay-laser\n"
                                         "# path = %s\n# relay = 1\n",
                                         path, path);
    g_autofree char *node = g_strdup_printf("/dev/bus/usb/%03d/%03d", libusb_get_bus_number(device),
                                            libusb_get_device_address(device));
    if (found->section && access(node, R_OK | W_OK) < 0)
        found->note = g_strdup("this user may not open it; install etc/udev/60-mesorig.rules");
}

gboolean usb_scan(GPtrArray *to, GError **error) {
    libusb_context *context;
    libusb_device **all = NULL;
    int code = libusb_init(&context);
    if (code == LIBUSB_ERROR_OTHER || code == LIBUSB_ERROR_NOT_SUPPORTED)
        return TRUE; /* a machine or container without USB */
    if (code)
        return device_error_set(error, DEVICE_ERROR_UNSUPPORTED, NULL,
                                "USB devices cannot be listed: %s" ERROR_ADVICE
                                "check that this user may read /dev/bus/usb",
                                libusb_strerror(code));
    gssize n = libusb_get_device_list(context, &all);
    for (gssize i = 0; i < n; i++)
        add_device(all[i], to);
    if (n >= 0)
        libusb_free_device_list(all, 1);
    libusb_exit(context);
    return TRUE;
}
