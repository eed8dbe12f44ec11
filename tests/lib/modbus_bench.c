#include "modbus_bench.h"
#include "lib/ok.h"
#include "lib/wait.h"

static void hear(struct bench *bench, int event, const GError *error) {
    bench->n++;
    bench->event = event;
    bench->at_us = g_get_monotonic_time();
    g_clear_error(&bench->error);
    bench->error = error ? g_error_copy(error) : NULL;
}

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    hear(data, (int)event, error);
}

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    hear(data, on, error);
}

void bench_on_laser(Laser *laser, gboolean on, const GError *error, gpointer bench) {
    hear(bench, on, error);
}

static void on_door(Interlock *door, gboolean closed, gpointer data) {
    hear(data, closed, NULL);
}

void bench_begin(struct bench *bench, gconstpointer rtu) {
    *bench = (struct bench){.device = modbus_rig_device(rtu != NULL), .clock = clock_new_real()};
}

void bench_end(struct bench *bench, gconstpointer unused) {
    axis_close(bench->axis);
    lamps_close(bench->bank);
    laser_close(bench->laser);
    interlock_close(bench->door);
    config_free(bench->config);
    g_clear_error(&bench->error);
    virtual_modbus_free(bench->device);
    clock_unref(bench->clock);
}

const struct config_section *bench_section(struct bench *bench, const char *header,
                                           const char *keys) {
    g_autofree char *section = modbus_rig_section(virtual_modbus_bus(bench->device), header, keys);
    const struct conformance with = {.section = section, .path = "/rig/rig.conf"};
    const struct config_section *found;
    config_free(bench->config);
    bench->config = conformance_config(&with, "", &found);
    return found;
}

void bench_open_axis(struct bench *bench, const char *keys) {
    g_autofree char *all = g_strconcat(RIG_AXIS, keys, NULL);
    bench->axis = ok(axis_open(&modbus_axis_driver, bench_section(bench, "axis arc", all), NULL,
                               bench->clock, ERR));
    axis_listen(bench->axis, on_axis, bench);
}

void bench_open_bank(struct bench *bench, const char *keys) {
    bench->bank = ok(lamps_open(&modbus_relays_driver, bench_section(bench, "lamps bank", keys),
                                NULL, bench->clock, ERR));
    lamps_listen(bench->bank, on_lamp, bench);
}

void bench_open_laser(struct bench *bench, const char *keys) {
    bench->laser = ok(laser_open(&modbus_laser_driver, bench_section(bench, "laser l", keys), NULL,
                                 bench->clock, ERR));
    laser_listen(bench->laser, bench_on_laser, bench);
}

void bench_open_door(struct bench *bench, const char *keys) {
    bench->door =
        ok(interlock_open(&modbus_inputs_driver, bench_section(bench, "interlock door", keys), NULL,
                          bench->clock, ERR));
    interlock_listen(bench->door, on_door, bench);
}

struct virtual_modbus_state bench_state(struct bench *bench) {
    struct virtual_modbus_state state;
    virtual_modbus_state(bench->device, &state);
    return state;
}

void bench_expect(struct bench *bench, int event) {
    conformance_wait(bench->clock, &bench->n, 1, 10);
    g_assert_cmpint(bench->n, ==, 1);
    g_assert_no_error(bench->error);
    g_assert_cmpint(bench->event, ==, event);
    bench->n = 0;
}

void bench_expect_error(struct bench *bench, enum device_error code, const char *words) {
    conformance_wait(bench->clock, &bench->n, 1, 10);
    g_assert_cmpint(bench->n, ==, 1);
    conformance_expect_error(&bench->error, DEVICE_ERROR, (int)code, words);
    bench->n = 0;
}

void bench_started(struct bench *bench) {
    UNTIL (bench_state(bench).moving) {
        g_assert_no_error(bench->error); /* the motion will not begin */
        conformance_pass(bench->clock, 0.002);
    }
    const int asked = bench_state(bench).requests;
    UNTIL (bench_state(bench).requests >= asked + 2)
        conformance_pass(bench->clock, 0.002);
}

static gboolean bench_is_safe(const struct bench *bench) {
    return (!bench->axis || !device_is_unsafe(&bench->axis->device)) &&
           (!bench->bank || !device_is_unsafe(&bench->bank->device)) &&
           (!bench->laser || !device_is_unsafe(&bench->laser->device));
}

double bench_wait_safe(struct bench *bench) {
    const gint64 from = g_get_monotonic_time();
    UNTIL (bench_is_safe(bench))
        conformance_pass(bench->clock, 0.005);
    return (double)(g_get_monotonic_time() - from) * 1e-6;
}

void bench_home(struct bench *bench) {
    g_assert_true(axis_home(bench->axis, NULL));
    bench_expect(bench, AXIS_HOMED);
}
