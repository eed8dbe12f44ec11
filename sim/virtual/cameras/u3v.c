#include "u3v_private.h"

#include <errno.h>

#define CONTROL_ENDPOINT 1
#define STREAM_ENDPOINT  2
#define GUID_INDEX       4

#define INTERFACE(number, n_endpoints, protocol)                                                   \
    9, 4, number, 0, n_endpoints, 0xef, 0x05, protocol, 0
#define BULK(address) 7, 5, address, 2, 0x00, 0x04, 0, 6, 0x30, 15, 0, 0, 0

/* Device information descriptor: index of the string with the GUID, and support of all speeds. */
#define DEVICE_INFO 20, 0x24, 1, 1, 0, 1, 0, 1, 0, 1, 0, GUID_INDEX, 1, 2, 0, 0, 0, 3, 0, 0x0f

#define CONFIG_SIZE (9 + 8 + 9 + 20 + 26 + 9 + 13)

static const guint8 config[] = {9,           2,
                                CONFIG_SIZE, 0,
                                2,           1,
                                0,           0x80,
                                50,          8,
                                11,          0,
                                2,           0xef,
                                5,           0,
                                0,           INTERFACE(0, 2, 0),
                                DEVICE_INFO, BULK(0x81),
                                BULK(0x01),  INTERFACE(1, 1, 2),
                                BULK(0x82)};
G_STATIC_ASSERT(sizeof config == CONFIG_SIZE);

static int virtual_u3v_control(gpointer model, const guint8 *setup, guint8 *data) {
    return -EPIPE;
}

static int bulk_out(gpointer model, guint8 endpoint, const guint8 *data, int n) {
    VirtualU3v *camera = model;
    if (endpoint != CONTROL_ENDPOINT)
        return -EPIPE;
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->imager.mutex);
    return u3v_command(camera, data, n);
}

static int bulk_in(gpointer model, guint8 endpoint, guint8 *data, int size) {
    VirtualU3v *camera = model;
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->imager.mutex);
    return (endpoint & 0x0f) == CONTROL_ENDPOINT ? u3v_answer(camera, data, size)
                                                 : u3v_stream(camera, data, size);
}

VirtualU3v *virtual_u3v_new(const struct virtual_camera_options *options, int port) {
    VirtualU3v *camera = g_new0(VirtualU3v, 1);
    g_autofree char *guid = g_strdup_printf("MESO%08X", g_str_hash(options->serial));
    imager_init(&camera->imager, options,
                imager_genicam(options->cfa, &u3v_transport, options->processing), &u3v_bus,
                camera);
    camera->class = (struct virtual_usb_class){.vendor = 0x1d50,
                                               .product = 0x60ff,
                                               .name = "VirtualCamera",
                                               .serial = camera->imager.options.serial,
                                               .config = config,
                                               .config_size = sizeof config,
                                               .control = virtual_u3v_control,
                                               .device_class = {0xef, 2, 1},
                                               .speed_mbit_s = 5000,
                                               .manufacturer = "Mesorig",
                                               .strings = g_new0(const char *, 2),
                                               .bulk_out = bulk_out,
                                               .bulk_in = bulk_in};
    ((const char **)camera->class.strings)[0] = g_steal_pointer(&guid);
    u3v_reset(camera);
    imager_start(&camera->imager);
    camera->usb = virtual_usb_new(&camera->class, port, camera);
    return camera;
}

void virtual_u3v_free(VirtualU3v *camera) {
    if (!camera)
        return;
    virtual_usb_free(camera->usb);
    imager_quit(&camera->imager);
    u3v_drop(camera);
    imager_clear(&camera->imager);
    g_strfreev((char **)camera->class.strings);
    g_free(camera);
}

const char *virtual_u3v_serial(const VirtualU3v *camera) {
    return camera->imager.options.serial;
}

VirtualUsb *virtual_u3v_usb(VirtualU3v *camera) {
    return camera->usb;
}

void virtual_u3v_fail(VirtualU3v *camera, const struct virtual_camera_faults *faults) {
    imager_fail(&camera->imager, faults);
}

void virtual_u3v_unplug(VirtualU3v *camera) {
    virtual_usb_unplug(camera->usb);
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->imager.mutex);
    u3v_reset(camera);
}

void virtual_u3v_plug(VirtualU3v *camera) {
    virtual_usb_plug(camera->usb);
}

void virtual_u3v_halt_stream(VirtualU3v *camera) {
    virtual_usb_halt(camera->usb, 0x80 | STREAM_ENDPOINT);
}

void virtual_u3v_pulse(VirtualU3v *camera) {
    imager_pulse(&camera->imager);
}

void virtual_u3v_state(VirtualU3v *camera, struct virtual_camera_state *ret) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->imager.mutex);
    imager_get_state(&camera->imager, ret);
}
