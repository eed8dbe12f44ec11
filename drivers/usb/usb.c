#include "usb.h"

#include "drivers/device.h"
#include "drivers/lock.h"
#include "drivers/recording.h"

#include <gio/gio.h>
#include <libusb.h>
#include <string.h>

#define CLOSE_US G_USEC_PER_SEC

struct transfer {
    UsbDevice *usb;
    struct libusb_transfer *libusb;
    UsbFunc func;
    gpointer user;
    gboolean in; /* data goes from the device to the computer */
};

/* The process has one context while any device is open. */
struct context {
    int refs;
    libusb_context *libusb;
    libusb_hotplug_callback_handle hotplug;
    GSource *source;
    GHashTable *tags; /* maps a file descriptor to the tag of the source */
    GQueue done;      /* of struct transfer: transfers that have ended and are not reported yet */
    GList *devices;
};

struct context_source {
    GSource base;
    struct context *context;
};

struct UsbDevice {
    struct context *context;
    libusb_device_handle *handle;
    char *who, *product, *serial, *path;
    int interface; /* -1 if none is claimed */
    Lock *lock;    /* held while the interface is claimed */
    GList *flying; /* of struct transfer: submitted, but not ended */
    UsbLostFunc lost_func;
    gpointer user;
    gboolean lost, reported;
};

static struct context *shared;

static void transfer_free(struct transfer *transfer) {
    libusb_free_transfer(transfer->libusb);
    g_free(transfer);
}

static GError *library_error(UsbDevice *usb, int code) {
    static const struct {
        int code;
        enum device_error error;
        const char *what;
    } known[] = {
        {LIBUSB_ERROR_NO_DEVICE, DEVICE_ERROR_DISCONNECTED,
         "unplugged, or its power is gone" ERROR_ADVICE "check its cable"},
        {LIBUSB_ERROR_TIMEOUT, DEVICE_ERROR_TIMEOUT,
         "did not answer in time" ERROR_ADVICE "check its cable and power"},
        {LIBUSB_ERROR_PIPE, DEVICE_ERROR_PROTOCOL,
         "refused a request (stall)" ERROR_ADVICE "check that its firmware is the maker's"},
        {LIBUSB_ERROR_BUSY, DEVICE_ERROR_BUSY,
         "another program or another section of the rig file uses it" ERROR_ADVICE
         "end that program, or correct that section"},
        {LIBUSB_ERROR_ACCESS, DEVICE_ERROR_UNSUPPORTED,
         "may not be opened by this user" ERROR_ADVICE "install etc/udev/60-mesorig.rules"},
    };
    usb->lost |= code == LIBUSB_ERROR_NO_DEVICE;
    for (gsize i = 0; i < G_N_ELEMENTS(known); i++)
        if (known[i].code == code)
            return device_error_new(known[i].error, usb->who, "%s", known[i].what);
    return device_error_new(DEVICE_ERROR_PROTOCOL, usb->who,
                            "USB failed: %s" ERROR_ADVICE "check its cable", libusb_strerror(code));
}

/* Records a request: the eight bytes of its setup packet, and the data that it sends. */
static void record_request(const UsbDevice *usb, const struct usb_request *request) {
    if (!recording_is_on())
        return;
    const guint8 setup[] = {request->type,          request->request,
                            request->value & 0xff,  (guint8)(request->value >> 8),
                            request->index & 0xff,  (guint8)(request->index >> 8),
                            request->length & 0xff, (guint8)(request->length >> 8)};
    g_autoptr(GByteArray) bytes = g_byte_array_new();
    g_byte_array_append(bytes, setup, sizeof setup);
    if (!(request->type & LIBUSB_ENDPOINT_IN) && request->data)
        g_byte_array_append(bytes, request->data, request->length);
    recording_bytes((struct recording_bus){"usb", usb->path}, RECORDING_SENT, bytes->data,
                    bytes->len);
}

/* Records the data that a request has read, or why a request failed. Records nothing for a request
 * that has sent its data without an error. */
