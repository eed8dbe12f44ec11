#include "usb_device.h"

#include "testbed.h"

#include <errno.h>
#include <linux/usbdevice_fs.h>
#include <string.h>
#include <sys/ioctl.h>

#define SETUP_SIZE     8
#define GET_DESCRIPTOR 6
#define SET_FEATURE    3
#define STRING_TYPE    3
#define TO_ENDPOINT    0x02 /* type of a standard request to an endpoint */

/* Duration in µs of a control request, about as on a full-speed bus. */
#define LATENCY_US 200

/* Pause in µs after a poll without a result. Without a pause, libusb would poll again immediately,
 * because the simulated node always seems ready. */
#define IDLE_US 300

/* Pause in ms after a poll without a result, for a device with bulk transfers. During the pause,
 * other devices are polled. */
#define PATIENT_MS 1

enum { MANUFACTURER_INDEX = 1, NAME_INDEX, SERIAL_INDEX, FIRST_INDEX };

struct VirtualUsb {
    const struct virtual_usb_class *class;
    gpointer model;
    int port, address;
    char *sysfs; /* NULL if the device is unplugged */
    char *node;
    UMockdevIoctlBase *handler;
    GMutex mutex;
    GQueue flying; /* of struct flight */
    /* a poll has found nothing since a transfer was last submitted or reaped */
    gboolean asked_again;
    enum virtual_usb_fault fault;
    int n_requests;
    guint8 *room; /* buffer for the data of a bulk transfer */
    int room_size;
    /* A bit for each endpoint that stalls. Endpoints that the host reads begin at bit 16, and the
     * others at bit 0. */
    guint32 halted;
};

struct flight {
    /* The client whose memory contains the transfer. Only this client may reap the transfer. The
     * pointer is not a reference. */
    UMockdevIoctlClient *client;
    UMockdevIoctlData *urb;
    gboolean waits; /* a bulk transfer without data so far */
    gint64 due_us;  /* G_MAXINT64 means never */
    int status, length;
};

/* The testbed exists as long as there is a device. */
static UMockdevTestbed *testbed;
static int n_devices, last_address;

static struct usbdevfs_urb *urb_of(const struct flight *flight) {
    return (struct usbdevfs_urb *)flight->urb->data;
}

static void flight_free(struct flight *flight) {
    umockdev_ioctl_data_unref(flight->urb);
    g_free(flight);
}

static const char *find_string(const struct virtual_usb_class *class, int index) {
    const char *const *more = class->strings;
    if (index <= SERIAL_INDEX)
        return index == NAME_INDEX     ? class->name
               : index == SERIAL_INDEX ? class->serial
                                       : class->manufacturer;
    for (int i = FIRST_INDEX; more && *more; i++, more++)
        if (i == index)
            return *more;
    return NULL;
}

static guint32 endpoint_bit(guint8 endpoint) {
    return 1u << ((endpoint & 0x0f) + (endpoint & 0x80 ? 16 : 0));
}

/* Answers a standard request. Sets *ret to the length of the answer, or to a negative errno.
 * Returns FALSE if the request is not a standard request, so that the class must answer it. */
static gboolean answer_standard(VirtualUsb *usb, const guint8 *setup, guint8 *data, int *ret) {
    int length = setup[6] | setup[7] << 8, n = 4;
    guint8 descriptor[256] = {4, STRING_TYPE, 0x09, 0x04}; /* the languages: English */
    if (setup[0] == TO_ENDPOINT && setup[1] == SET_FEATURE) {
        usb->halted |= endpoint_bit(setup[4]);
        *ret = 0;
        return TRUE;
    }
    if (setup[0] != 0x80 || setup[1] != GET_DESCRIPTOR || setup[3] != STRING_TYPE)
        return FALSE;
    const char *text = setup[2] > 0 ? find_string(usb->class, setup[2]) : NULL;
    for (n = text ? 2 : n; text && *text && n < 254; text++, n += 2) {
        descriptor[n] = (guint8)*text;
        descriptor[n + 1] = 0;
    }
    descriptor[0] = (guint8)n;
    *ret = text || setup[2] == 0 ? MIN(n, length) : -EPIPE;
    memcpy(data, descriptor, (gsize)MAX(*ret, 0));
    return TRUE;
}

