#include "lib/modbus_bench.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"

#include <math.h>

/* Every fault of a Modbus device, with its error message and with the way to continue. */

static void start(struct bench *bench, double to_deg) {
    ok(axis_move(bench->axis, to_deg, ERR));
}

static void go(struct bench *bench, double to_deg) {
    start(bench, to_deg);
    bench_expect(bench, AXIS_ARRIVED);
    g_assert_cmpfloat(fabs(bench_state(bench).position_steps - 100 * to_deg), <=, 1);
}

static void recovers(struct bench *bench) {
    g_assert_false(axis_is_homed(bench->axis));
    bench_fail(bench, 0);
    bench_home(bench);
    go(bench, 12.5);
}

static void registers(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "");
    g_assert_cmpuint(bench_state(bench).speed, ==, 800);
    g_assert_cmpuint(bench_state(bench).accel, ==, 2000);
    conformance_pass(bench->clock, 0.3);
    g_assert_cmpint(bench_state(bench).watchdogs, >=, 3);
    bench_home(bench);
    go(bench, -45.5);
    g_assert_cmpfloat(axis_position_deg(bench->axis), ==, -45.5);
}

static void one_connection(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "");
    bench_open_bank(bench, "n = 2\n");
    bench_open_laser(bench, "coil = 9\n");
    bench_open_door(bench, "");
    g_assert_cmpint(bench_state(bench).connections, ==, 1);
}

static void close_is_safe(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "");
    bench_open_bank(bench, "n = 2\n");
    bench_open_laser(bench, "coil = 9\n");
    bench_home(bench);
    lamps_set(bench->bank, 1, TRUE, NULL);
    bench_expect(bench, TRUE);
    laser_set(bench->laser, TRUE, NULL);
    bench_expect(bench, TRUE);
    g_assert_true(bench_state(bench).coils[1]);
    g_assert_true(bench_state(bench).coils[9]);
    start(bench, 80);
    conformance_pass(bench->clock, 0.1);
    g_assert_true(bench_state(bench).moving);
    g_clear_pointer(&bench->axis, axis_close);
    g_clear_pointer(&bench->bank, lamps_close);
    g_clear_pointer(&bench->laser, laser_close);
    g_assert_false(bench_state(bench).coils[1]);
    g_assert_false(bench_state(bench).coils[9]);
    conformance_pass(bench->clock, 0.15);
    g_assert_false(bench_state(bench).moving);
    g_assert_cmpfloat(bench_state(bench).position_steps, <, 7900);
}

static void stall(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "");
    bench_home(bench);
    bench_fail(bench, .blocked = TRUE);
    start(bench, 40);
    bench_expect_error(bench, DEVICE_ERROR_STALLED,
                       "axis arc: stalled at 0.000° on its way to 40.000°");
    conformance_pass(bench->clock, 0.1);
    bench_fail(bench, 0);
    conformance_pass(bench->clock, 0.1);
    g_assert_cmpfloat(bench_state(bench).position_steps, <, 3900); /* it was told to stop */
    recovers(bench);
}

/* How it gets on is not known for a while, which ends nothing. */
static void unheard_for_a_while(struct bench *bench, gconstpointer unused) {
    struct virtual_modbus_faults lapses[] = {
        {.silent = 4}, {.damaged = 4}, {.late = 3, .late_ms = 90}};
    bench_open_axis(bench, "retries = 0\n");
    bench_home(bench);
    for (gsize i = 0; i < G_N_ELEMENTS(lapses); i++) {
        start(bench, i % 2 ? -80 : 80);
        bench_started(bench);
        virtual_modbus_fail(bench->device, &lapses[i]);
        bench_expect(bench, AXIS_ARRIVED);
        g_assert_true(axis_is_homed(bench->axis));
    }
}

static void unheard_for_long(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "retries = 1\nlost_ms = 400\n");
    bench_home(bench);
    start(bench, 80);
    bench_started(bench);
    gint64 from = g_get_monotonic_time();
    bench_fail(bench, .silent = -1);
    bench_expect_error(bench, DEVICE_ERROR_TIMEOUT,
                       "no answer within 60 ms (2 tries); check the power");
    g_assert_cmpint(bench->at_us - from, >, 380000);
    bench_fail(bench, 0);
    conformance_pass(bench->clock, 0.5);
    recovers(bench);
}

/* This program did not run for longer than a drive may be unheard: it has hardly been asked. */
static void held_up(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "retries = 0\nlost_ms = 400\n");
    bench_home(bench);
    start(bench, 80);
    bench_started(bench);
    bench_fail(bench, .silent = 2);
    conformance_pass(bench->clock, 0.03); /* a poll is under way */
    g_usleep(600000);
    bench_expect(bench, AXIS_ARRIVED);
    g_assert_true(axis_is_homed(bench->axis));
}

