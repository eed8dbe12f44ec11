/* The classes of what shines and what guards it: lamps, lasers, interlocks. */
#include "lib/heard.h"

#include <math.h>
#include <string.h>

static void on_lamp(LampBank *from, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    heard_event(data, index, error);
}

static void on_laser(Laser *from, gboolean on, const GError *error, gpointer data) {
    heard_event(data, on, error);
}

static LampBank *open_lamps(const struct lamps_driver *driver, const char *keys,
                            struct heard *heard) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&bank, keys, &section);
    const char *const also[] = {"world", NULL};
    GError *error = NULL;
    LampBank *opened = lamps_open(driver, section, also, heard->clock, &error);
    g_assert_no_error(error);
    lamps_listen(opened, on_lamp, heard);
    return opened;
}

static double lamp_output(Clock *clock, int lamp) {
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct world_state state;
    world_snapshot(world, clock_now_us(clock), 1000, &state);
    return state.lamp_output[lamp];
}

static void switch_lamp(LampBank *to, struct heard *heard, int index, gboolean on) {
    g_assert_true(lamps_set(to, index, on, NULL));
    heard_next(heard, index);
    if (on)
        conformance_pass(heard->clock, to->warm_up_s);
}

static void test_dead_lamp(struct heard *heard, gconstpointer unused) {
    g_autoptr(World) world = world_get(WORLD, NULL);
    g_autoptr(LampBank) lit =
        open_lamps(&sim_lamps_driver,
                   "lamps = lamp60; lamp30\nfault_dead = lamp30\nfault_dead_after = 2\n", heard);
    int lamp60 = world_find_lamp(world, "lamp60"), lamp30 = world_find_lamp(world, "lamp30");
    for (int i = 0; i < 4; i++) {
        switch_lamp(lit, heard, 0, TRUE);
        g_assert_cmpfloat(lamp_output(heard->clock, lamp60), >, 0.9);
        g_assert_cmpfloat(lamp_output(heard->clock, lamp30), ==, 0);
        switch_lamp(lit, heard, 0, FALSE);
        switch_lamp(lit, heard, 1, TRUE);
        g_assert_cmpint(lamp_output(heard->clock, lamp30) > 0.9, ==, i < 2);
        g_assert_true(lamps_is_on(lit, 1)); /* its switch answers all the same */
        switch_lamp(lit, heard, 1, FALSE);
    }
    switch_lamp(lit, heard, 0, TRUE);
    g_clear_pointer(&lit, lamps_close);
    conformance_pass(heard->clock, 0.1);
    g_assert_cmpfloat(lamp_output(heard->clock, lamp60), ==, 0);
}

static gboolean silent_lamps_open(LampBank *from, GError **error) {
    from->n = 3;
    return TRUE;
}

static void silent_lamps_close(LampBank *from) {
}

static gboolean silent_lamps_set(LampBank *from, int index, gboolean on, GError **error) {
    return TRUE;
}

static const struct lamps_driver silent_lamps_driver = {
    .info = {"lamps", "silent", "Says nothing"},
    .open = silent_lamps_open,
    .close = silent_lamps_close,
    .set = silent_lamps_set,
};

static void test_lamp_deadline(struct heard *heard, gconstpointer unused) {
    g_autoptr(LampBank) silent = open_lamps(&silent_lamps_driver, "", heard);
    gint64 start = clock_now_us(heard->clock);
    g_assert_true(lamps_set(silent, 1, TRUE, NULL));
    heard_next(heard, 1);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    g_assert_cmpint(heard->at_us - start, ==, 2000000);
    g_assert_false(lamps_is_on(silent, 1));
    lamps_report(silent, 1, TRUE, NULL); /* too late, but it is lit */
    g_assert_cmpint(heard->n, ==, 0);
    g_assert_true(lamps_is_on(silent, 1));
    g_assert_cmpint(lamps_safety(silent), ==, DEVICE_UNSAFE);
    g_assert_true(lamps_all_off(silent, NULL));
    g_assert_cmpint(lamps_safety(silent), ==, DEVICE_TOLD);
    heard_next(heard, -1);
    g_assert_cmpint(lamps_safety(silent), ==, DEVICE_UNSAFE);
    g_assert_true(lamps_all_off(silent, NULL));
    lamps_report(silent, -1, FALSE, NULL);
    g_assert_cmpint(lamps_safety(silent), ==, DEVICE_SAFE);
}

static void test_laser_stays_on(struct heard *heard, gconstpointer unused) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&laser, "fault_stays_on = yes\n", &section);
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct world_state state;
    int index = world_find_laser(world, "laser30");
    g_autoptr(Laser) stuck = laser_open(&sim_laser_driver, section, NULL, heard->clock, NULL);
    laser_listen(stuck, on_laser, heard);
    for (int on = 1; on >= 0; on--) {
        g_assert_true(laser_set(stuck, on, NULL));
        heard_next(heard, on);
        g_assert_cmpint(laser_is_on(stuck), ==, on);
        world_snapshot(world, clock_now_us(heard->clock), 1, &state);
        g_assert_true(state.laser_on[index]);
    }
    g_clear_pointer(&stuck, laser_close);
    world_snapshot(world, clock_now_us(heard->clock), 1, &state);
    g_assert_false(state.laser_on[index]);
}

static void test_door(void) {
    const struct config_section *section;
    g_autoptr(Config) config =
        conformance_config(&door, "open_after_s = 10\nopen_for_s = 5\n", &section);
    g_autoptr(Clock) clock = clock_new_virtual();
    g_autoptr(Interlock) opened = interlock_open(&sim_interlock_driver, section, NULL, clock, NULL);
    g_assert_true(interlock_is_closed(opened));
    conformance_pass(clock, 9.9);
    g_assert_true(interlock_is_closed(opened));
    conformance_pass(clock, 0.2);
    g_assert_false(interlock_is_closed(opened));
    conformance_pass(clock, 5);
    g_assert_true(interlock_is_closed(opened));
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_autoptr(World) built_once = world_get(WORLD, NULL);
    g_test_add("/lamps/dead", struct heard, NULL, heard_begin, test_dead_lamp, heard_end);
    g_test_add("/lamps/deadline", struct heard, NULL, heard_begin, test_lamp_deadline, heard_end);
    g_test_add("/laser/stays-on", struct heard, NULL, heard_begin, test_laser_stays_on, heard_end);
    g_test_add_func("/interlock/door", test_door);
    return g_test_run();
}
