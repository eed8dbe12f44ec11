/* mesorig devices finds what is plugged in, and the section that it prints opens the device without
 * changes. */
#include "conformance/conformance.h"

#include "aravis/camera.h"
#include "lib/camera_open.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "modbus/devices.h"
#include "rig/finder.h"
#include "usb/relays.h"
#include "usb/tic.h"
#include "v4l2/v4l2.h"
#include "virtual/cameras/u3v.h"
#include "virtual/cameras/v4l2.h"
#include "virtual/modbus.h"
#include "virtual/testbed.h"
#include "virtual/usb_device.h"
#include "virtual/usb_relays.h"
#include "virtual/usb_tic.h"

#include <string.h>

#define MESORIG BUILD_DIR "/bin/mesorig"

static GPtrArray *scan(const struct finder_modbus *modbus) {
    g_autoptr(GPtrArray) problems = g_ptr_array_new_with_free_func(g_free);
    GPtrArray *all = ok(finder_scan(modbus, problems, ERR));
    g_assert_cmpuint(problems->len, ==, 0);
    return all;
}

static const struct found *find(const GPtrArray *all, const char *bus, const char *address) {
    for (guint i = 0; i < all->len; i++) {
        const struct found *found = all->pdata[i];
        if (strcmp(found->bus, bus) == 0 && strcmp(found->address, address) == 0)
            return found;
    }
    return NULL;
}

/* A section as it would be pasted, with NAME and one comment filled in; it must live as long. */
static Config *paste(const struct found *found, const char *comment, const char *value,
                     const struct config_section **ret) {
    g_assert_nonnull(found);
    g_assert_nonnull(found->section);
    g_autoptr(GString) text = g_string_new(found->section);
    g_string_replace(text, "NAME", "test", 1);
    if (comment)
        g_assert_cmpuint(g_string_replace(text, comment, value, 0), ==, 1);
    Config *config = ok(config_parse(text->str, "rig.conf", ERR));
    *ret = config_sections(config, &(gsize){0});
    return config;
}

TEST(usb) {
    g_autoptr(VirtualTic) tic = virtual_tic_new("00123456", 1, 4000, 100);
    g_autoptr(VirtualTic) other_tic = virtual_tic_new("00777777", 4, 4000, 100);
    g_autoptr(VirtualRelays) board = virtual_relays_new("USBRelay4", "LAMPS", 2, FALSE);
    g_autoptr(VirtualRelays) other_board = virtual_relays_new("USBRelay2", "OTHER", 5, FALSE);
    g_autoptr(VirtualRelays) stranger = virtual_relays_new("Thermometer", "XXXXX", 3, FALSE);
    g_autoptr(GPtrArray) all = scan(&(struct finder_modbus){0});
    g_autoptr(Clock) clock = clock_new_real();
    const struct config_section *section;
    GError *error = NULL;

    const struct found *found = find(all, "usb", "1-1");
    g_autoptr(Config) tic_config =
        paste(found, "# steps_per_deg = microsteps in a degree of the axis", "steps_per_deg = 100",
              &section);
    g_assert_cmpstr(found->serial, ==, "00123456");
    g_assert_true(strstr(found->what, "Tic T834") != NULL);
    g_autoptr(Axis) axis = axis_open(&tic_axis_driver, section, NULL, clock, &error);
    g_assert_no_error(error);

    g_autoptr(Config) lamps_config = paste(find(all, "usb", "1-2"), NULL, NULL, &section);
    g_autoptr(LampBank) bank = lamps_open(&usb_relays_driver, section, NULL, clock, &error);
    g_assert_no_error(error);
    g_assert_cmpint(bank->n, ==, 4);

    found = find(all, "usb", "1-3");
    g_assert_nonnull(found);
    g_assert_cmpstr(found->what, ==, "Thermometer");
    g_assert_null(found->section);
    g_assert_null(find(all, "usb", "1")); /* the hub */
}

