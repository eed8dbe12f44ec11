#include "rig_private.h"

#include "aravis/camera.h"
#include "devices/devices.h"
#include "gphoto2/convert.h"
#include "gphoto2/gphoto2.h"
#include "modbus/devices.h"

#include <math.h>
#include <string.h>

#define STEPS_PER_DEG 10000
#define COUPLE_MS     1
#define LAMP_UNIT     1

#define FIRST_U3V_PORT (MAX_USB + 1) /* first port of USB3 Vision cameras on the virtual bus */

/* Timeouts of a line in ms. They are long, because a virtual drive on a busy desktop computer
 * answers later than a real drive. */
#define PATIENCE "timeout_ms = 300\nlate_ms = 300\n"

/* Keys of the watchdog, the same for all sections of a board. The time of five seconds is longer
 * than the delays of a program on a busy machine. */
#define WATCHDOG "watchdog_register = %d\nwatchdog_after_s = 5\nwatchdog_scale = 10\n"

static const struct option *find_option(const struct option *table, const char *name) {
    for (; table->name; table++)
        if (g_str_equal(table->name, name))
            return table;
    return NULL;
}

/* Returns the value of a key as written, or the default of the driver's option. Returns NULL if the
 * section has no value and the option has no default. */
static const char *rig_value(const struct config_section *section, const struct driver_info *driver,
                             const char *key) {
    const struct option *option = find_option(driver->options, key);
    const char *value = config_value(section, key, NULL);
    return value ? value : option ? option->fallback : NULL;
}

double rig_number(const struct config_section *section, const struct driver_info *driver,
                  const char *key) {
    const char *value = rig_value(section, driver, key);
    return value ? g_ascii_strtod(value, NULL) : 0;
}

const char *rig_part(const struct config_section *section) {
    const char *part = config_value(section, "part", NULL);
    return part && *part ? part : section->name;
}

void rig_set_error(GError **error, const struct config_section *section, const char *what) {
    config_set_error(error, CONFIG_ERROR_VALUE, section, NULL, "%s", what);
}

/* Appends a section to rig->text for the driver `to`. Leaves out the options that only the driver
 * `from` has. */
void rig_copy_section(VirtualRig *rig, const struct config_section *section,
                      const struct driver_info *from, const struct driver_info *to) {
    g_string_append_printf(rig->text, "\n[%s]\n", section->group);
    for (const char *const *key = config_keys(section); *key; key++) {
        gboolean was = from && find_option(from->options, *key);
        gboolean is = to && find_option(to->options, *key);
        gboolean chooses = g_str_equal(*key, "driver") && to;
        gboolean clock = g_str_equal(*key, "clock") && g_str_equal(section->class_name, "rig");
        /* The response of a still camera is not copied, because add_still() writes it. */
        gboolean response = g_str_equal(*key, "response") && to == &gphoto2_camera_driver.info;
        const char *value = config_value(section, *key, NULL);
        /* The path of the positions is made absolute, because the new rig file may be in another
         * folder. */
        g_autofree char *file =
            g_str_equal(section->class_name, "lamps") && g_str_equal(*key, "positions")
                ? config_resolve(section->config, value)
                : NULL;
        if (!chooses && !clock && !response && (!was || is))
            g_string_append_printf(rig->text, "%s = %s\n", *key, file ? file : value);
    }
    if (g_str_equal(section->class_name, "rig"))
        g_string_append(rig->text, "clock = real\n");
    if (to)
        g_string_append_printf(rig->text, "driver = %s\n", to->name);
}

void rig_list_device(VirtualRig *rig, const struct config_section *section, const char *driver,
                     char *where) {
    struct virtual_rig_device device = {g_strdup(section->group), g_strdup(driver), where};
    g_array_append_val(rig->devices, device);
}

/* Sets rig->world to the world of a section. Does nothing if the section has no key world. Returns
 * FALSE with an error if the world cannot be loaded, or if another section names a different
 * world. */
static gboolean find_world(VirtualRig *rig, const struct config_section *section, GError **error) {
    const char *path = config_value(section, "world", NULL);
    if (!path || !*path)
        return TRUE;
    g_autofree char *full = config_resolve(rig->config, path);
    g_autoptr(World) world = world_get(full, error);
    if (!world)
        return FALSE;
    if (rig->world && world != rig->world) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "world",
                         "%s is not the world of the other devices, %s; give all devices of the "
                         "rig the same world",
                         world->key, rig->world->key);
        return FALSE;
    }
    if (!rig->world)
        rig->world = g_steal_pointer(&world);
    return TRUE;
}