static gboolean is_halted(const VirtualUsb *usb, guint8 endpoint) {
    return usb->fault == VIRTUAL_USB_STALLS || usb->halted & endpoint_bit(endpoint);
}

static void submit_control(VirtualUsb *usb, struct flight *flight, UMockdevIoctlData *buffer) {
    gboolean silent = usb->fault == VIRTUAL_USB_SILENT;
    guint8 *setup = buffer->data, *data = buffer->data + SETUP_SIZE;
    int n = 0;
    if (!silent && !answer_standard(usb, setup, data, &n)) {
        usb->n_requests++;
        n = usb->fault == VIRTUAL_USB_STALLS ? -EPIPE
                                             : usb->class->control(usb->model, setup, data);
        if (usb->fault == VIRTUAL_USB_SHORT && n > 0)
            n /= 2;
    }
    flight->due_us = silent ? G_MAXINT64 : g_get_monotonic_time() + LATENCY_US;
    flight->status = MIN(n, 0);
    flight->length = MAX(n, 0);
}

static void send_out(VirtualUsb *usb, struct flight *flight, UMockdevIoctlData *buffer) {
    const struct usbdevfs_urb *urb = urb_of(flight);
    flight->due_us = G_MAXINT64;
    if (usb->fault == VIRTUAL_USB_SILENT)
        return;
    usb->n_requests++;
    int n = is_halted(usb, urb->endpoint)
                ? -EPIPE
                : usb->class->bulk_out(usb->model, urb->endpoint, buffer->data, urb->buffer_length);
    flight->due_us = 0;
    flight->status = MIN(n, 0);
    flight->length = MAX(n, 0);
}

/* Asks the class for the data of a waiting bulk transfer. If there is no data yet, the transfer
 * continues to wait. */
static void usb_device_fill(VirtualUsb *usb, struct flight *flight) {
    const struct usbdevfs_urb *urb = urb_of(flight);
    int size = urb->buffer_length;
    if (usb->fault == VIRTUAL_USB_SILENT)
        return;
    if (usb->room_size < size)
        usb->room = g_realloc(usb->room, (gsize)(usb->room_size = size));
    int n = is_halted(usb, urb->endpoint)
                ? -EPIPE
                : usb->class->bulk_in(usb->model, urb->endpoint, usb->room, size);
    if (n == -EAGAIN)
        return;
    if (usb->fault == VIRTUAL_USB_SHORT && n > 1)
        n /= 2;
    flight->waits = FALSE;
    flight->due_us = 0;
    flight->status = MIN(n, 0);
    if (n <= 0)
        return;
    g_autoptr(UMockdevIoctlData) buffer = umockdev_ioctl_data_resolve(
        flight->urb, G_STRUCT_OFFSET(struct usbdevfs_urb, buffer), (gsize)n, NULL);
    memcpy(buffer->data, usb->room, (gsize)n);
    flight->length = n;
}