static void record_answer(const UsbDevice *usb, gboolean in, int code, const guint8 *data,
                          gsize n) {
    const struct recording_bus bus = {"usb", usb->path};
    if (code == LIBUSB_ERROR_PIPE)
        recording_note(bus, "stall");
    else if (code)
        recording_note(bus, "%s", libusb_strerror(code));
    else if (in)
        recording_bytes(bus, RECORDING_RECEIVED, data, n);
}

static void report_transfer(struct transfer *transfer) {
    static const int codes[] = {[LIBUSB_TRANSFER_COMPLETED] = LIBUSB_SUCCESS,
                                [LIBUSB_TRANSFER_ERROR] = LIBUSB_ERROR_IO,
                                [LIBUSB_TRANSFER_TIMED_OUT] = LIBUSB_ERROR_TIMEOUT,
                                [LIBUSB_TRANSFER_CANCELLED] = LIBUSB_ERROR_INTERRUPTED,
                                [LIBUSB_TRANSFER_STALL] = LIBUSB_ERROR_PIPE,
                                [LIBUSB_TRANSFER_NO_DEVICE] = LIBUSB_ERROR_NO_DEVICE,
                                [LIBUSB_TRANSFER_OVERFLOW] = LIBUSB_ERROR_OVERFLOW};
    UsbDevice *usb = transfer->usb;
    int code = codes[transfer->libusb->status];
    g_autoptr(GError) error = code ? library_error(usb, code) : NULL;
    gsize n = error ? 0 : (gsize)transfer->libusb->actual_length;
    record_answer(usb, transfer->in, code, libusb_control_transfer_get_data(transfer->libusb), n);
    transfer->func(usb, libusb_control_transfer_get_data(transfer->libusb), n, error,
                   transfer->user);
    transfer_free(transfer);
}

/* Returns the next lost device to report, or NULL if there is none. A device is reported when all
 * its transfers have ended. It does not wait for other lost devices. */
static UsbDevice *next_lost(const struct context *context) {
    for (GList *l = context->devices; l; l = l->next) {
        UsbDevice *usb = l->data;
        if (usb->lost && !usb->reported && !usb->flying)
            return usb;
    }
    return NULL;
}

static gboolean has_news(const struct context *context) {
    return !g_queue_is_empty((GQueue *)&context->done) || next_lost(context);
}

/* On Linux, libusb keeps its deadlines with a timerfd, but its API requires this check as well. */
static gboolean usb_prepare(GSource *source, gint *timeout) {
    struct context *context = ((struct context_source *)source)->context;
    struct timeval next;
    *timeout = -1;
    if (!libusb_pollfds_handle_timeouts(context->libusb) &&
        libusb_get_next_timeout(context->libusb, &next) == 1)
        *timeout = (gint)(next.tv_sec * 1000 + next.tv_usec / 1000 + 1);
    return has_news(context);
}

static gboolean usb_check(GSource *source) {
    struct context *context = ((struct context_source *)source)->context;
    GHashTableIter iter;
    gpointer tag;
    g_hash_table_iter_init(&iter, context->tags);
    while (g_hash_table_iter_next(&iter, NULL, &tag))
        if (g_source_query_unix_fd(source, tag))
            return TRUE;
    struct timeval next;
    return has_news(context) ||
           (libusb_get_next_timeout(context->libusb, &next) == 1 && !next.tv_sec && !next.tv_usec);
}

static void context_unref(struct context *context);

/* Handles the events of libusb, and then makes the callbacks. A callback may close any device.
 */
static gboolean usb_dispatch(GSource *source, GSourceFunc unused, gpointer unused_data) {
    struct context *context = ((struct context_source *)source)->context;
    struct timeval zero = {0};
    struct transfer *transfer;
    UsbDevice *usb;
    context->refs++;
    libusb_handle_events_timeout_completed(context->libusb, &zero, NULL);
    while ((transfer = g_queue_pop_head(&context->done)))
        report_transfer(transfer);
    while ((usb = next_lost(context))) {
        usb->reported = TRUE;
        usb->lost_func(usb, usb->user);
    }
    context_unref(context);
    return G_SOURCE_CONTINUE;
}