TEST(video) {
    g_autoptr(VirtualV4l2) good =
        virtual_v4l2_new(&(struct virtual_v4l2_config){.port = "2-1.1", .cfa = CFA_GRBG});
    g_autoptr(VirtualV4l2) webcam = virtual_v4l2_new(
        &(struct virtual_v4l2_config){.number = 1, .port = "2-1.2", .only_compressed = TRUE});
    g_autoptr(VirtualV4l2) bare = virtual_v4l2_new(
        &(struct virtual_v4l2_config){.number = 2,
                                      .port = "2-2",
                                      .bits = 8,
                                      .lacks = VIRTUAL_V4L2_NO_EXPOSURE | VIRTUAL_V4L2_NO_GAIN});
    g_autoptr(GPtrArray) all = scan(&(struct finder_modbus){0});
    g_autoptr(Clock) clock = clock_new_real();
    const struct config_section *section;
    GError *error = NULL;
    g_autoptr(Config) config = paste(find(all, "video", "/dev/video0"), NULL, NULL, &section);
    g_autoptr(Camera) camera = camera_open(&v4l2_camera_driver, section, NULL, clock, &error);
    g_assert_no_error(error);
    g_assert_cmpint(camera->format.width, ==, 64);
    g_assert_cmpint(camera->format.cfa, ==, CFA_GRBG);
    g_assert_cmpint(camera->format.bits, ==, 12);

    const struct found *found = find(all, "video", "/dev/video1");
    g_assert_null(found->section);
    g_assert_true(strstr(found->note, "compressed") != NULL);
    found = find(all, "video", "/dev/video2");
    g_assert_true(strstr(found->note, "no control for: exposure, gain") != NULL);
    g_autoptr(Config) bare_config =
        paste(found, "# fixed_exposure_us = exposure time from its data sheet",
              "fixed_exposure_us = 5000", &section);
    g_autoptr(Camera) second = camera_open(&v4l2_camera_driver, section, NULL, clock, &error);
    g_assert_no_error(error);
    g_assert_null(find(all, "usb", "2-2")); /* told once, as video */
}

TEST(usb3_vision) {
    struct virtual_camera_options options = {
        .serial = "TOP", .width = 320, .height = 240, .bits = 12, .cfa = CFA_GBRG};
    g_autoptr(VirtualU3v) device = virtual_u3v_new(&options, 1);
    g_autoptr(GPtrArray) all = scan(&(struct finder_modbus){0});
    g_autoptr(Clock) clock = clock_new_real();
    const struct config_section *section;
    GError *error = NULL;
    const struct found *found = NULL;
    for (guint i = 0; i < all->len && !found; i++)
        if (strcmp(((const struct found *)all->pdata[i])->bus, "usb3-vision") == 0)
            found = all->pdata[i];
    g_autoptr(Config) config = paste(found, NULL, NULL, &section);
    g_assert_cmpstr(found->what, ==, "Mesorig VirtualCamera");
    g_assert_cmpstr(found->serial, ==, "TOP");
    g_assert_null(find(all, "usb", "1-1")); /* told once */
    g_autoptr(Camera) camera = camera_open(&aravis_camera_driver, section, NULL, clock, &error);
    g_assert_no_error(error);
    g_assert_cmpint(camera->format.width, ==, 320);
    g_assert_cmpint(camera->format.cfa, ==, CFA_GBRG);
}

/* libgphoto2 knows a camera by its USB ids, and does not open it for that. */
TEST(still_camera) {
    /* one interface of the class Still Image, with two bulk endpoints and one for interrupts */
    static const guint8 config[] = {9, 2, 39, 0, 1, 1, 0, 0xc0, 1,    9, 4, 0, 0,
                                    3, 6, 1,  1, 0, 7, 5, 0x81, 2,    0, 2, 0, 7,
                                    5, 2, 2,  0, 2, 0, 7, 5,    0x83, 3, 8, 0, 10};
    static const struct virtual_usb_class nikon_d90 = {.vendor = 0x04b0,
                                                       .product = 0x0421,
                                                       .name = "NIKON DSC D90",
                                                       .serial = "000003123456",
                                                       .config = config,
                                                       .config_size = sizeof config,
                                                       .speed_mbit_s = 480};
    VirtualUsb *usb = virtual_usb_new(&nikon_d90, 3, NULL);
    g_autoptr(GPtrArray) all = scan(&(struct finder_modbus){0});
    const struct found *found = find(all, "usb", "1-3");
    g_assert_nonnull(found);
    g_assert_cmpstr(found->what, ==, "NIKON DSC D90");
    g_assert_cmpstr(found->serial, ==, "000003123456");
    g_assert_true(
        g_str_has_prefix(found->section, "[camera NAME]\ndriver = gphoto2-camera\nport = 1-3\n"));
    g_assert_cmpint(virtual_usb_n_requests(usb), ==, 0);
    virtual_usb_free(usb);
}