static void usb_device_submit(VirtualUsb *usb, UMockdevIoctlClient *client,
                              UMockdevIoctlData *arg) {
    g_autoptr(UMockdevIoctlData) data =
        umockdev_ioctl_data_resolve(arg, 0, sizeof(struct usbdevfs_urb), NULL);
    const struct usbdevfs_urb *urb = (const struct usbdevfs_urb *)data->data;
    gboolean in = urb->endpoint & 0x80, bulk = urb->type == USBDEVFS_URB_TYPE_BULK;
    gboolean served = in ? usb->class->bulk_in != NULL : usb->class->bulk_out != NULL;
    gboolean known = urb->type == USBDEVFS_URB_TYPE_CONTROL || (bulk && served);
    if (!usb->sysfs || !known || urb->buffer_length <= 0) {
        umockdev_ioctl_client_complete(client, -1, usb->sysfs ? EINVAL : ENODEV);
        return;
    }
    struct flight *flight = g_new0(struct flight, 1);
    flight->client = client;
    flight->urb = umockdev_ioctl_data_ref(data);
    flight->waits = bulk && in;
    flight->due_us = G_MAXINT64;
    if (!flight->waits) {
        g_autoptr(UMockdevIoctlData) buffer = umockdev_ioctl_data_resolve(
            data, G_STRUCT_OFFSET(struct usbdevfs_urb, buffer), (gsize)urb->buffer_length, NULL);
        (bulk ? send_out : submit_control)(usb, flight, buffer);
    }
    g_queue_push_tail(&usb->flying, flight);
    usb->asked_again = FALSE;
    umockdev_ioctl_client_complete(client, 0, 0);
}

/* Discards a transfer. The data of arg is the address of the transfer's URB. */
static void discard(VirtualUsb *usb, UMockdevIoctlClient *client, const UMockdevIoctlData *arg) {
    gulong address = *(gulong *)arg->data;
    for (GList *l = usb->flying.head; l; l = l->next) {
        struct flight *flight = l->data;
        if (flight->client == client && flight->urb->client_addr == address) {
            flight->due_us = 0;
            flight->status = -ENOENT;
            flight->waits = FALSE;
            umockdev_ioctl_client_complete(client, 0, 0);
            return;
        }
    }
    umockdev_ioctl_client_complete(client, -1, EINVAL);
}

static struct flight *pop_due(VirtualUsb *usb, const UMockdevIoctlClient *client) {
    /* The endpoints that have been asked for data. Of each endpoint, only the first transfer is
     * asked for, so that transfers get their data in order. */
    guint32 asked = 0;
    for (GList *l = usb->flying.head; l; l = l->next) {
        struct flight *flight = l->data;
        if (flight->client != client)
            continue;
        if (usb->sysfs && flight->waits && !(asked & endpoint_bit(urb_of(flight)->endpoint))) {
            asked |= endpoint_bit(urb_of(flight)->endpoint);
            usb_device_fill(usb, flight);
        }
        if (!usb->sysfs)
            flight->status = -ESHUTDOWN;
        if (!usb->sysfs || flight->due_us <= g_get_monotonic_time()) {
            g_queue_delete_link(&usb->flying, l);
            return flight;
        }
    }
    return NULL;
}

static gboolean on_patient(gpointer data) {
    umockdev_ioctl_client_complete(data, -1, EAGAIN);
    return G_SOURCE_REMOVE;
}

static gint64 next_due_us(const VirtualUsb *usb, const UMockdevIoctlClient *client) {
    gint64 due_us = G_MAXINT64;
    for (const GList *l = usb->flying.head; l; l = l->next) {
        const struct flight *flight = l->data;
        if (flight->client == client)
            due_us = MIN(due_us, flight->due_us);
    }
    return due_us;
}

/* Answers a poll that found nothing. The answer comes after a pause, because continuous polls would
 * use the processor fully.
 *
 * A device with bulk transfers waits most of the time, and there may be eight such devices. libusb
 * submits the next transfer only after a poll that found nothing. The first such poll is therefore
 * answered immediately. For later polls, the pause ends when a transfer is due. */