static GSourceFuncs source_funcs = {
    .prepare = usb_prepare, .check = usb_check, .dispatch = usb_dispatch};

static void LIBUSB_CALL on_fd_added(int fd, short events, void *data) {
    struct context *context = data;
    gpointer tag = g_source_add_unix_fd(context->source, fd, (GIOCondition)events);
    g_hash_table_insert(context->tags, GINT_TO_POINTER(fd), tag);
}

static void LIBUSB_CALL on_fd_removed(int fd, void *data) {
    struct context *context = data;
    gpointer tag = g_hash_table_lookup(context->tags, GINT_TO_POINTER(fd));
    if (tag)
        g_source_remove_unix_fd(context->source, tag);
    g_hash_table_remove(context->tags, GINT_TO_POINTER(fd));
}

static int LIBUSB_CALL on_left(libusb_context *unused, libusb_device *device,
                               libusb_hotplug_event event, void *data) {
    struct context *context = data;
    for (GList *l = context->devices; l; l = l->next) {
        UsbDevice *usb = l->data;
        if (libusb_get_device(usb->handle) == device)
            usb->lost = TRUE;
    }
    return 0;
}

static struct context *context_ref(const char *who, GError **error) {
    if (shared) {
        shared->refs++;
        return shared;
    }
    struct context *context = g_new0(struct context, 1);
    int code = libusb_init(&context->libusb);
    if (code) {
        device_error_set(error, DEVICE_ERROR_UNSUPPORTED, who,
                         "USB cannot be used here: %s" ERROR_ADVICE
                         "check that /dev/bus/usb exists",
                         libusb_strerror(code));
        g_free(context);
        return NULL;
    }
    context->refs = 1;
    context->tags = g_hash_table_new(NULL, NULL);
    context->source = g_source_new(&source_funcs, sizeof(struct context_source));
    ((struct context_source *)context->source)->context = context;
    g_source_set_name(context->source, "mesorig usb");
    const struct libusb_pollfd **fds = libusb_get_pollfds(context->libusb);
    for (int i = 0; fds && fds[i]; i++)
        on_fd_added(fds[i]->fd, fds[i]->events, context);
    libusb_free_pollfds(fds);
    libusb_set_pollfd_notifiers(context->libusb, on_fd_added, on_fd_removed, context);
    libusb_hotplug_register_callback(context->libusb, LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT, 0,
                                     LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY,
                                     LIBUSB_HOTPLUG_MATCH_ANY, on_left, context, &context->hotplug);
    g_source_attach(context->source, NULL);
    shared = context;
    return context;
}

static void context_unref(struct context *context) {
    if (--context->refs > 0)
        return;
    shared = NULL;
    libusb_hotplug_deregister_callback(context->libusb, context->hotplug);
    libusb_set_pollfd_notifiers(context->libusb, NULL, NULL, NULL);
    g_source_destroy(context->source);
    g_source_unref(context->source);
    libusb_exit(context->libusb);
    g_hash_table_unref(context->tags);
    g_free(context);
}

/* Called by libusb, perhaps within a request of another device. Therefore this function only
 * records the end of the transfer. */
static void LIBUSB_CALL on_transfer(struct libusb_transfer *libusb) {
    struct transfer *transfer = libusb->user_data;
    UsbDevice *usb = transfer->usb;
    usb->flying = g_list_remove(usb->flying, transfer);
    g_queue_push_tail(&usb->context->done, transfer);
}