static void drive_fault(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "");
    bench_home(bench);
    start(bench, 80);
    conformance_pass(bench->clock, 0.05);
    virtual_modbus_set_drive_fault(bench->device, TRUE);
    bench_expect_error(bench, DEVICE_ERROR_STALLED, "the drive reports a fault (status 0x0006)");
    recovers(bench);
    virtual_modbus_set_drive_fault(bench->device, TRUE); /* and while it stands */
    bench_expect_error(bench, DEVICE_ERROR_STALLED, "the drive reports a fault");
    recovers(bench);
}

static void restart(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "");
    bench_home(bench);
    go(bench, 10);
    virtual_modbus_restart(bench->device, 100);
    bench_expect_error(bench, DEVICE_ERROR_DISCONNECTED, "has lost its reference");
    recovers(bench);
    g_assert_cmpint(bench_state(bench).connections, >=, 2);
    start(bench, 80);
    conformance_pass(bench->clock, 0.05);
    virtual_modbus_restart(bench->device, 100);
    bench_expect_error(bench, DEVICE_ERROR_STALLED, "it stands at 0.000° instead of 80.000°");
    recovers(bench);
}

/* Longer than any deadline: given up, and found again when it is back. */
static void long_loss(struct bench *bench, gconstpointer unused) {
    bench_open_bank(bench, "n = 2\n");
    virtual_modbus_restart(bench->device, 2200);
    g_usleep(20000);
    lamps_set(bench->bank, 0, TRUE, NULL);
    bench_expect_error(bench, DEVICE_ERROR_DISCONNECTED, "lamps bank: ");
    g_assert_cmpint(lamps_light(bench->bank, 0), ==, LIGHT_UNSAFE);
    bench_wait_safe(bench);
    g_assert_cmpint(lamps_light(bench->bank, 0), ==, LIGHT_OFF);
    lamps_set(bench->bank, 0, TRUE, NULL);
    bench_expect(bench, TRUE);
    g_assert_true(bench_state(bench).coils[0]);
}

static void lamp_faults(struct bench *bench, gconstpointer unused) {
    bench_open_bank(bench, "n = 2\nretries = 1\n");
    bench_fail(bench, .deaf = TRUE);
    lamps_set(bench->bank, 1, TRUE, NULL);
    bench_expect_error(bench, DEVICE_ERROR_PROTOCOL,
                       "1 was written to address 1, which reads back as 0");
    g_assert_cmpint(lamps_light(bench->bank, 1), ==, LIGHT_UNSAFE);
    bench_wait_safe(bench);
    bench_fail(bench, .refused = 1, .exception = 2);
    lamps_set(bench->bank, 1, TRUE, NULL);
    bench_expect_error(bench, DEVICE_ERROR_PROTOCOL, "the device refused: Illegal data address");
    bench_wait_safe(bench);
    bench_fail(bench, .refused = 1, .exception = 6); /* busy */
    lamps_set(bench->bank, 1, TRUE, NULL);
    bench_expect(bench, TRUE);
    bench_fail(bench, .silent = -1);
    lamps_set(bench->bank, 1, FALSE, NULL);
    bench_expect_error(bench, DEVICE_ERROR_TIMEOUT, "no answer within 60 ms (2 tries)");
    bench_fail(bench, 0);
    bench_wait_safe(bench);
    bench_fail(bench, .damaged = 1); /* another transaction's */
    lamps_set(bench->bank, 0, TRUE, NULL);
    bench_expect(bench, TRUE);
    bench_fail(bench, .late = 1, .late_ms = 90);
    lamps_set(bench->bank, 0, FALSE, NULL);
    bench_expect(bench, FALSE);
    g_assert_false(bench_state(bench).coils[0]);
}

/* The answer is lost, the light is not: it is put out. */
static void laser_unanswered(struct bench *bench, gconstpointer unused) {
    bench_open_laser(bench, "coil = 9\nretries = 0\n");
    bench_fail(bench, .silent = 1);
    laser_set(bench->laser, TRUE, NULL);
    bench_expect_error(bench, DEVICE_ERROR_TIMEOUT, "laser l: ");
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_UNSAFE);
    bench_wait_safe(bench);
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_OFF);
    g_assert_false(bench_state(bench).coils[9]);
    laser_set(bench->laser, TRUE, NULL);
    bench_expect(bench, TRUE);
    g_assert_true(bench_state(bench).coils[9]);
}