static void try_later(VirtualUsb *usb, UMockdevIoctlClient *client) {
    if (!usb->sysfs || !usb->class->bulk_in) {
        int code = usb->sysfs ? EAGAIN : ENODEV;
        g_mutex_unlock(&usb->mutex);
        g_usleep(IDLE_US);
        g_mutex_lock(&usb->mutex);
        umockdev_ioctl_client_complete(client, -1, code);
        return;
    }
    gint64 due_us = next_due_us(usb, client);
    gboolean first = !usb->asked_again && due_us == G_MAXINT64;
    usb->asked_again = TRUE;
    if (first) {
        umockdev_ioctl_client_complete(client, -1, EAGAIN);
        return;
    }
    GSource *source = g_timeout_source_new(PATIENT_MS);
    g_source_set_ready_time(source, MIN(due_us, g_get_monotonic_time() + PATIENT_MS * 1000));
    g_source_set_callback(source, on_patient, g_object_ref(client), g_object_unref);
    g_source_attach(source, g_main_context_get_thread_default());
    g_source_unref(source);
}

static void reap(VirtualUsb *usb, UMockdevIoctlClient *client, UMockdevIoctlData *arg) {
    struct flight *flight = pop_due(usb, client);
    if (!flight) {
        try_later(usb, client);
        return;
    }
    usb->asked_again = FALSE;
    urb_of(flight)->status = flight->status;
    urb_of(flight)->actual_length = flight->length;
    g_autoptr(UMockdevIoctlData) pointer =
        umockdev_ioctl_data_resolve(arg, 0, sizeof(gpointer), NULL);
    umockdev_ioctl_data_set_ptr(pointer, 0, flight->urb);
    umockdev_ioctl_client_complete(client, 0, 0);
    flight_free(flight);
}

