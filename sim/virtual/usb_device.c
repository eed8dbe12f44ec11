#include "usb_device.h"

#include "testbed.h"

#include <errno.h>
#include <linux/usbdevice_fs.h>
#include <string.h>
#include <sys/ioctl.h>

#define SETUP_SIZE     8
#define GET_DESCRIPTOR 6
#define STRING_TYPE    3

/* A request takes about as long as on a full-speed bus. */
#define LATENCY_US 200

/* Between two askings in vain. The mocked node always seems ready, so that libusb asks on. */
#define IDLE_US 300

enum { NAME_INDEX = 2, SERIAL_INDEX = 3 };

struct VirtualUsb {
    const struct virtual_usb_class *class;
    gpointer model;
    int port, address;
    char *sysfs; /* NULL: unplugged */
    char *node;
    UMockdevIoctlBase *handler;
    GMutex mutex;
    GQueue flying; /* of struct flight */
    enum virtual_usb_fault fault;
    int n_requests;
};

struct flight {
    UMockdevIoctlClient *client; /* whose memory it is in: only it may reap; not a reference */
    UMockdevIoctlData *urb;
    gint64 due_us; /* G_MAXINT64: never */
    int status, length;
};

/* While there is any device. */
static UMockdevTestbed *testbed;
static int n_devices, last_address;

static struct usbdevfs_urb *urb_of(const struct flight *flight) {
    return (struct usbdevfs_urb *)flight->urb->data;
}

static void flight_free(struct flight *flight) {
    umockdev_ioctl_data_unref(flight->urb);
    g_free(flight);
}

static int answer_string(const char *text, guint8 *data, int length) {
    guint8 descriptor[256] = {0, STRING_TYPE};
    int n = 2;
    for (; *text && n < 254; text++, n += 2)
        descriptor[n] = (guint8)*text;
    descriptor[0] = (guint8)n;
    n = MIN(n, length);
    memcpy(data, descriptor, (gsize)n);
    return n;
}

static int answer(VirtualUsb *usb, const guint8 *setup, guint8 *data) {
    int length = setup[6] | setup[7] << 8;
    if (setup[0] == 0x80 && setup[1] == GET_DESCRIPTOR && setup[3] == STRING_TYPE)
        return setup[2] == NAME_INDEX     ? answer_string(usb->class->name, data, length)
               : setup[2] == SERIAL_INDEX ? answer_string(usb->class->serial, data, length)
                                          : -EPIPE;
    usb->n_requests++;
    if (usb->fault == VIRTUAL_USB_STALLS)
        return -EPIPE;
    int n = usb->class->control(usb->model, setup, data);
    return usb->fault == VIRTUAL_USB_SHORT && n > 0 ? n / 2 : n;
}

static void submit(VirtualUsb *usb, UMockdevIoctlClient *client, UMockdevIoctlData *arg) {
    UMockdevIoctlData *data =
        umockdev_ioctl_data_resolve(arg, 0, sizeof(struct usbdevfs_urb), NULL);
    struct usbdevfs_urb *urb = (struct usbdevfs_urb *)data->data;
    UMockdevIoctlData *buffer = umockdev_ioctl_data_resolve(
        data, G_STRUCT_OFFSET(struct usbdevfs_urb, buffer), (gsize)urb->buffer_length, NULL);
    if (!usb->sysfs || urb->type != USBDEVFS_URB_TYPE_CONTROL || !buffer) {
        umockdev_ioctl_client_complete(client, -1, usb->sysfs ? EINVAL : ENODEV);
    } else {
        struct flight *flight = g_new0(struct flight, 1);
        gboolean silent = usb->fault == VIRTUAL_USB_SILENT;
        int n = silent ? 0 : answer(usb, buffer->data, buffer->data + SETUP_SIZE);
        flight->client = client;
        flight->urb = umockdev_ioctl_data_ref(data);
        flight->due_us = silent ? G_MAXINT64 : g_get_monotonic_time() + LATENCY_US;
        flight->status = MIN(n, 0);
        flight->length = MAX(n, 0);
        g_queue_push_tail(&usb->flying, flight);
        umockdev_ioctl_client_complete(client, 0, 0);
    }
    if (buffer)
        umockdev_ioctl_data_unref(buffer);
    umockdev_ioctl_data_unref(data);
}

/* arg's data is the URB's address. */
static void discard(VirtualUsb *usb, UMockdevIoctlClient *client, const UMockdevIoctlData *arg) {
    gulong address = *(gulong *)arg->data;
    for (GList *l = usb->flying.head; l; l = l->next) {
        struct flight *flight = l->data;
        if (flight->client == client && flight->urb->client_addr == address) {
            flight->due_us = 0;
            flight->status = -ENOENT;
            umockdev_ioctl_client_complete(client, 0, 0);
            return;
        }
    }
    umockdev_ioctl_client_complete(client, -1, EINVAL);
}