TEST(modbus) {
    struct virtual_modbus_options options = {.unit = 7};
    GError *error = NULL;
    g_autoptr(VirtualModbus) device = virtual_modbus_new(&options, &error);
    g_assert_no_error(error);
    const char *bus = virtual_modbus_bus(device);
    g_autoptr(GPtrArray) none = scan(&(struct finder_modbus){0});
    g_autofree char *there = g_strdup_printf("%s, unit 7", bus);
    g_autofree char *not_there = g_strdup_printf("%s, unit 8", bus);
    g_assert_null(find(none, "modbus", there));
    g_autoptr(GPtrArray) all = scan(&(struct finder_modbus){.bus = bus, .first = 6, .last = 8});
    const struct found *found = find(all, "modbus", there);
    g_assert_nonnull(found);
    g_assert_cmpstr(found->what, ==, "answers to registers and 16 coils");
    g_assert_true(g_str_has_prefix(found->section, "[lamps NAME]\ndriver = modbus-relays\n"));
    g_assert_true(strstr(found->section, "\nn = 16\n") != NULL);
    g_assert_true(strstr(found->section, "\n# driver = modbus-axis\n") != NULL);
    g_assert_null(find(all, "modbus", not_there));
    struct virtual_modbus_state state;
    virtual_modbus_state(device, &state);
    for (int i = 0; i < VIRTUAL_MODBUS_BITS; i++)
        g_assert_false(state.coils[i]);
}

TEST(modbus_not_there) {
    g_autoptr(GPtrArray) problems = g_ptr_array_new_with_free_func(g_free);
    struct finder_modbus modbus = {.bus = "/dev/no-such-line", .first = 1, .last = 2};
    GError *error = NULL;
    g_autoptr(GPtrArray) all = finder_scan(&modbus, problems, &error);
    g_assert_no_error(error);
    g_assert_cmpuint(problems->len, ==, 1);
    g_assert_true(strstr(problems->pdata[0], "/dev/no-such-line") != NULL);
    modbus.parity = "funny";
    g_assert_null(finder_scan(&modbus, problems, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT);
    g_clear_error(&error);
}

/* The devices answer from other threads of this process while it waits for the program. */
TEST(command) {
    g_autoptr(VirtualTic) tic = virtual_tic_new("00123456", 1, 4000, 100);
    g_autoptr(VirtualV4l2) camera = virtual_v4l2_new(&(struct virtual_v4l2_config){0});
    g_autofree char *people = NULL, *json = NULL, *none = NULL;
    g_assert_cmpint(process_run((const char *[]){MESORIG, "devices", NULL}, &people, NULL), ==, 0);
    g_assert_true(strstr(people, "serial = 00123456") != NULL);
    g_assert_true(strstr(people, "bus = usb-virtual-2-1") != NULL);
    g_assert_cmpint(process_run((const char *[]){MESORIG, "devices", "--json", NULL}, &json, NULL),
                    ==, 0);
    g_assert_true(g_str_has_prefix(json, "{\"devices\": ["));
    g_assert_true(strstr(json, "\"bus\": \"video\", \"address\": \"/dev/video0\"") != NULL);
    g_assert_true(strstr(json, "\"section\": \"[axis NAME]\\ndriver = tic-axis\\n") != NULL);
    g_assert_cmpint(
        process_run((const char *[]){MESORIG, "devices", "--units", "1-9", NULL}, &none, NULL), ==,
        2);
    g_clear_pointer(&none, g_free);
    g_assert_cmpint(
        process_run((const char *[]){MESORIG, "devices", "--modbus", "x", "--units", "9-1", NULL},
                    &none, NULL),
        ==, 2);
}

/* One for all: Aravis looks at the same USB as long as the process lives. */
BEFORE_TESTS {
    testbed_ref();
}

AFTER_TESTS {
    testbed_unref();
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    return tests_run(argc, argv);
}
