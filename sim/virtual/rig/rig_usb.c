#include "rig_private.h"

#include "devices/devices.h"
#include "usb/relays.h"
#include "usb/tic.h"
#include "v4l2/v4l2.h"
#include "virtual/testbed.h"

#include <math.h>

#define MAX_STEPS_PER_DEG 1000
#define MAX_STEPS_S       40000 /* largest number of steps per second; a Tic allows up to 50000 */
#define MAX_RELAYS        8
/* angle in degrees from a limit of the axis to the limit switch beyond it */
#define SWITCH_DEG 1

/* Speed of the SuperSpeed hub that all cameras share, in Mbit/s. It has enough bandwidth for eight
 * cameras of 1024 × 768 pixels. */
#define HUB_MBIT_S 5000
#define FRAME_RATE 25

static gboolean is_in(char *const *names, const struct config_section *section) {
    return names && (g_strv_contains((const char *const *)names, "all") ||
                     g_strv_contains((const char *const *)names, section->name));
}

gboolean rig_is_still(const VirtualRig *rig, const struct config_section *section) {
    return g_str_equal(section->class_name, "camera") && is_in(rig->still, section);
}

gboolean rig_is_u3v(const VirtualRig *rig, const struct config_section *section) {
    return g_str_equal(section->class_name, "camera") && is_in(rig->u3v, section) &&
           !rig_is_still(rig, section);
}

gboolean rig_is_usb(const VirtualRig *rig, const struct config_section *section) {
    return is_in(rig->usb, section) && !rig_is_u3v(rig, section) && !rig_is_still(rig, section);
}

gboolean rig_is_gcode(const VirtualRig *rig, const struct config_section *section) {
    return g_str_equal(section->class_name, "axis") && is_in(rig->gcode, section);
}

gboolean rig_is_serial(const VirtualRig *rig, const struct config_section *section) {
    return g_str_equal(section->class_name, "lamps") && is_in(rig->serial, section);
}

static gboolean check_names(const VirtualRig *rig, char *const *names, GError **error) {
    gsize n;
    const struct config_section *sections = config_sections(rig->config, &n);
    for (; names && *names; names++) {
        gboolean found = g_str_equal(*names, "all");
        for (gsize i = 0; i < n; i++)
            found |= g_strcmp0(sections[i].name, *names) == 0 &&
                     config_value(&sections[i], "driver", NULL);
        if (!found) {
            g_set_error(
                error, CONFIG_ERROR, CONFIG_ERROR_MISSING,
                "%s has no device “%s”; give the name of a section that has a driver, or all",
                config_path(rig->config), *names);
            return FALSE;
        }
    }
    return TRUE;
}

gboolean rig_check_usb(const VirtualRig *rig, GError **error) {
    gboolean any = (rig->usb && *rig->usb) || (rig->u3v && *rig->u3v);
    if (!check_names(rig, rig->usb, error) || !check_names(rig, rig->u3v, error) ||
        !check_names(rig, rig->still, error) || !check_names(rig, rig->gcode, error) ||
        !check_names(rig, rig->serial, error))
        return FALSE;
    if (!any || testbed_is_entered())
        return TRUE;
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                "the library libumockdev-preload.so.0 of umockdev, which virtual USB devices need, "
                "is not loaded; install libumockdev-preload0 and start the program again");
    return FALSE;
}

char *virtual_rig_environment(const VirtualRig *rig) {
    if (rig->n_tics + rig->n_relays + rig->n_videos + rig->n_u3v == 0)
        return NULL;
    return g_strdup_printf("LD_PRELOAD=libumockdev-preload.so.0 UMOCKDEV_DIR=%s",
                           g_getenv("UMOCKDEV_DIR"));
}

/* Returns the next free port of the virtual USB bus of Tics and relay boards. Returns 0 with an
 * error if all ports are taken. */
static int next_port(const VirtualRig *rig, const struct config_section *section, GError **error) {
    int port = 1 + rig->n_tics + rig->n_relays;
    if (port <= MAX_USB)
        return port;
    config_set_error(error, CONFIG_ERROR_VALUE, section, NULL,
                     "there is no free port: the virtual USB has %d ports for Tics and relay "
                     "boards; put fewer axes, lamp banks and lasers on it with --usb",
                     MAX_USB);
    return 0;
}