World *rig_world(VirtualRig *rig, const struct config_section *section, GError **error) {
    const char *path = config_value(section, "world", NULL);
    if (!path || !*path) {
        config_set_error(
            error, CONFIG_ERROR_MISSING, section, "world",
            "is missing; give the world file of the rig, as in the sections of the other devices");
        return NULL;
    }
    return find_world(rig, section, error) ? rig->world : NULL;
}

/* Returns the name of the part that an axis moves, as world_part_find() needs it. An axis that is
 * none of the turntable, arc, arm or probe moves the sweep of the laser that rig_part() names. */
char *rig_axis_part(const struct config_section *section) {
    const char *part = rig_part(section);
    static const char *const others[] = {"turntable", "arc", "arm", "probe", NULL};
    gboolean sweep = !g_strv_contains(others, part);
    return g_strconcat(sweep ? "sweep " : "", part, NULL);
}

static gboolean find_part(VirtualRig *rig, const char *kind, const char *part,
                          struct world_part *ret, GError **error) {
    g_autofree char *name = g_strconcat(kind, part, NULL);
    return world_part_find(rig->world, name, ret, error);
}

gboolean rig_wraps(const struct config_section *section) {
    return g_strcmp0(config_value(section, "wraps", NULL), "yes") == 0;
}

void rig_copy_motion(VirtualRig *rig, const struct config_section *section,
                     const struct driver_info *to) {
    static const char *const needed[] = {"speed_deg_s", "accel_deg_s2"};
    const struct driver_info *sim = &sim_axis_driver.info;
    rig_copy_section(rig, section, sim, to);
    for (gsize i = 0; i < G_N_ELEMENTS(needed); i++)
        if (!config_value(section, needed[i], NULL))
            g_string_append_printf(rig->text, "%s = %s\n", needed[i],
                                   rig_value(section, sim, needed[i]));
}

static gboolean virtual_rig_add_axis(VirtualRig *rig, const struct config_section *section,
                                     GError **error) {
    const struct driver_info *sim = &sim_axis_driver.info;
    struct drive *drive = &rig->drives[rig->n_drives];
    double speed = rig_number(section, sim, "speed_deg_s");
    double accel = rig_number(section, sim, "accel_deg_s2");
    struct virtual_modbus_options options = {TRUE, 1, speed * STEPS_PER_DEG, accel * STEPS_PER_DEG};
    g_autofree char *part = rig_axis_part(section);
    const char *world = config_value(section, "world", NULL);
    if (!find_world(rig, section, error) ||
        (world && *world && !world_part_find(rig->world, part, &drive->part, error)))
        return FALSE;
    drive->wraps = rig_wraps(section);
    drive->home_deg = rig_number(section, sim, "home_deg");
    drive->error_deg = rig_number(section, sim, "position_error_deg");
    drive->error_seed = (int)rig_number(section, sim, "error_seed");
    drive->device = virtual_modbus_new(&options, error);
    if (!drive->device)
        return FALSE;
    rig->n_drives++;
    rig_copy_motion(rig, section, &modbus_axis_driver.info);
    g_string_append_printf(rig->text,
                           "bus = %s\nunit = 1\n" PATIENCE
                           "steps_per_deg = %d\ntarget_register = 0\n"
                           "position_register = %d\nstatus_register = %d\nmoving_bit = 0\n"
                           "homed_bit = 1\nfault_bit = 2\nlimit_bit = 3\nstart = 2=1\nhome = 2=2\n"
                           "stop = 2=3\nclear = 2=4\nwatchdog = 5=1\npoll_ms = 5\n",
                           virtual_modbus_bus(drive->device), STEPS_PER_DEG,
                           VIRTUAL_MODBUS_STATUS + 1, VIRTUAL_MODBUS_STATUS);
    rig_list_device(rig, section, modbus_axis_driver.info.name,
                    g_strdup_printf("%s unit 1", virtual_modbus_bus(drive->device)));
    return TRUE;
}

