#include "rig_private.h"

#include "devices/devices.h"
#include "serial/devices.h"

#include <string.h>

/* Time in ms without a request after which the lamps go off. The time is long, because a busy
 * desktop computer delays a program more than a computer that only captures. */
#define DARK_MS 5000

gboolean rig_add_leds(VirtualRig *rig, const struct config_section *section, GError **error) {
    World *world = rig_world(rig, section, error);
    struct led_bank *bank = &rig->led_banks[rig->n_led_banks];
    if (!world)
        return FALSE;
    g_auto(GStrv) names = rig_lamps(rig, section, &bank->n);
    if (bank->n > VIRTUAL_LEDS_MAX) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "lamps",
                         "there are %d lamps, but a serial LED controller has at most %d; divide "
                         "the lamps among several sections",
                         bank->n, VIRTUAL_LEDS_MAX);
        return FALSE;
    }
    for (int i = 0; i < bank->n; i++) {
        g_autofree char *name = g_strconcat("lamp ", g_strstrip(names[i]), NULL);
        if (!world_part_find(rig->world, name, &bank->parts[i], error))
            return FALSE;
    }
    const struct virtual_leds_options options = {.n = bank->n, .dark_ms = DARK_MS};
    bank->leds = virtual_leds_new(&options, error);
    if (!bank->leds)
        return FALSE;
    rig->n_led_banks++;
    const char *port = virtual_leds_port(bank->leds);
    rig_copy_section(rig, section, &sim_lamps_driver.info, &serial_lamps_driver.info);
    g_string_append_printf(rig->text, "port = %s\nwarm_up_s = %g\n", port,
                           world_lamp_warm_up_s(world));
    rig_list_device(rig, section, serial_lamps_driver.info.name, g_strdup(port));
    return TRUE;
}

void rig_couple_leds(VirtualRig *rig) {
    struct virtual_leds_state state;
    for (int b = 0; b < rig->n_led_banks; b++) {
        struct led_bank *bank = &rig->led_banks[b];
        virtual_leds_state(bank->leds, &state);
        for (int i = 0; i < bank->n; i++) {
            if ((state.levels[i] > 0) == bank->on[i])
                continue;
            bank->on[i] = !bank->on[i];
            world_part_switch(&bank->parts[i], bank->on[i], g_get_monotonic_time());
        }
    }
}

gboolean rig_plug_leds(VirtualRig *rig, const char *where, gboolean plugged) {
    for (int i = 0; i < rig->n_led_banks; i++) {
        VirtualLeds *leds = rig->led_banks[i].leds;
        if (!g_str_equal(where, virtual_leds_port(leds)))
            continue;
        (plugged ? virtual_leds_plug : virtual_leds_unplug)(leds);
        return TRUE;
    }
    return FALSE;
}

void rig_add_leds_state(VirtualRig *rig, struct virtual_rig_state *to) {
    struct virtual_leds_state state;
    for (int b = 0; b < rig->n_led_banks; b++) {
        virtual_leds_state(rig->led_banks[b].leds, &state);
        for (int i = 0; i < rig->led_banks[b].n; i++)
            to->n_lit += state.levels[i] > 0;
    }
}

void rig_free_leds(VirtualRig *rig) {
    for (int b = 0; b < rig->n_led_banks; b++)
        virtual_leds_free(rig->led_banks[b].leds);
    for (int b = 0; b < MAX_DEVICES; b++)
        for (int i = 0; i < VIRTUAL_LEDS_MAX; i++)
            world_part_clear(&rig->led_banks[b].parts[i]);
}