static struct flight *pop_due(VirtualUsb *usb, const UMockdevIoctlClient *client) {
    for (GList *l = usb->flying.head; l; l = l->next) {
        struct flight *flight = l->data;
        if (flight->client != client)
            continue;
        if (!usb->sysfs)
            flight->status = -ESHUTDOWN;
        if (!usb->sysfs || flight->due_us <= g_get_monotonic_time()) {
            g_queue_delete_link(&usb->flying, l);
            return flight;
        }
    }
    return NULL;
}

static void reap(VirtualUsb *usb, UMockdevIoctlClient *client, UMockdevIoctlData *arg) {
    struct flight *flight = pop_due(usb, client);
    if (!flight) {
        int code = usb->sysfs ? EAGAIN : ENODEV;
        g_mutex_unlock(&usb->mutex);
        g_usleep(IDLE_US);
        g_mutex_lock(&usb->mutex);
        umockdev_ioctl_client_complete(client, -1, code);
        return;
    }
    urb_of(flight)->status = flight->status;
    urb_of(flight)->actual_length = flight->length;
    UMockdevIoctlData *pointer = umockdev_ioctl_data_resolve(arg, 0, sizeof(gpointer), NULL);
    umockdev_ioctl_data_set_ptr(pointer, 0, flight->urb);
    umockdev_ioctl_client_complete(client, 0, 0);
    umockdev_ioctl_data_unref(pointer);
    flight_free(flight);
}

static void get_capabilities(UMockdevIoctlClient *client, UMockdevIoctlData *arg) {
    UMockdevIoctlData *data = umockdev_ioctl_data_resolve(arg, 0, sizeof(guint32), NULL);
    *(guint32 *)data->data = USBDEVFS_CAP_REAP_AFTER_DISCONNECT;
    umockdev_ioctl_client_complete(client, 0, 0);
    umockdev_ioctl_data_unref(data);
}

static void on_vanished(UMockdevIoctlBase *handler, UMockdevIoctlClient *client, gpointer data) {
    VirtualUsb *usb = data;
    g_mutex_lock(&usb->mutex);
    for (GList *l = usb->flying.head, *next; l; l = next) {
        struct flight *flight = l->data;
        next = l->next;
        if (flight->client != client)
            continue;
        g_queue_delete_link(&usb->flying, l);
        flight_free(flight);
    }
    g_mutex_unlock(&usb->mutex);
}

static gboolean on_ioctl(UMockdevIoctlBase *handler, UMockdevIoctlClient *client, gpointer data) {
    VirtualUsb *usb = data;
    UMockdevIoctlData *arg = umockdev_ioctl_client_get_arg(client);
    gulong request = umockdev_ioctl_client_get_request(client);
    gboolean known = TRUE;
    g_mutex_lock(&usb->mutex);
    if (request == USBDEVFS_GET_CAPABILITIES)
        get_capabilities(client, arg);
    else if (request == USBDEVFS_CLAIMINTERFACE || request == USBDEVFS_RELEASEINTERFACE ||
             request == USBDEVFS_DISCONNECT_CLAIM)
        umockdev_ioctl_client_complete(client, 0, 0);
    else if (request == USBDEVFS_SUBMITURB)
        submit(usb, client, arg);
    else if (request == USBDEVFS_DISCARDURB)
        discard(usb, client, arg);
    else if (request == USBDEVFS_REAPURB || request == USBDEVFS_REAPURBNDELAY)
        reap(usb, client, arg);
    else if (request == USBDEVFS_IOCTL || request == USBDEVFS_GETDRIVER)
        umockdev_ioctl_client_complete(client, -1, ENODATA); /* there is no kernel driver */
    else
        known = FALSE;
    g_mutex_unlock(&usb->mutex);
    return known;
}

static char *descriptors_hex(const struct virtual_usb_class *class) {
    guint8 device[18] = {18,
                         1,
                         0,
                         2,
                         0,
                         0,
                         0,
                         64,
                         class->vendor & 0xff,
                         class->vendor >> 8,
                         class->product & 0xff,
                         class->product >> 8,
                         0,
                         1,
                         0,
                         NAME_INDEX,
                         SERIAL_INDEX,
                         1};
    GString *hex = g_string_new(NULL);
    for (gsize i = 0; i < sizeof device; i++)
        g_string_append_printf(hex, "%02X", device[i]);
    for (gsize i = 0; i < class->config_size; i++)
        g_string_append_printf(hex, "%02X", class->config[i]);
    return g_string_free(hex, FALSE);
}