static void door(struct bench *bench, gconstpointer unused) {
    bench_open_door(bench, "input = 3\nlost_ms = 200\npoll_ms = 5\n");
    g_assert_false(interlock_is_closed(bench->door));
    virtual_modbus_set_input(bench->device, 3, TRUE);
    bench_expect(bench, TRUE);
    virtual_modbus_set_input(bench->device, 3, FALSE);
    bench_expect(bench, FALSE);
    g_assert_false(interlock_is_lost(bench->door));
    virtual_modbus_set_input(bench->device, 3, TRUE);
    bench_expect(bench, TRUE);
    const int asked = bench_state(bench).requests;
    bench_fail(bench, .silent = -1);
    bench_expect(bench, FALSE);
    /* A request waits 60 ms for its answer, and 120 ms for a late one: 200 ms are over after two or
     * three of them. */
    g_assert_cmpint(bench_state(bench).requests, <=, asked + 3);
    g_assert_true(interlock_is_lost(bench->door)); /* nobody opened a door */
    g_autofree char *advice = interlock_advice(bench->door);
    assert_has(advice, "interlock door does not answer");
    bench_fail(bench, 0);
    bench_expect(bench, TRUE);
    g_assert_false(interlock_is_lost(bench->door));
}

static void refuse(const struct axis_driver *driver, const char *text, GQuark domain, int code,
                   const char *words, gboolean virtual_clock) {
    g_autoptr(Clock) clock = virtual_clock ? clock_new_virtual() : clock_new_real();
    const struct conformance with = {.section = text, .path = "/rig/rig.conf"};
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    GError *error = NULL;
    g_assert_null(axis_open(driver, section, NULL, clock, &error));
    conformance_expect_error(&error, domain, code, words);
}

/* Each row is added to a good section, whose keys are on lines 2 to 34. */
TEST(bad_configuration) {
    static const struct {
        const char *replace, *with;
        enum config_error code;
        const char *words;
    } rows[] = {
        {"steps_per_deg = 100", "steps_per_deg = 0", CONFIG_ERROR_VALUE,
         "/rig/rig.conf:10: [axis arc] steps_per_deg: must not be 0"},
        {"start = 2=1", "start = 2", CONFIG_ERROR_VALUE, "start: \"2\" is not ADDRESS=VALUE"},
        {"start = 2=1", "start = 2=65536", CONFIG_ERROR_VALUE, "start: \"2=65536\""},
        {"start = 2=1", "start = 0xffff=1,2", CONFIG_ERROR_VALUE, "start: \"0xffff=1,2\""},
        {"start = 2=1", "start = 0x=1", CONFIG_ERROR_VALUE, "start: \"0x=1\""},
        {"start = 2=1", "start = ", CONFIG_ERROR_VALUE, "start: must not be empty"},
        {"start = 2=1", "", CONFIG_ERROR_MISSING, "start: must be given"},
        {"stop = 2=3", "stop = 2=1;2=1;2=1;2=1;2=1;2=1;2=1", CONFIG_ERROR_VALUE,
         "stop: has 7 writes, but at most 6 are possible"},
        {"min_deg = -90", "min_deg = 90", CONFIG_ERROR_VALUE, "min_deg: 90 is not below"},
        {"speed_scale = 2", "speed_scale = 1000", CONFIG_ERROR_VALUE,
         "speed_scale: the value for the drive, 400000, does not fit into 16 bits"},
        {"moving_bit = 0", "moving_bit = 16", CONFIG_ERROR_VALUE, "moving_bit: 16 is out of range"},
        {"target_register = 0", "target_register = 0x1ffff", CONFIG_ERROR_VALUE, "target_register"},
        {"unit = 7", "unit = 0", CONFIG_ERROR_VALUE, "/rig/rig.conf:3: [axis arc] unit"},
        {"poll_ms = 5", "poll_s = 5", CONFIG_ERROR_UNKNOWN, "write poll_ms"},
    };
    g_autoptr(VirtualModbus) device = modbus_rig_device(FALSE);
    g_autofree char *good = modbus_rig_section(virtual_modbus_bus(device), "axis arc", RIG_AXIS);
    for (gsize i = 0; i < G_N_ELEMENTS(rows); i++) {
        g_autoptr(GString) text = g_string_new(good);
        g_assert_cmpuint(g_string_replace(text, rows[i].replace, rows[i].with, 1), ==, 1);
        refuse(&modbus_axis_driver, text->str, CONFIG_ERROR, (int)rows[i].code, rows[i].words,
               FALSE);
    }
    refuse(&modbus_axis_driver, good, CONFIG_ERROR, CONFIG_ERROR_VALUE, "write clock = real", TRUE);
}

