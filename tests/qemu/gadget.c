/*
 * The same virtual USB devices (sim/virtual/usb_device.h) on a real kernel: gadgets of dummy_hcd,
 * their requests answered through FunctionFS. Port n is the only one of bus n. Root only, in a
 * machine that is thrown away.
 */
#include "virtual/testbed.h"
#include "virtual/usb_device.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/usb/functionfs.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>

#define GADGETS     "/sys/kernel/config/usb_gadget"
#define APPEARS_US  (10 * G_USEC_PER_SEC)
#define POLL_MS     20
#define HS_INTERVAL 8 /* high speed counts intervals in powers of two, up to 16 */

struct VirtualUsb {
    const struct virtual_usb_class *class;
    gpointer model;
    int port;
    char *gadget, *mount_point;
    int ep0;
    GThread *thread;
    gboolean stopping, plugged;
    GMutex mutex;
    enum virtual_usb_fault fault;
    int n_requests;
};

void testbed_enter(char **argv) {
}

static void put(const VirtualUsb *usb, const char *file, const char *text) {
    g_autofree char *path = g_build_filename(usb->gadget, file, NULL);
    int fd = open(path, O_WRONLY | O_CLOEXEC);
    if (fd < 0 || write(fd, text, strlen(text)) != (gssize)strlen(text))
        g_error("cannot write \"%s\" to %s: %s", text, path, g_strerror(errno));
    close(fd);
}

static void make_folder(const VirtualUsb *usb, const char *folder) {
    g_autofree char *path = g_build_filename(usb->gadget, folder, NULL);
    if (mkdir(path, 0755) < 0)
        g_error("cannot make %s: %s", path, g_strerror(errno));
}

/* The interface's descriptors once for full speed and once for high speed. */
static void write_descriptors(const VirtualUsb *usb) {
    gsize n = usb->class->config_size - usb->class->config[0];
    gsize size = sizeof(struct usb_functionfs_descs_head_v2) + 2 * sizeof(guint32) + 2 * n;
    g_autofree guint8 *all = g_malloc0(size);
    struct usb_functionfs_descs_head_v2 head = {FUNCTIONFS_DESCRIPTORS_MAGIC_V2, (guint32)size,
                                                FUNCTIONFS_HAS_FS_DESC | FUNCTIONFS_HAS_HS_DESC |
                                                    FUNCTIONFS_ALL_CTRL_RECIP};
    guint32 counts[2] = {0, 0};
    guint8 *to = all + sizeof head + sizeof counts;
    memcpy(to, usb->class->config + usb->class->config[0], n);
    memcpy(to + n, to, n);
    for (gsize at = 0; at < n; at += to[at], counts[0]++)
        if (to[at + 1] == 5)
            to[n + at + 6] = HS_INTERVAL;
    counts[1] = counts[0];
    memcpy(all, &head, sizeof head);
    memcpy(all + sizeof head, counts, sizeof counts);
    if (write(usb->ep0, all, size) != (gssize)size)
        g_error("FunctionFS does not take the descriptors: %s", g_strerror(errno));
    struct usb_functionfs_strings_head strings = {FUNCTIONFS_STRINGS_MAGIC, sizeof strings, 0, 0};
    if (write(usb->ep0, &strings, sizeof strings) != sizeof strings)
        g_error("FunctionFS does not take the strings: %s", g_strerror(errno));
}

/* A transfer in the other direction than asked for stalls. */
static void stall(const VirtualUsb *usb, gboolean in) {
    if ((in ? read(usb->ep0, NULL, 0) : write(usb->ep0, NULL, 0)) < 0)
        g_debug("stalled: %s", g_strerror(errno));
}

static void answer_in(VirtualUsb *usb, const guint8 *setup, guint8 *data) {
    int n = usb->class->control(usb->model, setup, data);
    if (usb->fault == VIRTUAL_USB_SHORT && n > 0)
        n /= 2;
    if (n < 0)
        stall(usb, TRUE);
    else if (write(usb->ep0, data, (gsize)n) < 0)
        g_debug("nobody took an answer: %s", g_strerror(errno));
}

/* Data has been acknowledged before the model sees it, so that it can refuse only what has none. */
static void answer_out(VirtualUsb *usb, const guint8 *setup, guint8 *data, gsize length) {
    if (length > 0) {
        if (read(usb->ep0, data, length) == (gssize)length)
            usb->class->control(usb->model, setup, data);
    } else if (usb->class->control(usb->model, setup, data) < 0) {
        stall(usb, FALSE);
    } else if (read(usb->ep0, NULL, 0) < 0) {
        g_debug("not acknowledged: %s", g_strerror(errno));
    }
}

/* Locked, but while it waits. Any look at what comes next would stall the request, so there is none
 * until it may. */
static void keep_silent(VirtualUsb *usb, gboolean in) {
    while (usb->fault == VIRTUAL_USB_SILENT && usb->plugged && !g_atomic_int_get(&usb->stopping)) {
        g_mutex_unlock(&usb->mutex);
        g_usleep(POLL_MS * 1000);
        g_mutex_lock(&usb->mutex);
    }
    stall(usb, in);
}

