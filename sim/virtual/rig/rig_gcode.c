#include "rig_private.h"

#include "devices/devices.h"
#include "serial/devices.h"

#include <math.h>
#include <string.h>

/* GRBL reports positions with three decimals, so the resolution is 0.0001° */
#define UNITS_PER_DEG 10
#define STEPS         1000
#define MAX_UNITS_S   5000
#define MAX_UNITS_S2  100000

/* Returns the board of the next axis. If the last board has no free axis letter, makes another
 * board. Returns NULL with an error if the board cannot be made. */
static VirtualGcode *board_with_room(VirtualRig *rig, GError **error) {
    static const struct virtual_gcode_options options = {.n_axes = VIRTUAL_GCODE_AXES,
                                                         .units_s = MAX_UNITS_S,
                                                         .units_s2 = MAX_UNITS_S2,
                                                         .steps = STEPS,
                                                         .single_homing = TRUE};
    if (rig->n_gcode_axes % VIRTUAL_GCODE_AXES == 0)
        rig->gcode_boards[rig->n_gcode_axes / VIRTUAL_GCODE_AXES] =
            virtual_gcode_new(&options, error);
    return rig->gcode_boards[rig->n_gcode_axes / VIRTUAL_GCODE_AXES];
}

gboolean rig_add_gcode(VirtualRig *rig, const struct config_section *section, GError **error) {
    static const char letters[] = "XYZABC";
    const struct driver_info *sim = &sim_axis_driver.info;
    struct gcode_drive *drive = &rig->gcode_drives[rig->n_gcode_axes];
    g_autofree char *part = rig_axis_part(section);
    const char *world = config_value(section, "world", NULL);
    if (world && *world &&
        (!rig_world(rig, section, error) ||
         !world_part_find(rig->world, part, &drive->part, error)))
        return FALSE;
    drive->board = board_with_room(rig, error);
    if (!drive->board)
        return FALSE;
    drive->axis = rig->n_gcode_axes++ % VIRTUAL_GCODE_AXES;
    drive->wraps = rig_wraps(section);
    drive->home_deg = rig_number(section, sim, "home_deg");
    drive->error_deg = rig_number(section, sim, "position_error_deg");
    drive->error_seed = (int)rig_number(section, sim, "error_seed");
    rig_copy_motion(rig, section, &gcode_axis_driver.info);
    g_string_append_printf(rig->text,
                           "port = %s\nletter = %c\nunits_per_deg = %d\nhoming = axis\n"
                           "answer_ms = 2000\npoll_ms = 10\n",
                           virtual_gcode_port(drive->board), letters[drive->axis], UNITS_PER_DEG);
    rig_list_device(
        rig, section, gcode_axis_driver.info.name,
        g_strdup_printf("%s axis %c", virtual_gcode_port(drive->board), letters[drive->axis]));
    return TRUE;
}

void rig_couple_gcode(VirtualRig *rig) {
    struct virtual_gcode_state state;
    for (int i = 0; i < rig->n_gcode_axes; i++) {
        struct gcode_drive *drive = &rig->gcode_drives[i];
        virtual_gcode_state(drive->board, &state);
        const double deg =
            sim_axis_true_deg(drive->home_deg + state.at[drive->axis] / UNITS_PER_DEG, drive->wraps,
                              drive->error_deg, drive->error_seed);
        const gint64 now = g_get_monotonic_time();
        const double way = remainder(deg - drive->was_deg, 360);
        const double deg_s = now > drive->was_us ? way / (double)(now - drive->was_us) * 1e6 : 0;
        world_part_turn(&drive->part, deg, drive->was_us > 0 ? deg_s : 0, now);
        drive->was_deg = deg;
        drive->was_us = now;
    }
}

gboolean rig_plug_gcode(VirtualRig *rig, const char *where, gboolean plugged) {
    for (int i = 0; i < rig->n_gcode_axes; i++) {
        VirtualGcode *board = rig->gcode_drives[i].board;
        const char *port = virtual_gcode_port(board);
        if (!g_str_has_prefix(where, port) || where[strlen(port)] != ' ')
            continue;
        (plugged ? virtual_gcode_plug : virtual_gcode_unplug)(board);
        return TRUE;
    }
    return FALSE;
}

void rig_add_gcode_state(VirtualRig *rig, struct virtual_rig_state *to) {
    struct virtual_gcode_state state;
    for (int i = 0; i < rig->n_gcode_axes; i++) {
        if (rig->gcode_drives[i].axis > 0)
            continue; /* a board is counted only once, with its first axis */
        virtual_gcode_state(rig->gcode_drives[i].board, &state);
        to->n_moving += state.moving;
    }
}

void rig_free_gcode(VirtualRig *rig) {
    for (int i = 0; i < rig->n_gcode_axes; i++)
        world_part_clear(&rig->gcode_drives[i].part);
    for (gsize i = 0; i < G_N_ELEMENTS(rig->gcode_boards); i++)
        virtual_gcode_free(rig->gcode_boards[i]);
}