void virtual_usb_plug(VirtualUsb *usb) {
    GError *error = NULL;
    usb->address = ++last_address;
    g_free(usb->node);
    usb->node = g_strdup_printf("/dev/bus/usb/001/%03d", usb->address);
    umockdev_testbed_attach_ioctl(testbed, usb->node, usb->handler, &error);
    g_assert_no_error(error);
    g_autofree char *hex = descriptors_hex(usb->class);
    gboolean serial = *usb->class->serial != 0;
    g_autofree char *text = g_strdup_printf(
        "P: /devices/usb1/1-%d\nN: bus/usb/001/%03d\n"
        "E: SUBSYSTEM=usb\nE: DRIVER=usb\nE: BUSNUM=001\nE: DEVNUM=%03d\n"
        "E: DEVNAME=/dev/bus/usb/001/%03d\nE: DEVTYPE=usb_device\n"
        "A: bConfigurationValue=1\\n\nA: busnum=1\\n\nA: devnum=%d\\n\nA: speed=12\\n\n"
        "A: product=%s\\n\n%s%s%sH: descriptors=%s\n",
        usb->port, usb->address, usb->address, usb->address, usb->address, usb->class->name,
        serial ? "A: serial=" : "", serial ? usb->class->serial : "", serial ? "\\n\n" : "", hex);
    virtual_usb_lock(usb);
    usb->sysfs = g_strdup_printf("/sys/devices/usb1/1-%d", usb->port);
    virtual_usb_unlock(usb);
    umockdev_testbed_add_from_string(testbed, text, &error);
    g_assert_no_error(error);
}

/* The kernel ends what is under way, refuses what comes, and says that the device is gone. */
void virtual_usb_unplug(VirtualUsb *usb) {
    virtual_usb_lock(usb);
    g_autofree char *sysfs = g_steal_pointer(&usb->sysfs);
    virtual_usb_unlock(usb);
    if (!sysfs)
        return;
    umockdev_testbed_uevent(testbed, sysfs, "remove");
    umockdev_testbed_remove_device(testbed, sysfs);
    umockdev_testbed_detach_ioctl(testbed, usb->node, NULL);
}

static void add_hub(void) {
    GError *error = NULL;
    umockdev_testbed_add_from_string(
        testbed,
        "P: /devices/usb1\nN: bus/usb/001/001\nE: SUBSYSTEM=usb\nE: DRIVER=usb\nE: BUSNUM=001\n"
        "E: DEVNUM=001\nE: DEVNAME=/dev/bus/usb/001/001\nE: DEVTYPE=usb_device\n"
        "A: bConfigurationValue=1\\n\nA: busnum=1\\n\nA: devnum=1\\n\nA: speed=12\\n\n"
        "H: "
        "descriptors=12010002090000406B1D020001000000000109021900010100E0000904000001090000000705"
        "810304000C\n",
        &error);
    g_assert_no_error(error);
    last_address = 1;
}

VirtualUsb *virtual_usb_new(const struct virtual_usb_class *class, int port, gpointer model) {
    VirtualUsb *usb = g_new0(VirtualUsb, 1);
    testbed = testbed_ref();
    if (n_devices++ == 0)
        add_hub();
    usb->class = class;
    usb->model = model;
    usb->port = port;
    g_mutex_init(&usb->mutex);
    usb->handler = umockdev_ioctl_base_new();
    testbed_connect(usb->handler, "handle-ioctl", G_CALLBACK(on_ioctl), usb);
    testbed_connect(usb->handler, "client-vanished", G_CALLBACK(on_vanished), usb);
    virtual_usb_plug(usb);
    return usb;
}

void virtual_usb_free(VirtualUsb *usb) {
    if (!usb)
        return;
    virtual_usb_unplug(usb);
    if (--n_devices == 0) {
        umockdev_testbed_uevent(testbed, "/sys/devices/usb1", "remove");
        umockdev_testbed_remove_device(testbed, "/sys/devices/usb1");
    }
    testbed_unref();
    testbed_disconnect(usb->handler, usb);
    g_clear_object(&usb->handler);
    g_queue_clear_full(&usb->flying, (GDestroyNotify)flight_free);
    g_mutex_clear(&usb->mutex);
    g_free(usb->node);
    g_free(usb);
}

void virtual_usb_set_fault(VirtualUsb *usb, enum virtual_usb_fault fault) {
    virtual_usb_lock(usb);
    usb->fault = fault;
    virtual_usb_unlock(usb);
}

int virtual_usb_n_requests(VirtualUsb *usb) {
    virtual_usb_lock(usb);
    int n = usb->n_requests;
    virtual_usb_unlock(usb);
    return n;
}

void virtual_usb_lock(VirtualUsb *usb) {
    g_mutex_lock(&usb->mutex);
}

void virtual_usb_unlock(VirtualUsb *usb) {
    g_mutex_unlock(&usb->mutex);
}