static void usb_device_on_vanished(UMockdevIoctlBase *handler, UMockdevIoctlClient *client,
                                   gpointer data) {
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

static gboolean usb_device_on_ioctl(UMockdevIoctlBase *handler, UMockdevIoctlClient *client,
                                    gpointer data) {
    VirtualUsb *usb = data;
    UMockdevIoctlData *arg = umockdev_ioctl_client_get_arg(client);
    gulong request = umockdev_ioctl_client_get_request(client);
    gboolean known = TRUE;
    g_mutex_lock(&usb->mutex);
    if (request == USBDEVFS_GET_CAPABILITIES) {
        /* Transfers may have any size, as with xHCI controllers. */
        g_autoptr(UMockdevIoctlData) data32 =
            umockdev_ioctl_data_resolve(arg, 0, sizeof(guint32), NULL);
        *(guint32 *)data32->data = USBDEVFS_CAP_REAP_AFTER_DISCONNECT |
                                   USBDEVFS_CAP_NO_PACKET_SIZE_LIM |
                                   USBDEVFS_CAP_BULK_SCATTER_GATHER;
        umockdev_ioctl_client_complete(client, 0, 0);
    } else if (request == USBDEVFS_CLAIMINTERFACE || request == USBDEVFS_RELEASEINTERFACE ||
               request == USBDEVFS_DISCONNECT_CLAIM) {
        umockdev_ioctl_client_complete(client, 0, 0);
    } else if (request == USBDEVFS_SUBMITURB) {
        usb_device_submit(usb, client, arg);
    } else if (request == USBDEVFS_DISCARDURB) {
        discard(usb, client, arg);
    } else if (request == USBDEVFS_REAPURB || request == USBDEVFS_REAPURBNDELAY) {
        reap(usb, client, arg);
    } else if (request == USBDEVFS_CLEAR_HALT) {
        g_autoptr(UMockdevIoctlData) endpoint =
            umockdev_ioctl_data_resolve(arg, 0, sizeof(guint), NULL);
        usb->halted &= ~endpoint_bit((guint8) * (guint *)endpoint->data);
        umockdev_ioctl_client_complete(client, 0, 0);
    } else if (request == USBDEVFS_IOCTL || request == USBDEVFS_GETDRIVER) {
        umockdev_ioctl_client_complete(client, -1, ENODATA); /* there is no kernel driver */
    } else {
        known = FALSE;
    }
    g_mutex_unlock(&usb->mutex);
    return known;
}

static char *descriptors_hex(const struct virtual_usb_class *class) {
    gboolean super = class->speed_mbit_s >= 5000;
    const guint8 *kind = class->device_class;
    guint8 device[18] = {18, 1, 0, super ? 3 : 2, kind[0], kind[1], kind[2], super ? 9 : 64};
    device[8] = class->vendor & 0xff;
    device[9] = class->vendor >> 8;
    device[10] = class->product & 0xff;
    device[11] = class->product >> 8;
    device[13] = 1;
    device[14] = class->manufacturer ? MANUFACTURER_INDEX : 0;
    device[15] = NAME_INDEX;
    device[16] = SERIAL_INDEX;
    device[17] = 1;
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
    int speed = usb->class->speed_mbit_s > 0 ? usb->class->speed_mbit_s : 12;
    g_autofree char *text = g_strdup_printf(
        "P: /devices/usb1/1-%d\nN: bus/usb/001/%03d\n"
        "E: SUBSYSTEM=usb\nE: DRIVER=usb\nE: BUSNUM=001\nE: DEVNUM=%03d\n"
        "E: DEVNAME=/dev/bus/usb/001/%03d\nE: DEVTYPE=usb_device\n"
        "A: bConfigurationValue=1\\n\nA: busnum=1\\n\nA: devnum=%d\\n\nA: speed=%d\\n\n"
        "A: product=%s\\n\n%s%s%sH: descriptors=%s\n",
        usb->port, usb->address, usb->address, usb->address, usb->address, speed, usb->class->name,
        serial ? "A: serial=" : "", serial ? usb->class->serial : "", serial ? "\\n\n" : "", hex);
    virtual_usb_lock(usb);
    usb->sysfs = g_strdup_printf("/sys/devices/usb1/1-%d", usb->port);
    usb->halted = 0;
    virtual_usb_unlock(usb);
    umockdev_testbed_add_from_string(testbed, text, &error);
    g_assert_no_error(error);
}

/* As the kernel does, this function ends all transfers, refuses new transfers, and reports that the
 * device is gone. */
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

VirtualUsb *virtual_usb_new(const struct virtual_usb_class *class, int port, gpointer model) {
    static const char hub[] =
        "P: /devices/usb1\nN: bus/usb/001/001\nE: SUBSYSTEM=usb\nE: DRIVER=usb\nE: BUSNUM=001\n"
        "E: DEVNUM=001\nE: DEVNAME=/dev/bus/usb/001/001\nE: DEVTYPE=usb_device\n"
        "A: bConfigurationValue=1\\n\nA: busnum=1\\n\nA: devnum=1\\n\nA: speed=12\\n\n"
        "H: descriptors=12010002090000406B1D02000100000000010902190001"
        "0100E0000904000001090000000705810304000C\n";
    VirtualUsb *usb = g_new0(VirtualUsb, 1);
    GError *error = NULL;
    testbed = testbed_ref();
    if (n_devices++ == 0) {
        umockdev_testbed_add_from_string(testbed, hub, &error);
        g_assert_no_error(error);
        last_address = 1;
    }
    usb->class = class;
    usb->model = model;
    usb->port = port;
    g_mutex_init(&usb->mutex);
    usb->handler = umockdev_ioctl_base_new();
    testbed_connect(usb->handler, "handle-ioctl", G_CALLBACK(usb_device_on_ioctl), usb);
    testbed_connect(usb->handler, "client-vanished", G_CALLBACK(usb_device_on_vanished), usb);
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
    g_free(usb->room);
    g_free(usb);
}

void virtual_usb_set_fault(VirtualUsb *usb, enum virtual_usb_fault fault) {
    virtual_usb_lock(usb);
    usb->fault = fault;
    virtual_usb_unlock(usb);
}

void virtual_usb_halt(VirtualUsb *usb, guint8 endpoint) {
    virtual_usb_lock(usb);
    usb->halted |= endpoint_bit(endpoint);
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
