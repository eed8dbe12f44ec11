#include "connect.h"

#include "drivers/device.h"
#include "registers.h"

#include <arpa/inet.h>
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define GVCP_PORT  3956
#define PROBE_MS   300
#define N_PROBES   3
#define CONTROL_AT 0x0a00 /* bootstrap register that says whether a program controls the camera */
#define RETRY_US   100000

static GMutex list_lock;

/* Held while a camera is opened, because Aravis 0.8 reads the cameras' XML with a parser whose
 * state is static. */
static GMutex parser_lock;

void aravis_list_lock(void) {
    g_mutex_lock(&list_lock);
}

void aravis_list_unlock(void) {
    g_mutex_unlock(&list_lock);
}

/* Reads the control register. Returns FALSE if the camera does not answer within a second. The
 * time-outs of a full connection would take much longer. */
static gboolean probe(int fd, guint32 *ret_control) {
    static const guint8 request[] = {0x42, 1, 0, 0x80, 0, 4, 0xab, 0xcd, 0, 0, CONTROL_AT >> 8, 0};
    guint8 reply[64];
    for (int i = 0; i < N_PROBES; i++) {
        struct pollfd pollfd = {fd, POLLIN, 0};
        if (send(fd, request, sizeof request, 0) < 0 || poll(&pollfd, 1, PROBE_MS) <= 0)
            continue;
        gssize n = recv(fd, reply, sizeof reply, 0);
        if (n < 12 || memcmp(reply, "\0\0\0\x81", 4) != 0 || reply[6] != 0xab || reply[7] != 0xcd)
            continue;
        *ret_control =
            (guint32)reply[8] << 24 | (guint32)reply[9] << 16 | (guint32)reply[10] << 8 | reply[11];
        return TRUE;
    }
    return FALSE;
}

/* Reads the control register of the camera at an IP address. *ret_ours is the local address from
 * which the route to the camera starts. */
static gboolean connect_ask(const char *ip, guint32 *ret_control, GInetAddress **ret_ours,
                            GError **error) {
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(GVCP_PORT)}, ours;
    socklen_t size = sizeof ours;
    inet_pton(AF_INET, ip, &to.sin_addr);
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                                "cannot open a network connection to the camera at %s: "
                                "%s" ERROR_ADVICE "end other programs on this computer",
                                ip, g_strerror(errno));
    gboolean routed = connect(fd, (struct sockaddr *)&to, sizeof to) == 0 &&
                      getsockname(fd, (struct sockaddr *)&ours, &size) == 0;
    gboolean answered = routed && probe(fd, ret_control);
    if (answered)
        *ret_ours = g_inet_address_new_from_bytes((guint8 *)&ours.sin_addr, G_SOCKET_FAMILY_IPV4);
    else
        device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                         routed ? "no camera answers at %s" ERROR_ADVICE "check its power and cable"
                                : "there is no route to %s" ERROR_ADVICE
                                  "check the network's settings",
                         ip);
    close(fd);
    return answered;
}

static ArvDevice *open_gige(const char *ip, GError **error) {
    g_autoptr(GInetAddress) ours = NULL, theirs = g_inet_address_new_from_string(ip);
    g_autoptr(GError) why = NULL;
    g_autoptr(ArvDevice) device = NULL;
    guint32 control = 0;
    if (!connect_ask(ip, &control, &ours, error))
        return NULL;
    if (!(control & 3)) {
        g_mutex_lock(&parser_lock);
        device = arv_gv_device_new(ours, theirs, &why);
        g_mutex_unlock(&parser_lock);
        if (!device) {
            device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                             "the camera at %s answers, but Aravis cannot open it: %s" ERROR_ADVICE
                             "switch the camera off and on, and try again",
                             ip, why ? why->message : "no reason is given");
            return NULL;
        }
    }
    if (device && arv_gv_device_is_controller(ARV_GV_DEVICE(device)))
        return g_steal_pointer(&device);
    device_error_set(error, DEVICE_ERROR_BUSY, NULL,
                     "another program controls the camera" ERROR_ADVICE "end that program");
    return NULL;
}

static gboolean is_any(const char *id, const char *const *names, gsize n) {
    for (gsize i = 0; i < n; i++)
        if (g_strcmp0(names[i], id) == 0)
            return TRUE;
    return FALSE;
}

/* Returns Aravis's id of a USB camera, or NULL if the camera is not found. Does not search the
 * network, because that takes a second. */
static char *look_up_usb(const char *id) {
    ArvInterface *usb = arv_uv_interface_get_instance();
    char *found = NULL;
    arv_interface_update_device_list(usb);
    for (guint i = 0; i < arv_interface_get_n_devices(usb) && !found; i++) {
        const char *names[] = {arv_interface_get_device_id(usb, i),
                               arv_interface_get_device_serial_nbr(usb, i),
                               arv_interface_get_device_physical_id(usb, i)};
        if (is_any(id, names, G_N_ELEMENTS(names)))
            found = g_strdup(names[0]);
    }
    return found;
}