/* Sets *ret_deg to the homing position. An axis with limits homes at a switch below min_deg. An
 * endless axis homes where it stands, and does not use *ret_deg. Returns FALSE with an error if
 * position_error_deg is not 0, or if an axis with limits has a home_deg that is not below
 * min_deg. */
static gboolean find_switch(const struct config_section *section, double *ret_deg, GError **error) {
    const struct driver_info *sim = &sim_axis_driver.info;
    double min_deg = rig_number(section, sim, "min_deg");
    gboolean given = config_value(section, "home_deg", NULL) != NULL;
    *ret_deg = given ? rig_number(section, sim, "home_deg") : min_deg - SWITCH_DEG;
    if (rig_number(section, sim, "position_error_deg") != 0) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "position_error_deg",
                         "is %g, but a virtual Tic has no position errors; remove the key",
                         rig_number(section, sim, "position_error_deg"));
        return FALSE;
    }
    if (rig_wraps(section) || *ret_deg < min_deg)
        return TRUE;
    config_set_error(error, CONFIG_ERROR_VALUE, section, "home_deg",
                     "%g is not below min_deg = %g; a virtual Tic needs home_deg below min_deg, "
                     "because its limit switch is beyond the limits of the axis",
                     *ret_deg, min_deg);
    return FALSE;
}

gboolean rig_add_tic(VirtualRig *rig, const struct config_section *section, GError **error) {
    const struct driver_info *sim = &sim_axis_driver.info;
    double speed = rig_number(section, sim, "speed_deg_s"), switch_deg;
    double steps_per_deg = floor(MIN(MAX_STEPS_PER_DEG, MAX_STEPS_S / speed));
    int port = next_port(rig, section, error);
    if (port == 0 || !find_switch(section, &switch_deg, error))
        return FALSE;
    gboolean wraps = rig_wraps(section), moves = config_value(section, "world", NULL) != NULL;
    double way_deg = rig_number(section, sim, "max_deg") + SWITCH_DEG - switch_deg;
    double zero = wraps ? 0 : round(-switch_deg * steps_per_deg);
    g_autofree char *serial = g_strdup_printf("0030000%d", rig->n_tics);
    g_autofree char *part = rig_axis_part(section);
    if (moves && !rig_world(rig, section, error))
        return FALSE;
    VirtualTic *tic = virtual_tic_new(serial, port, wraps ? 0 : way_deg * steps_per_deg,
                                      CLAMP(zero, 0, way_deg * steps_per_deg));
    rig->tics[rig->n_tics++] = tic;
    rig_copy_motion(rig, section, &tic_axis_driver.info);
    if (!wraps && !config_value(section, "home_deg", NULL))
        g_string_append_printf(rig->text, "home_deg = %g\n", switch_deg);
    g_string_append_printf(rig->text,
                           "serial = %s\nsteps_per_deg = %g\nhoming = %s\npoll_ms = 10\n", serial,
                           steps_per_deg, wraps ? "here" : "reverse");
    rig_list_device(rig, section, tic_axis_driver.info.name,
                    g_strdup_printf("USB, serial %s", serial));
    return !moves || virtual_tic_link(tic, rig->world, part, steps_per_deg, zero, error);
}

static VirtualRelays *add_board(VirtualRig *rig, const struct config_section *section, int n,
                                const char *serial, GError **error) {
    static const char *const names[] = {"USBRelay1", "USBRelay2", "USBRelay4", "USBRelay8"};
    const char *name = names[n <= 1 ? 0 : n <= 2 ? 1 : n <= 4 ? 2 : 3];
    int port = next_port(rig, section, error);
    if (port == 0)
        return NULL;
    return rig->relays[rig->n_relays++] = virtual_relays_new(name, serial, port, FALSE);
}

static gboolean power(VirtualRig *rig, VirtualRelays *board, int relay, const char *kind,
                      const char *part, GError **error) {
    g_autofree char *name = g_strconcat(kind, part, NULL);
    return virtual_relays_link(board, relay, rig->world, name, error);
}

