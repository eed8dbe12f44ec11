#include "finder.h"
#include "devices_private.h"

#include "aravis/camera.h"
#include "gphoto2/gphoto2.h"
#include "modbus/scan.h"
#include "serial/detect.h"
#include "usb/scan.h"
#include "v4l2/v4l2.h"

#include "drivers/camera.h"

#include <gio/gio.h>
#include <string.h>

static gboolean vision_scan(GPtrArray *to, GError **error) {
    g_autoptr(GPtrArray) all = aravis_scan();
    for (guint i = 0; i < all->len; i++) {
        const struct aravis_found *camera = all->pdata[i];
        gboolean network = camera->address != NULL;
        struct found *found =
            found_add(to, network ? "gige" : "usb3-vision", network ? camera->address : camera->id,
                      camera->model, camera->serial);
        found->section = g_strdup_printf("[camera NAME]\ndriver = %s\ndevice = %s\n",
                                         aravis_camera_driver.info.name,
                                         *found->serial ? found->serial : found->address);
    }
    return TRUE;
}

static gboolean (*const scans[])(GPtrArray *to, GError **error) = {usb_scan, v4l2_scan, vision_scan,
                                                                   gphoto2_scan, serial_scan};

static void add_problem(GPtrArray *problems, GError *error) {
    g_ptr_array_add(problems, g_strdup(error->message));
    g_error_free(error);
}

static gboolean fill_link(const struct finder_modbus *modbus, struct modbus_link *ret,
                          GError **error) {
    *ret = (struct modbus_link){.bus = (char *)modbus->bus,
                                .baud = modbus->baud ? modbus->baud : 115200,
                                .stop_bits = 1,
                                .timeout_ms = 100,
                                .late_ms = 20};
    const char *wanted = modbus->parity ? modbus->parity : "even";
    while (modbus_parities[ret->parity] && strcmp(modbus_parities[ret->parity], wanted) != 0)
        ret->parity++;
    if (modbus_parities[ret->parity])
        return TRUE;
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                "“%s” is not a parity; give none, even or odd", wanted);
    return FALSE;
}

GPtrArray *finder_scan(const struct finder_modbus *modbus, GPtrArray *ret_problems,
                       GError **error) {
    struct modbus_link link;
    GError *problem = NULL;
    if (modbus->bus && !fill_link(modbus, &link, error))
        return NULL;
    GPtrArray *found = found_list_new();
    for (gsize i = 0; i < G_N_ELEMENTS(scans); i++)
        if (!scans[i](found, &problem))
            add_problem(ret_problems, g_steal_pointer(&problem));
    if (modbus->bus && !modbus_scan(&link, modbus->first, modbus->last, found, &problem))
        add_problem(ret_problems, g_steal_pointer(&problem));
    return found;
}

gboolean finder_gcode(const char *port, const char **ret_dialect, int *ret_baud,
                      char **ret_firmware, GError **error) {
    enum gcode_dialect dialect;
    if (!gcode_detect(port, &dialect, ret_baud, ret_firmware, error))
        return FALSE;
    *ret_dialect = gcode_dialects[dialect];
    return TRUE;
}

gboolean finder_picture_size(const char *section, int *ret_width, int *ret_height, int *ret_bits,
                             GError **error) {
    g_autoptr(Config) config = config_parse(section, "the camera", error);
    gsize n;
    const struct config_section *sections = config ? config_sections(config, &n) : NULL;
    const struct camera_driver *driver = sections ? drivers_find(&sections[0], error) : NULL;
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(Camera) camera =
        driver ? camera_open_begin(driver, &sections[0], NULL, clock, error) : NULL;
    if (!camera || !camera_open_finish(camera, error))
        return FALSE;
    *ret_width = camera->format.width;
    *ret_height = camera->format.height;
    *ret_bits = camera->format.bits;
    return TRUE;
}