gboolean usb_control(UsbDevice *usb, const struct usb_request *request, guint timeout_ms,
                     UsbFunc func, gpointer user, GError **error) {
    gboolean out = !(request->type & LIBUSB_ENDPOINT_IN);
    struct transfer *transfer = g_new0(struct transfer, 1);
    *transfer = (struct transfer){usb, libusb_alloc_transfer(0), func, user, !out};
    /* libusb frees the buffer with free(). */
    guint8 *buffer = calloc(1, LIBUSB_CONTROL_SETUP_SIZE + (gsize)request->length);
    if (!transfer->libusb || !buffer)
        g_error("%s: out of memory", usb->who);
    libusb_fill_control_setup(buffer, request->type, request->request, request->value,
                              request->index, request->length);
    if (out && request->data)
        memcpy(buffer + LIBUSB_CONTROL_SETUP_SIZE, request->data, request->length);
    libusb_fill_control_transfer(transfer->libusb, usb->handle, buffer, on_transfer, transfer,
                                 timeout_ms);
    transfer->libusb->flags = LIBUSB_TRANSFER_FREE_BUFFER;
    record_request(usb, request);
    int code = usb->lost ? LIBUSB_ERROR_NO_DEVICE : libusb_submit_transfer(transfer->libusb);
    if (code == 0) {
        usb->flying = g_list_append(usb->flying, transfer);
        return TRUE;
    }
    transfer_free(transfer);
    g_propagate_error(error, library_error(usb, code));
    return FALSE;
}

int usb_control_sync(UsbDevice *usb, const struct usb_request *request, guint8 *answer,
                     GError **error) {
    g_autofree guint8 *sent = g_malloc0(MAX(request->length, 1));
    gboolean in = request->type & LIBUSB_ENDPOINT_IN;
    if (!in && request->data)
        memcpy(sent, request->data, request->length);
    record_request(usb, request);
    int n = usb->lost ? LIBUSB_ERROR_NO_DEVICE
                      : libusb_control_transfer(usb->handle, request->type, request->request,
                                                request->value, request->index, in ? answer : sent,
                                                request->length, USB_SYNC_MS);
    record_answer(usb, in, MIN(n, 0), answer, (gsize)MAX(n, 0));
    if (n >= 0)
        return n;
    g_propagate_error(error, library_error(usb, n));
    return -1;
}

void usb_close(UsbDevice *usb) {
    if (!usb)
        return;
    gint64 limit = g_get_monotonic_time() + CLOSE_US;
    for (GList *l = usb->flying; l; l = l->next)
        libusb_cancel_transfer(((struct transfer *)l->data)->libusb);
    /* Wait until the kernel has returned the transfers, which it normally does at once. */
    while (usb->flying && g_get_monotonic_time() < limit) {
        struct timeval some = {0, 10000};
        libusb_handle_events_timeout_completed(usb->context->libusb, &some, NULL);
    }
    for (GList *l = usb->context->done.head, *next; l; l = next) {
        struct transfer *transfer = l->data;
        next = l->next;
        if (transfer->usb == usb) {
            g_queue_delete_link(&usb->context->done, l);
            transfer_free(transfer);
        }
    }
    usb->context->devices = g_list_remove(usb->context->devices, usb);
    if (usb->flying) {
        g_warning("%s: the kernel did not return its USB requests, so the device stays open; if it "
                  "cannot be opened again, restart this program",
                  usb->who);
        return;
    }
    if (usb->interface >= 0)
        libusb_release_interface(usb->handle, usb->interface);
    libusb_close(usb->handle);
    lock_release(usb->lock);
    context_unref(usb->context);
    g_free(usb->who);
    g_free(usb->product);
    g_free(usb->serial);
    g_free(usb->path);
    g_free(usb);
}

char *usb_words(const char *what, const char *serial, const char *path) {
    if (*serial)
        return g_strdup_printf("the %s with serial %s", what, serial);
    return *path ? g_strdup_printf("the %s at %s", what, path)
                 : g_strdup_printf("the only %s", what);
}

guint8 usb_interface(const UsbDevice *usb) {
    return (guint8)usb->interface;
}

const char *usb_product(const UsbDevice *usb) {
    return usb->product;
}

const char *usb_serial(const UsbDevice *usb) {
    return usb->serial;
}

/* Returns the string descriptor with an index. Returns "" if there is none or it cannot be read.
 */