static char *look_up_all(const char *id, gboolean *ret_gige) {
    char *found = NULL;
    arv_update_device_list();
    for (guint i = 0; i < arv_get_n_devices() && !found; i++) {
        const char *names[] = {arv_get_device_id(i), arv_get_device_serial_nbr(i),
                               arv_get_device_physical_id(i), arv_get_device_address(i)};
        if (!is_any(id, names, G_N_ELEMENTS(names)))
            continue;
        *ret_gige = g_strcmp0(arv_get_device_protocol(i), "GigEVision") == 0;
        found = g_strdup(*ret_gige ? arv_get_device_address(i) : arv_get_device_id(i));
    }
    return found;
}

/* Returns the IP address of a GigE Vision camera and sets *ret_gige to TRUE, or returns Aravis's id
 * of a camera of another kind. Returns NULL if the camera is not found. */
static char *connect_look_up(const char *id, gboolean *ret_gige, GError **error) {
    aravis_list_lock();
    char *found = look_up_usb(id);
    if (!found)
        found = look_up_all(id, ret_gige);
    aravis_list_unlock();
    if (!found)
        device_error_set(
            error, DEVICE_ERROR_DISCONNECTED, NULL,
            "no camera \"%s\" was found" ERROR_ADVICE
            "check its power and cable; `arv-tool` and `mesorig devices` list the names of cameras",
            id);
    return found;
}

/* Returns the serial number of the USB camera with this Aravis id. Returns NULL if the camera is
 * not in Aravis's list, which look_up_usb() has updated. */
static char *serial_of(const char *id) {
    ArvInterface *usb = arv_uv_interface_get_instance();
    char *serial = NULL;
    aravis_list_lock();
    for (guint i = 0; i < arv_interface_get_n_devices(usb) && !serial; i++)
        if (g_strcmp0(arv_interface_get_device_id(usb, i), id) == 0)
            serial = g_strdup(arv_interface_get_device_serial_nbr(usb, i));
    aravis_list_unlock();
    return serial;
}

static char *read_usb_attribute(const char *folder, const char *name) {
    g_autofree char *file = g_build_filename("/sys/bus/usb/devices", folder, name, NULL);
    char *text = NULL;
    return g_file_get_contents(file, &text, NULL, NULL) ? g_strstrip(text) : NULL;
}

/* Returns the path of a USB camera's device node. Finds it by the serial number, because Aravis
 * does not report the node. Returns NULL if the camera is not found. */
static char *usb_node(const char *id) {
    g_autofree char *wanted = serial_of(id);
    g_autoptr(GDir) dir = g_dir_open("/sys/bus/usb/devices", 0, NULL);
    const char *name;
    while (wanted && dir && (name = g_dir_read_name(dir))) {
        g_autofree char *serial = read_usb_attribute(name, "serial");
        g_autofree char *bus = read_usb_attribute(name, "busnum");
        g_autofree char *number = read_usb_attribute(name, "devnum");
        if (bus && number && g_strcmp0(serial, wanted) == 0)
            return g_strdup_printf("/dev/bus/usb/%03d/%03d", atoi(bus), atoi(number));
    }
    return NULL;
}

/* Locks a camera. Returns FALSE if another process has it. For a USB camera whose device node
 * was not found, sets *ret_lock to NULL and returns TRUE. The kernel still lets only one program
 * use such a camera. */
static gboolean lock_camera(const char *name, gboolean gige, Lock **ret_lock, GError **error) {
    g_autofree char *node = gige ? NULL : usb_node(name);
    g_autofree char *key = gige   ? g_strconcat("gige ", name, NULL)
                           : node ? lock_key_of_node("usb", node)
                                  : NULL;
    *ret_lock = key ? lock_take(key, LOCK_ALONE, name, error) : NULL;
    return !key || *ret_lock;
}

static ArvDevice *open_usb(const char *name, GError **error) {
    g_autoptr(GError) theirs = NULL;
    g_mutex_lock(&parser_lock);
    ArvDevice *device = arv_open_device(name, &theirs);
    g_mutex_unlock(&parser_lock);
    if (!device)
        device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                         "Aravis cannot open the USB camera %s: %s" ERROR_ADVICE
                         "check its cable, and whether this user may open USB devices",
                         name, theirs ? theirs->message : "no reason is given");
    return device;
}

ArvDevice *aravis_connect(const char *id, double control_s, Lock **ret_lock, GError **error) {
    gint64 until = g_get_monotonic_time() + (gint64)(control_s * 1e6);
    g_autoptr(GInetAddress) address = g_inet_address_new_from_string(id);
    gboolean gige = address != NULL;
    g_autofree char *name = gige ? g_strdup(id) : connect_look_up(id, &gige, error);
    *ret_lock = NULL;
    if (!name)
        return NULL;
    for (;;) {
        g_autoptr(GError) why = NULL;
        ArvDevice *device = NULL;
        if (*ret_lock || lock_camera(name, gige, ret_lock, &why))
            device = gige ? open_gige(name, &why) : open_usb(name, &why);
        if (device) {
            aravis_registers_record(device, name);
            return device;
        }
        if (why->code != DEVICE_ERROR_BUSY || g_get_monotonic_time() > until) {
            g_clear_pointer(ret_lock, lock_release);
            g_propagate_error(error, g_steal_pointer(&why));
            return NULL;
        }
        g_usleep(RETRY_US);
    }
}