gboolean rig_add_usb_lamps(VirtualRig *rig, const struct config_section *section, GError **error) {
    World *world = rig_world(rig, section, error);
    g_autofree char *serial = g_strdup_printf("LAMP%d", rig->n_relays);
    int n = 0;
    if (!world)
        return FALSE;
    g_auto(GStrv) names = rig_lamps(rig, section, &n);
    if (n > MAX_RELAYS) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "lamps",
                         "there are %d lamps, but a USB relay board has at most %d relays; divide "
                         "the lamps among several sections",
                         n, MAX_RELAYS);
        return FALSE;
    }
    VirtualRelays *board = add_board(rig, section, n, serial, error);
    for (int i = 0; board && i < n; i++)
        if (!power(rig, board, i, "lamp ", g_strstrip(names[i]), error))
            return FALSE;
    if (!board)
        return FALSE;
    rig_copy_section(rig, section, &sim_lamps_driver.info, &usb_relays_driver.info);
    g_string_append_printf(rig->text, "serial = %s\nwarm_up_ms = %g\n", serial,
                           world_lamp_warm_up_s(world) * 1000);
    rig_list_device(rig, section, usb_relays_driver.info.name,
                    g_strdup_printf("USB, serial %s", serial));
    return TRUE;
}

gboolean rig_add_usb_laser(VirtualRig *rig, const struct config_section *section, GError **error) {
    if (!rig_world(rig, section, error))
        return FALSE;
    if (!rig->switches)
        rig->switches = add_board(rig, section, MAX_RELAYS, "LASER", error);
    if (!rig->switches)
        return FALSE;
    if (rig->n_switched == MAX_RELAYS) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, NULL,
                         "the USB relay board of the lasers has %d relays, which other lasers "
                         "use; leave this laser out of --usb",
                         MAX_RELAYS);
        return FALSE;
    }
    if (!power(rig, rig->switches, rig->n_switched, "laser ", rig_part(section), error))
        return FALSE;
    int relay = ++rig->n_switched; /* counted from 1 */
    rig_copy_section(rig, section, &sim_laser_driver.info, &usb_relay_laser_driver.info);
    if (!config_value(section, "warm_up_ms", NULL))
        g_string_append_printf(rig->text, "warm_up_ms = %g\n",
                               rig_number(section, &sim_laser_driver.info, "warm_up_ms"));
    g_string_append_printf(rig->text, "serial = LASER\nrelay = %d\n", relay);
    rig_list_device(rig, section, usb_relay_laser_driver.info.name,
                    g_strdup_printf("USB, serial LASER, relay %d", relay));
    return TRUE;
}

gboolean rig_add_video(VirtualRig *rig, const struct config_section *section, GError **error) {
    World *world = rig_world(rig, section, error);
    g_autofree char *port = g_strdup_printf("2-1.%d", rig->n_videos + 1);
    struct virtual_v4l2_config config = {.number = rig->n_videos,
                                         .port = port,
                                         .speed_mbit_s = HUB_MBIT_S,
                                         .stamp = VIRTUAL_V4L2_FIRST_DATA};
    struct world_sensor sensor;
    VirtualV4l2 *video =
        world ? virtual_v4l2_new_world(&config, world, rig_part(section), error) : NULL;
    if (!video)
        return FALSE;
    rig->videos[rig->n_videos++] = video;
    world_sensor(world, world_find_camera(world, rig_part(section)), &sensor);
    rig_copy_section(rig, section, &sim_camera_driver.info, &v4l2_camera_driver.info);
    g_string_append_printf(rig->text, "bus = usb-virtual-%s\nframe_rate = %d\nblack_level = %g\n",
                           port, FRAME_RATE, sensor.black_level);
    rig_list_device(rig, section, v4l2_camera_driver.info.name,
                    g_strdup_printf("usb-virtual-%s", port));
    return TRUE;
}

void rig_add_usb_state(const VirtualRig *rig, struct virtual_rig_state *to) {
    for (int i = 0; i < rig->n_tics; i++)
        to->n_moving += virtual_tic_speed(rig->tics[i]) != 0;
    for (int i = 0; i < rig->n_relays; i++)
        for (guint left = virtual_relays_state(rig->relays[i]); left; left &= left - 1)
            to->n_lit++;
}

void rig_free_usb(VirtualRig *rig) {
    for (int i = 0; i < rig->n_tics; i++)
        virtual_tic_free(rig->tics[i]);
    for (int i = 0; i < rig->n_relays; i++)
        virtual_relays_free(rig->relays[i]);
    for (int i = 0; i < rig->n_videos; i++)
        virtual_v4l2_free(rig->videos[i]);
}