static char *read_string(UsbDevice *usb, guint8 index) {
    guint8 answer[255] = {0};
    struct usb_request request = {LIBUSB_ENDPOINT_IN,
                                  LIBUSB_REQUEST_GET_DESCRIPTOR,
                                  (guint16)(LIBUSB_DT_STRING << 8 | index),
                                  0x0409 /* English */,
                                  NULL,
                                  sizeof answer};
    int n = index ? usb_control_sync(usb, &request, answer, NULL) : -1;
    n = MIN(n, answer[0]);
    if (n < 2 || answer[1] != LIBUSB_DT_STRING)
        return g_strdup("");
    gunichar2 text[127];
    int length = (n - 2) / 2;
    for (int i = 0; i < length; i++)
        text[i] = (gunichar2)(answer[2 + 2 * i] | answer[3 + 2 * i] << 8);
    char *utf8 = g_utf16_to_utf8(text, length, NULL, NULL, NULL);
    return utf8 ? utf8 : g_strdup("");
}

char *usb_path_of(libusb_device *device) {
    guint8 ports[8];
    int n = libusb_get_port_numbers(device, ports, G_N_ELEMENTS(ports));
    GString *path = g_string_new(NULL);
    g_string_printf(path, "%u", libusb_get_bus_number(device));
    for (int i = 0; i < n; i++)
        g_string_append_printf(path, "%c%u", i ? '.' : '-', ports[i]);
    return g_string_free(path, FALSE);
}

/* Locks the device. The key is made from its device node, which changes when the device is plugged
 * in again. */
static gboolean lock_device(UsbDevice *usb, GError **error) {
    libusb_device *device = libusb_get_device(usb->handle);
    const int bus = libusb_get_bus_number(device), address = libusb_get_device_address(device);
    g_autofree char *node = g_strdup_printf("/dev/bus/usb/%03d/%03d", bus, address);
    g_autofree char *key = lock_key_of_node("usb", node);
    g_autofree char *path = usb_path_of(device);
    g_autofree char *what = g_strdup_printf("USB device %s", path);
    if (!key)
        key = g_strdup_printf("usb %d:%d", bus, address);
    usb->lock = lock_take(key, LOCK_ALONE, what, error);
    if (!usb->lock)
        error_details_add_subject(error, usb->who);
    return usb->lock != NULL;
}

static gboolean usb_claim(UsbDevice *usb, const struct usb_match *match, GError **error) {
    struct libusb_config_descriptor *config;
    int number = -1;
    if (usb->interface >= 0)
        return TRUE;
    if (libusb_get_active_config_descriptor(libusb_get_device(usb->handle), &config) == 0) {
        for (int i = config->bNumInterfaces - 1; i >= 0; i--)
            if (config->interface[i].num_altsetting > 0 &&
                config->interface[i].altsetting[0].bInterfaceClass == match->interface_class)
                number = config->interface[i].altsetting[0].bInterfaceNumber;
        libusb_free_config_descriptor(config);
    }
    if (number < 0)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, usb->who,
                                "has no interface of the kind this driver speaks to; it is another "
                                "device, or it is in its bootloader" ERROR_ADVICE
                                "check serial and path, and plug the device in again");
    if (!lock_device(usb, error))
        return FALSE;
    libusb_set_auto_detach_kernel_driver(usb->handle, 1);
    int code = libusb_claim_interface(usb->handle, number);
    if (code) {
        g_propagate_error(error, library_error(usb, code));
        return FALSE;
    }
    usb->interface = number;
    return TRUE;
}

static gboolean has_name(const struct usb_match *match, const UsbDevice *usb) {
    return !match->product_prefix || g_str_has_prefix(usb->product, match->product_prefix);
}