static void answer(VirtualUsb *usb, const struct usb_ctrlrequest *request) {
    guint8 setup[8];
    gsize length = GUINT16_FROM_LE(request->wLength);
    g_autofree guint8 *data = g_malloc0(MAX(length, 64));
    gboolean in = request->bRequestType & 0x80;
    memcpy(setup, request, sizeof setup);
    g_mutex_lock(&usb->mutex);
    usb->n_requests++;
    if (usb->fault == VIRTUAL_USB_STALLS)
        stall(usb, in);
    else if (usb->fault == VIRTUAL_USB_SILENT)
        keep_silent(usb, in);
    else if (in)
        answer_in(usb, setup, data);
    else
        answer_out(usb, setup, data, length);
    g_mutex_unlock(&usb->mutex);
}

static gpointer run(gpointer data) {
    VirtualUsb *usb = data;
    while (!g_atomic_int_get(&usb->stopping)) {
        struct usb_functionfs_event event;
        struct pollfd ready = {usb->ep0, POLLIN, 0};
        if (poll(&ready, 1, POLL_MS) <= 0)
            continue;
        if (read(usb->ep0, &event, sizeof event) != sizeof event)
            continue;
        if (event.type == FUNCTIONFS_SETUP)
            answer(usb, &event.u.setup);
    }
    return NULL;
}

static gboolean is_there(const VirtualUsb *usb) {
    g_autofree char *file = g_strdup_printf("/sys/bus/usb/devices/%d-1/devnum", usb->port);
    g_autofree char *number = NULL;
    if (!g_file_get_contents(file, &number, NULL, NULL))
        return FALSE;
    g_autofree char *node = g_strdup_printf("/dev/bus/usb/%03d/%03d", usb->port, atoi(number));
    return g_file_test(node, G_FILE_TEST_EXISTS);
}

/* The kernel needs some time to enumerate the device, and udev to report it. */
void virtual_usb_plug(VirtualUsb *usb) {
    g_autofree char *udc = g_strdup_printf("dummy_udc.%d", usb->port - 1);
    gint64 limit = g_get_monotonic_time() + APPEARS_US;
    put(usb, "UDC", udc);
    usb->plugged = TRUE;
    while (!is_there(usb)) {
        if (g_get_monotonic_time() > limit)
            g_error("the kernel does not find %s", udc);
        g_usleep(10000);
    }
    if (system("udevadm settle --timeout=10") != 0)
        g_error("udev does not settle");
}

void virtual_usb_unplug(VirtualUsb *usb) {
    if (usb->plugged)
        put(usb, "UDC", "\n");
    usb->plugged = FALSE;
}

static void make_gadget(const VirtualUsb *usb) {
    g_autofree char *vendor = g_strdup_printf("0x%04x", usb->class->vendor);
    g_autofree char *product = g_strdup_printf("0x%04x", usb->class->product);
    make_folder(usb, "");
    put(usb, "idVendor", vendor);
    put(usb, "idProduct", product);
    make_folder(usb, "strings/0x409");
    put(usb, "strings/0x409/product", usb->class->name);
    if (*usb->class->serial)
        put(usb, "strings/0x409/serialnumber", usb->class->serial);
    make_folder(usb, "configs/c.1");
}

VirtualUsb *virtual_usb_new(const struct virtual_usb_class *class, int port, gpointer model) {
    VirtualUsb *usb = g_new0(VirtualUsb, 1);
    g_autofree char *name = g_strdup_printf("port%d", port);
    g_autofree char *function = g_strdup_printf("functions/ffs.%s", name);
    usb->class = class;
    usb->model = model;
    usb->port = port;
    usb->gadget = g_build_filename(GADGETS, name, NULL);
    usb->mount_point = g_strconcat("/tmp/ffs-", name, NULL);
    g_mutex_init(&usb->mutex);
    make_gadget(usb);
    make_folder(usb, function);
    g_autofree char *ep0 = g_build_filename(usb->mount_point, "ep0", NULL);
    g_autofree char *target = g_build_filename(usb->gadget, function, NULL);
    g_autofree char *link = g_strdup_printf("%s/configs/c.1/ffs", usb->gadget);
    mkdir(usb->mount_point, 0755);
    if (mount(name, usb->mount_point, "functionfs", 0, NULL) < 0 ||
        (usb->ep0 = open(ep0, O_RDWR | O_CLOEXEC)) < 0)
        g_error("cannot use FunctionFS: %s", g_strerror(errno));
    write_descriptors(usb);
    if (symlink(target, link) < 0)
        g_error("cannot add the function: %s", g_strerror(errno));
    usb->thread = g_thread_new("gadget", run, usb);
    virtual_usb_plug(usb);
    return usb;
}

static void remove_folder(const VirtualUsb *usb, const char *folder) {
    g_autofree char *path = g_build_filename(usb->gadget, folder, NULL);
    rmdir(path);
}

void virtual_usb_free(VirtualUsb *usb) {
    if (!usb)
        return;
    g_autofree char *function = g_strdup_printf("functions/ffs.port%d", usb->port);
    g_autofree char *link = g_strdup_printf("%s/configs/c.1/ffs", usb->gadget);
    virtual_usb_unplug(usb);
    g_atomic_int_set(&usb->stopping, TRUE);
    g_thread_join(usb->thread);
    unlink(link);
    close(usb->ep0);
    umount(usb->mount_point);
    remove_folder(usb, function);
    remove_folder(usb, "configs/c.1");
    remove_folder(usb, "strings/0x409");
    remove_folder(usb, "");
    g_mutex_clear(&usb->mutex);
    g_free(usb->gadget);
    g_free(usb->mount_point);
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