static struct board *new_board(VirtualRig *rig, GError **error) {
    struct board *board = &rig->boards[rig->n_boards];
    struct virtual_modbus_options options = {FALSE, LAMP_UNIT, 1, 1};
    board->device = virtual_modbus_new(&options, error);
    if (!board->device)
        return NULL;
    rig->n_boards++;
    return board;
}

static void virtual_rig_add_link(VirtualRig *rig, const struct config_section *section,
                                 const char *driver, const struct board *board, const char *key,
                                 int number) {
    const char *bus = virtual_modbus_bus(board->device);
    g_string_append_printf(rig->text, "bus = %s\nunit = %d\n" PATIENCE "%s = %d\n", bus, LAMP_UNIT,
                           key, number);
    rig_list_device(rig, section, driver,
                    g_strdup_printf("%s unit %d, %s %d", bus, LAMP_UNIT, key, number));
}

char **rig_lamps(VirtualRig *rig, const struct config_section *section, int *ret_n) {
    const char *listed = config_value(section, "lamps", NULL);
    char **names = listed ? g_strsplit(listed, ";", -1) : g_new0(char *, rig->world->n_lamps + 1);
    for (int i = 0; !listed && i < rig->world->n_lamps; i++)
        names[i] = g_strdup(rig->world->lamp_names[i]);
    *ret_n = (int)g_strv_length(names);
    return names;
}

static gboolean add_lamps(VirtualRig *rig, const struct config_section *section, GError **error) {
    World *world = rig_world(rig, section, error);
    struct board *board = world ? new_board(rig, error) : NULL;
    int n = 0;
    if (!board)
        return FALSE;
    g_auto(GStrv) names = rig_lamps(rig, section, &n);
    if (n > MAX_COILS) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "lamps",
                         "there are %d lamps, but a virtual relay board has %d relays; divide the "
                         "lamps among several sections",
                         n, MAX_COILS);
        return FALSE;
    }
    for (int i = 0; i < n; i++, board->n_coils++)
        if (!find_part(rig, "lamp ", g_strstrip(names[i]), &board->parts[i], error))
            return FALSE;
    rig_copy_section(rig, section, &sim_lamps_driver.info, &modbus_relays_driver.info);
    g_string_append_printf(rig->text, "n = %d\nwarm_up_s = %g\n" WATCHDOG, n,
                           world_lamp_warm_up_s(world), VIRTUAL_MODBUS_TIMEOUT);
    virtual_rig_add_link(rig, section, modbus_relays_driver.info.name, board, "first_coil", 0);
    return TRUE;
}

static struct board *power_board(VirtualRig *rig, GError **error) {
    if (!rig->power)
        rig->power = new_board(rig, error);
    return rig->power;
}

static gboolean add_laser(VirtualRig *rig, const struct config_section *section, GError **error) {
    World *world = rig_world(rig, section, error);
    struct board *board = world ? power_board(rig, error) : NULL;
    if (!board)
        return FALSE;
    if (board->n_coils == MAX_COILS) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, NULL,
                         "this is laser %d, but the virtual relay board of the lasers has %d "
                         "relays; remove lasers from the rig file",
                         MAX_COILS + 1, MAX_COILS);
        return FALSE;
    }
    if (!find_part(rig, "laser ", rig_part(section), &board->parts[board->n_coils], error))
        return FALSE;
    rig_copy_section(rig, section, &sim_laser_driver.info, &modbus_laser_driver.info);
    g_string_append_printf(rig->text, "warm_up_s = %g\n" WATCHDOG,
                           rig_number(section, &sim_laser_driver.info, "warm_up_ms") / 1000,
                           VIRTUAL_MODBUS_TIMEOUT);
    virtual_rig_add_link(rig, section, modbus_laser_driver.info.name, board, "coil",
                         board->n_coils++);
    return TRUE;
}

static gboolean add_interlock(VirtualRig *rig, const struct config_section *section,
                              GError **error) {
    struct board *board = power_board(rig, error);
    if (!board)
        return FALSE;
    virtual_modbus_set_input(board->device, board->n_inputs, TRUE);
    rig_copy_section(rig, section, &sim_interlock_driver.info, &modbus_inputs_driver.info);
    g_string_append(rig->text, "lost_ms = 3000\n");
    virtual_rig_add_link(rig, section, modbus_inputs_driver.info.name, board, "input",
                         board->n_inputs++);
    return TRUE;
}