/* Opens the device and reads product and serial number. */
static UsbDevice *try_open(struct context *context, const struct usb_match *match,
                           libusb_device *device, const struct libusb_device_descriptor *descriptor,
                           GError **error) {
    UsbDevice *usb = g_new0(UsbDevice, 1);
    usb->who = g_strdup(match->who);
    usb->path = usb_path_of(device);
    usb->interface = -1;
    usb->context = context;
    int code = libusb_open(device, &usb->handle);
    if (code) {
        g_propagate_error(error, library_error(usb, code));
        g_free(usb->who);
        g_free(usb->path);
        g_free(usb);
        return NULL;
    }
    context->refs++;
    context->devices = g_list_append(context->devices, usb);
    usb->product = read_string(usb, descriptor->iProduct);
    recording_note((struct recording_bus){"usb", usb->path}, "%04x:%04x %s", descriptor->idVendor,
                   descriptor->idProduct, usb->product);
    if (!match->read_serial || !has_name(match, usb)) {
        usb->serial = read_string(usb, descriptor->iSerialNumber);
        recording_hide(usb->serial, NULL);
        return usb;
    }
    /* The interface must be claimed before a serial number can be read through it. */
    if (usb_claim(usb, match, error)) {
        usb->serial = match->read_serial(usb);
        return usb;
    }
    usb_close(usb);
    return NULL;
}

/* Opens and returns all devices that match. Appends to seen, as text, every device of the vendor,
 * products and path that could be opened. *error is the error of the last device that could not be
 * opened. */
static GList *find_all(struct context *context, const struct usb_match *match, GString *seen,
                       GError **error) {
    libusb_device **all = NULL;
    GList *found = NULL;
    gssize n = libusb_get_device_list(context->libusb, &all);
    for (gssize i = 0; i < n; i++) {
        struct libusb_device_descriptor descriptor;
        const guint16 *product = match->products;
        if (libusb_get_device_descriptor(all[i], &descriptor) ||
            descriptor.idVendor != match->vendor)
            continue;
        while (*product && *product != descriptor.idProduct)
            product++;
        if (!*product)
            continue;
        g_autofree char *path = usb_path_of(all[i]);
        if (match->path && *match->path && strcmp(match->path, path) != 0)
            continue;
        GError *failed = NULL;
        UsbDevice *usb = try_open(context, match, all[i], &descriptor, &failed);
        if (!usb) {
            g_clear_error(error);
            g_propagate_error(error, failed);
            continue;
        }
        g_string_append_printf(seen, "%s%s (serial \"%s\", path %s)", seen->len ? ", " : "",
                               *usb->product ? usb->product : "a device", usb->serial, path);
        if (has_name(match, usb) &&
            (!match->serial || !*match->serial || g_strcmp0(usb->serial, match->serial) == 0))
            found = g_list_append(found, usb);
        else
            usb_close(usb);
    }
    if (n >= 0)
        libusb_free_device_list(all, 1);
    return found;
}

static void close_one(gpointer usb) {
    usb_close(usb);
}

UsbDevice *usb_open(const struct usb_match *match, UsbLostFunc lost, gpointer user,
                    GError **error) {
    struct context *context = context_ref(match->who, error);
    if (!context)
        return NULL;
    g_autoptr(GString) seen = g_string_new(NULL);
    GError *refused = NULL;
    GList *found = find_all(context, match, seen, &refused);
    UsbDevice *usb = NULL;
    if (!found && refused) {
        g_propagate_error(error, g_steal_pointer(&refused));
    } else if (!found) {
        device_error_set(error, DEVICE_ERROR_DISCONNECTED, match->who,
                         "no such device is plugged in (vendor %04x, serial \"%s\", path \"%s\"); "
                         "found: %s" ERROR_ADVICE "check its cable, serial and path",
                         match->vendor, match->serial ? match->serial : "",
                         match->path ? match->path : "", seen->len ? seen->str : "none");
    } else if (found->next) {
        device_error_set(
            error, DEVICE_ERROR_RANGE, match->who,
            "more than one device fits: %s" ERROR_ADVICE "select one by serial or path", seen->str);
    } else if (usb_claim(found->data, match, error)) {
        usb = found->data;
        usb->lost_func = lost;
        usb->user = user;
        found = g_list_delete_link(found, found);
    }
    g_list_free_full(found, close_one);
    g_clear_error(&refused);
    context_unref(context);
    return usb;
}