static void refuse_bus(const char *bus, int code, const char *words) {
    g_autofree char *text = g_strdup_printf("[axis arc]\nunit = 9\nretries = 1\nbus = %s\n"
                                            "timeout_ms = 60\nlate_ms = 100\n" RIG_AXIS,
                                            bus);
    refuse(&modbus_axis_driver, text, DEVICE_ERROR, code, words, FALSE);
}

TEST(no_such_bus) {
    g_autoptr(VirtualModbus) tcp = modbus_rig_device(FALSE);
    g_autoptr(VirtualModbus) rtu = modbus_rig_device(TRUE);
    refuse_bus("/dev/no-such-port", DEVICE_ERROR_DISCONNECTED,
               "/rig/rig.conf:4: [axis arc] bus: cannot open /dev/no-such-port: No such file");
    refuse_bus("tcp:127.0.0.1:1", DEVICE_ERROR_DISCONNECTED,
               "/rig/rig.conf:4: [axis arc] bus: cannot open tcp:127.0.0.1:1");
    refuse_bus("tcp:[::1", DEVICE_ERROR_DISCONNECTED, "is not a Modbus line");
    refuse_bus(virtual_modbus_bus(tcp), DEVICE_ERROR_TIMEOUT,
               "unit 9, writing holding register 100 (0x0064): no answer within 60 ms (2 tries)");
    refuse_bus(virtual_modbus_bus(rtu), DEVICE_ERROR_TIMEOUT, "check the power and the address");
}

static void other_settings(struct bench *bench, gconstpointer unused) {
    bench_open_bank(bench, "n = 2\n");
    g_autofree char *text =
        modbus_rig_section(virtual_modbus_bus(bench->device), "axis arc", RIG_AXIS "baud = 9600\n");
    refuse(&modbus_axis_driver, text, CONFIG_ERROR, CONFIG_ERROR_VALUE,
           "/rig/rig.conf:2: [axis arc] bus: another section opens", FALSE);
}

/* Presets are sections to copy: every key of theirs is one of the driver's. */
TEST(presets) {
    g_autoptr(GDir) dir = g_dir_open(SOURCE_DIR "/etc/devices", 0, NULL);
    int n = 0;
    g_assert_nonnull(dir);
    for (const char *name; (name = g_dir_read_name(dir));) {
        g_autofree char *path = g_build_filename(SOURCE_DIR "/etc/devices", name, NULL);
        GError *error = NULL;
        g_autoptr(Config) config = config_load(path, &error);
        g_assert_no_error(error);
        gsize n_sections;
        const struct config_section *section = config_sections(config, &n_sections);
        g_assert_cmpuint(n_sections, ==, 1);
        const char *driver = config_value(section, "driver", NULL);
        if (!g_str_has_prefix(driver, "modbus-"))
            continue;
        const struct driver_info *info = g_str_equal(driver, "modbus-axis")
                                             ? &modbus_axis_driver.info
                                             : &modbus_relays_driver.info;
        const char *const also[] = {"driver", NULL};
        g_autofree gpointer priv = g_malloc0(info->priv_size);
        g_assert_cmpstr(info->name, ==, driver);
        ok(options_parse(info->options, section, also, priv, ERR));
        options_clear(info->options, priv);
        n++;
    }
    g_assert_cmpint(n, ==, 5);
}

static const struct {
    const char *name;
    void (*run)(struct bench *bench, gconstpointer unused);
    gboolean rtu;
} tests[] = {
    {"/modbus/registers", registers},
    {"/modbus/one-connection", one_connection},
    {"/modbus/close-is-safe", close_is_safe},
    {"/modbus/stall", stall},
    {"/modbus/unheard-for-a-while", unheard_for_a_while, TRUE},
    {"/modbus/unheard-for-long", unheard_for_long, TRUE},
    {"/modbus/held-up", held_up, TRUE},
    {"/modbus/drive-fault", drive_fault},
    {"/modbus/restart", restart},
    {"/modbus/long-loss", long_loss},
    {"/modbus/lamp-faults", lamp_faults},
    {"/modbus/laser-unanswered", laser_unanswered},
    {"/modbus/door", door},
    {"/modbus/other-settings", other_settings},
};

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(tests); i++)
        g_test_add(tests[i].name, struct bench, GINT_TO_POINTER(tests[i].rtu), bench_begin,
                   tests[i].run, bench_end);
}