static void couple(VirtualRig *rig) {
    struct virtual_modbus_state state;
    g_mutex_lock(&rig->coupling);
    for (int i = 0; i < rig->n_drives; i++) {
        struct drive *drive = &rig->drives[i];
        const gint64 now = g_get_monotonic_time();
        virtual_modbus_state(drive->device, &state);
        double deg = drive->home_deg + state.position_steps / STEPS_PER_DEG;
        deg = sim_axis_true_deg(deg, drive->wraps, drive->error_deg, drive->error_seed);
        const double way = remainder(deg - drive->was_deg, 360);
        const double deg_s = now > drive->was_us ? way / (double)(now - drive->was_us) * 1e6 : 0;
        world_part_turn(&drive->part, deg, drive->was_us > 0 ? deg_s : 0, now);
        drive->was_deg = deg;
        drive->was_us = now;
    }
    rig_couple_gcode(rig);
    rig_couple_leds(rig);
    for (int i = 0; i < rig->n_boards; i++) {
        struct board *board = &rig->boards[i];
        virtual_modbus_state(board->device, &state);
        for (int k = 0; k < board->n_coils; k++) {
            if (state.coils[k] == board->on[k])
                continue;
            board->on[k] = state.coils[k];
            world_part_switch(&board->parts[k], board->on[k], g_get_monotonic_time());
        }
    }
    g_mutex_unlock(&rig->coupling);
}

static gboolean virtual_rig_on_timer(gpointer data) {
    couple(data);
    return G_SOURCE_CONTINUE;
}

/* Renders the picture of a camera from the world. The function runs in the thread of the camera
 * when an exposure has ended. */
static void virtual_rig_take_picture(const struct virtual_exposure *exposure, gpointer data,
                                     guint16 *ret_pixels) {
    struct vision_camera *vision = data;
    struct world_state state;
    couple(vision->rig);
    g_mutex_lock(&vision->rig->coupling);
    /* Another thread may replace the world. */
    g_autoptr(World) world = world_ref(vision->rig->world);
    g_mutex_unlock(&vision->rig->coupling);
    world_snapshot(world, exposure->start_us, exposure->exposure_us, &state);
    world_expose(world, vision->camera, &state, exposure->exposure_us, exposure->gain_db,
                 exposure->n, ret_pixels);
}

static gboolean add_still(VirtualRig *rig, const struct config_section *section,
                          struct vision_camera *vision, const struct world_sensor *sensor,
                          GError **error) {
    const struct virtual_ptpip_options options = {.serial = section->name,
                                                  .width = sensor->width,
                                                  .height = sensor->height,
                                                  .bits = sensor->bits,
                                                  .cfa = sensor->cfa,
                                                  .black_level = sensor->black_level,
                                                  .picture = virtual_rig_take_picture,
                                                  .data = vision};
    vision->still = virtual_ptpip_new(&options, error);
    if (!vision->still)
        return FALSE;
    rig->n_cameras++;
    const char *port = virtual_ptpip_port(vision->still);
    rig_copy_section(rig, section, &sim_camera_driver.info, &gphoto2_camera_driver.info);
    /* The driver's helper program stretches the values of the raw file to 16 bits, so the response
     * is also larger by this factor. */
    const double white = (double)(1 << sensor->bits) - 1,
                 stretch = (CONVERT_WHITE - CONVERT_BLACK) / (white - sensor->black_level);
    if (config_value(section, "response", NULL))
        g_string_append_printf(rig->text, "response = %.6g\n",
                               stretch * rig_number(section, &sim_camera_driver.info, "response"));
    g_string_append_printf(rig->text, "port = %s\ntrigger_ms = 100\nreadout_ms = 1000\n", port);
    rig_list_device(rig, section, gphoto2_camera_driver.info.name, g_strdup(port));
    return TRUE;
}

