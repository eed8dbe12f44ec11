#include "lines.h"
#include "lib/ok.h"

const char *const lines_names[N_DEVICES] = {"laser top",      "lamps bank", "door",
                                            "axis turntable", "axis arc",   "axis sweep"};
const char *const lines_failures[] = {"gone", "silent", "deaf", "answer lost"};

gboolean lines_is_axis(enum line line) {
    return line == TURNTABLE || line == ARC || line == SWEEP;
}

int lines_n_failures(enum line line) {
    return line <= BANK ? LOST + 1 : DEAF;
}

VirtualModbus *lines_new_device(gboolean rtu) {
    const struct virtual_modbus_options options = {
        .rtu = rtu, .unit = 1, .speed_steps_s = 200, .accel_steps_s2 = 4000};
    VirtualModbus *device = ok(virtual_modbus_new(&options, ERR));
    return device;
}

static void lines_add_device(struct lines *lines, enum line line, const char *heading,
                             const char *keys) {
    g_string_append_printf(lines->text, "\n[%s]\n%s\nbus = %s\n", heading, keys,
                           virtual_modbus_bus(lines->devices[line]));
}

#define AXIS                                                                                       \
    "driver = modbus-axis\nmin_deg = -90\nmax_deg = 90\nspeed_deg_s = 2\naccel_deg_s2 = 40\n"      \
    "steps_per_deg = 100\ntarget_register = 0\nposition_register = 21\nstatus_register = 20\n"     \
    "moving_bit = 0\nhomed_bit = 1\nfault_bit = 2\nstart = 2=1\nhome = 2=2\nstop = 2=3\n"          \
    "poll_ms = 5"

/* The axes come first and the laser last. The order must not matter. */
void lines_write(struct lines *lines) {
    g_string_assign(lines->text, "# Für Prüfungen\n[rig]\nid = safe\nclock = real\n"
                                 "arc_radius_mm = 500\narc_width_mm = 30\n");
    lines_add_device(lines, TURNTABLE, "axis turntable", AXIS);
    lines_add_device(lines, ARC, "axis arc", AXIS);
    lines_add_device(lines, SWEEP, "axis sweep", AXIS);
    lines_add_device(lines, DOOR, "interlock door", "driver = modbus-inputs\ninput = 0");
    g_string_append_printf(lines->text,
                           "\n[camera cam30]\ndriver = sim-camera\nworld = %s\ntheta_deg = "
                           "30\nphi_deg = 0\ndistance_mm = 650\nwidth = 32\n"
                           "height = 32\nfocal_px = 333\nresponse = 6000\n",
                           lines->world);
    lines_add_device(lines, BANK, "lamps bank", "driver = modbus-relays\nn = 2\nwarm_up_s = 1");
    g_string_append(lines->text, "\n[lamp lamp30]\nbank = bank\nindex = 0\ntheta_deg = 30\n"
                                 "distance_mm = 500\n");
    lines_add_device(
        lines, LASER, "laser top",
        "driver = modbus-laser\nunit = 1\nsweep = sweep\ntheta_deg = 30\ndistance_mm = 480\n"
        "coil = 3\nwarm_up_s = 0.1");
}

void lines_open(struct lines *lines, const char *world) {
    lines->text = g_string_new(NULL);
    lines->world = world;
    for (int i = 0; i < N_DEVICES; i++)
        lines->devices[i] = lines_new_device(lines_is_axis((enum line)i));
    virtual_modbus_set_input(lines->devices[DOOR], 0, TRUE);
    lines_write(lines);
}

void lines_close(struct lines *lines) {
    for (int i = 0; i < N_DEVICES; i++)
        g_clear_pointer(&lines->devices[i], virtual_modbus_free);
    g_string_free(lines->text, TRUE);
}

void lines_fail(struct lines *lines, enum line line, enum line_failure how) {
    static const struct virtual_modbus_faults faults[] = {
        [SILENT] = {.cut = TRUE},
        [DEAF] = {.deaf = TRUE},
        [LOST] = {.lost = 1, .dead_ms = LINES_DEAD_S * 1000}};
    if (how == GONE)
        g_clear_pointer(&lines->devices[line], virtual_modbus_free);
    else
        virtual_modbus_fail(lines->devices[line], &faults[how]);
}

void lines_repair(struct lines *lines, enum line line) {
    const struct virtual_modbus_faults none = {0};
    virtual_modbus_fail(lines->devices[line], &none);
}

gint64 lines_usable_us(const struct lines *lines, enum line line) {
    struct virtual_modbus_state state;
    virtual_modbus_state(lines->devices[line], &state);
    return state.usable_us;
}

gboolean lines_has_light(VirtualModbus *device) {
    struct virtual_modbus_state state;
    gboolean any = FALSE;
    virtual_modbus_state(device, &state);
    for (int i = 0; i < VIRTUAL_MODBUS_BITS; i++)
        any |= state.coils[i];
    return any;
}