static gboolean add_camera(VirtualRig *rig, const struct config_section *section, GError **error) {
    static const char *const phases[] = {"Mono", "BayerRG", "BayerBG", "BayerGR", "BayerGB"};
    World *world = rig_world(rig, section, error);
    struct world_sensor sensor;
    if (!world)
        return FALSE;
    struct vision_camera *vision = &rig->cameras[rig->n_cameras];
    *vision = (struct vision_camera){
        .rig = rig, .name = section->name, .camera = world_find_camera(world, rig_part(section))};
    if (vision->camera < 0) {
        config_set_error(
            error, CONFIG_ERROR_UNKNOWN, section, NULL,
            "the world %s has no camera “%s”; set the key part to the name of a camera in "
            "this file",
            world->key, rig_part(section));
        return FALSE;
    }
    world_sensor(world, vision->camera, &sensor);
    if (rig_is_still(rig, section))
        return add_still(rig, section, vision, &sensor, error);
    struct virtual_camera_options options = {.serial = section->name,
                                             .width = sensor.width,
                                             .height = sensor.height,
                                             .bits = sensor.bits,
                                             .cfa = sensor.cfa,
                                             .black_level = sensor.black_level,
                                             .picture = virtual_rig_take_picture,
                                             .data = vision};
    if (rig_is_u3v(rig, section))
        vision->u3v = virtual_u3v_new(&options, FIRST_U3V_PORT + rig->n_u3v++);
    else if (!(vision->gige = virtual_gige_new(&options, NULL, error)))
        return FALSE;
    rig->n_cameras++;
    const char *device =
        vision->u3v ? virtual_u3v_serial(vision->u3v) : virtual_gige_address(vision->gige);
    const char *depth = sensor.bits <= 8    ? "8"
                        : sensor.bits <= 10 ? "10p"
                        : sensor.bits <= 12 ? "12p"
                                            : "16";
    rig_copy_section(rig, section, &sim_camera_driver.info, &aravis_camera_driver.info);
    g_string_append_printf(rig->text,
                           "device = %s\npixel_format = %s%s\nbits = %d\nblack_level_dn = %g\n",
                           device, phases[sensor.cfa], depth, sensor.bits, sensor.black_level);
    rig_list_device(rig, section, aravis_camera_driver.info.name, g_strdup(device));
    return TRUE;
}

typedef gboolean (*AddFunc)(VirtualRig *rig, const struct config_section *section, GError **error);

static gboolean virtual_rig_add_section(VirtualRig *rig, const struct config_section *section,
                                        GError **error) {
    static const struct {
        const char *driver;
        AddFunc add, add_usb;
    } kinds[] = {{"sim-axis", virtual_rig_add_axis, rig_add_tic},
                 {"sim-lamps", add_lamps, rig_add_usb_lamps},
                 {"sim-camera", add_camera, rig_add_video},
                 {"sim-laser", add_laser, rig_add_usb_laser},
                 {"sim-interlock", add_interlock, add_interlock}};
    const char *driver = config_value(section, "driver", NULL);
    if (!driver) {
        rig_copy_section(rig, section, NULL, NULL);
        return TRUE;
    }
    if (rig_is_gcode(rig, section))
        return rig_add_gcode(rig, section, error);
    if (rig_is_serial(rig, section))
        return rig_add_leds(rig, section, error);
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if (g_str_equal(kinds[i].driver, driver))
            return (rig_is_usb(rig, section) ? kinds[i].add_usb : kinds[i].add)(rig, section,
                                                                                error);
    g_autofree char *what =
        g_strdup_printf("driver = %s has no virtual device; set driver to sim-axis, sim-lamps, "
                        "sim-camera, sim-laser or sim-interlock",
                        driver);
    rig_set_error(error, section, what);
    return FALSE;
}

static void clear_device(gpointer data) {
    struct virtual_rig_device *device = data;
    g_free(device->section);
    g_free(device->driver);
    g_free(device->where);
}

VirtualRig *virtual_rig_new(const char *path, const struct virtual_rig_kinds *kinds,
                            GError **error) {
    g_autoptr(VirtualRig) rig = g_new0(VirtualRig, 1);
    gsize n;
    g_mutex_init(&rig->coupling);
    rig->usb = g_strdupv(kinds ? (char **)kinds->usb : NULL);
    rig->u3v = g_strdupv(kinds ? (char **)kinds->u3v : NULL);
    rig->still = g_strdupv(kinds ? (char **)kinds->still : NULL);
    rig->gcode = g_strdupv(kinds ? (char **)kinds->gcode : NULL);
    rig->serial = g_strdupv(kinds ? (char **)kinds->serial : NULL);
    rig->devices = g_array_new(FALSE, FALSE, sizeof(struct virtual_rig_device));
    g_array_set_clear_func(rig->devices, clear_device);
    rig->text = g_string_new(NULL);
    rig->config = config_load(path, error);
    if (!rig->config || !rig_check_usb(rig, error))
        return NULL;
    g_string_append_printf(rig->text, "# The rig of %s, as virtual devices on this machine.\n",
                           path);
    const struct config_section *sections = config_sections(rig->config, &n);
    if (n > MAX_DEVICES) {
        g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_VALUE,
                    "%s has %" G_GSIZE_FORMAT " sections, but a virtual rig may have at most %d; "
                    "remove sections",
                    config_path(rig->config), n, MAX_DEVICES);
        return NULL;
    }
    for (gsize i = 0; i < n; i++)
        if (!virtual_rig_add_section(rig, &sections[i], error))
            return NULL;
    if (!rig->world) {
        g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_MISSING,
                    "%s: no section of a device has the key world; add the key with the path of a "
                    "world file to the sections",
                    config_path(rig->config));
        return NULL;
    }
    rig->timer = g_timeout_add(COUPLE_MS, virtual_rig_on_timer, rig);
    return g_steal_pointer(&rig);
}

void virtual_rig_free(VirtualRig *rig) {
    if (!rig)
        return;
    if (rig->timer)
        g_source_remove(rig->timer);
    for (int i = 0; i < rig->n_cameras; i++) {
        virtual_gige_free(rig->cameras[i].gige);
        virtual_u3v_free(rig->cameras[i].u3v);
        virtual_ptpip_free(rig->cameras[i].still);
    }
    rig_free_usb(rig);
    rig_free_gcode(rig);
    rig_free_leds(rig);
    for (int i = 0; i < MAX_DEVICES; i++) {
        virtual_modbus_free(rig->drives[i].device);
        world_part_clear(&rig->drives[i].part);
        virtual_modbus_free(rig->boards[i].device);
        for (int k = 0; k < MAX_COILS; k++)
            world_part_clear(&rig->boards[i].parts[k]);
    }
    world_unref(rig->world);
    config_free(rig->config);
    g_strfreev(rig->usb);
    g_strfreev(rig->u3v);
    g_strfreev(rig->still);
    g_strfreev(rig->gcode);
    g_strfreev(rig->serial);
    g_string_free(rig->text, TRUE);
    g_array_unref(rig->devices);
    g_mutex_clear(&rig->coupling);
    g_free(rig);
}

const char *virtual_rig_text(const VirtualRig *rig) {
    return rig->text->str;
}

const struct virtual_rig_device *virtual_rig_devices(const VirtualRig *rig, gsize *ret_n) {
    *ret_n = rig->devices->len;
    return (const struct virtual_rig_device *)rig->devices->data;
}

void virtual_rig_fail_cameras(VirtualRig *rig, const struct virtual_camera_faults *faults) {
    rig->camera_faults = *faults;
    for (int i = 0; i < rig->n_cameras; i++) {
        if (rig->cameras[i].gige)
            virtual_gige_fail(rig->cameras[i].gige, faults);
        else if (rig->cameras[i].u3v)
            virtual_u3v_fail(rig->cameras[i].u3v, faults);
    }
}

void virtual_rig_fail_lines(VirtualRig *rig, const struct virtual_modbus_faults *faults) {
    for (int i = 0; i < rig->n_drives; i++)
        virtual_modbus_fail(rig->drives[i].device, faults);
    for (int i = 0; i < rig->n_boards; i++)
        virtual_modbus_fail(rig->boards[i].device, faults);
}

void virtual_rig_restart_camera(VirtualRig *rig, const char *name, int down_ms) {
    for (int i = 0; i < rig->n_cameras; i++)
        if (g_str_equal(rig->cameras[i].name, name) && rig->cameras[i].gige)
            virtual_gige_restart(rig->cameras[i].gige, down_ms);
}

void virtual_rig_state(VirtualRig *rig, struct virtual_rig_state *ret) {
    *ret = (struct virtual_rig_state){0};
    for (int i = 0; i < rig->n_drives + rig->n_boards; i++) {
        VirtualModbus *device =
            i < rig->n_drives ? rig->drives[i].device : rig->boards[i - rig->n_drives].device;
        struct virtual_modbus_state state;
        virtual_modbus_state(device, &state);
        ret->n_moving += state.moving;
        for (int k = 0; k < MAX_COILS; k++)
            ret->n_lit += state.coils[k];
    }
    rig_add_usb_state(rig, ret);
    rig_add_gcode_state(rig, ret);
    rig_add_leds_state(rig, ret);
}
