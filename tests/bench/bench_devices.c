/*
 * Latencies of real drivers, compared with the round trip of the bare protocol. Both are measured
 * alternately in the same run.
 *
 * Modbus: how long a transaction takes through a line's thread, and how soon a drive begins to move
 * after axis_move(), against libmodbus only. A pseudo-terminal has no baud rate, so the time on a
 * real wire must be added.
 *
 * GigE Vision: from a trigger to the whole picture, against bare GVCP and GVSP on plain sockets.
 */
#include "bench.h"
#include "devices_gige.h"

#include "lib/modbus_rig.h"

#include <modbus/modbus.h>
#include <stdlib.h>

#define ROUNDS 2000
#define MOVES  40

struct result {
    struct bench_times raw, line, start; /* µs */
};

/* Alternately, so that other work of the machine affects both. */
static void time_both(modbus_t *raw, ModbusBus *bus, const struct modbus_link *link,
                      struct result *ret) {
    static double raw_us[ROUNDS], line_us[ROUNDS];
    for (int i = 0; i < ROUNDS; i++) {
        guint16 value;
        gint64 start = g_get_monotonic_time();
        if (modbus_read_registers(raw, VIRTUAL_MODBUS_PLAIN, 1, &value) != 1)
            exit(1);
        raw_us[i] = (double)(g_get_monotonic_time() - start);
        struct modbus_job job = {0};
        GError *error = NULL;
        modbus_job_add(&job, MODBUS_READ_HOLDING, VIRTUAL_MODBUS_PLAIN, 1);
        gint64 begun = g_get_monotonic_time();
        modbus_bus_do(bus, link, &job, 1000, &error);
        bench_check(error);
        line_us[i] = (double)(g_get_monotonic_time() - begun);
    }
    ret->raw = bench_times(raw_us, ROUNDS);
    ret->line = bench_times(line_us, ROUNDS);
}

static void count(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    bench_check(error);
    ++*(int *)data;
}

static void time_start(VirtualModbus *device, Axis *axis, Clock *clock, struct result *ret) {
    double us[MOVES];
    int n = 0;
    axis_listen(axis, count, &n);
    axis_home(axis, NULL);
    conformance_wait(clock, &n, 1, 10);
    for (int i = 0; i < MOVES; i++) {
        struct virtual_modbus_state state;
        GError *error = NULL;
        gint64 start = g_get_monotonic_time();
        axis_move(axis, i % 2 ? 0 : 5, &error);
        bench_check(error);
        conformance_wait(clock, &n, i + 2, 10);
        virtual_modbus_state(device, &state);
        us[i] = (double)(state.began_us - start);
    }
    ret->start = bench_times(us, MOVES);
}

static struct result measure(gboolean rtu) {
    struct result result = {0};
    g_autoptr(VirtualModbus) device = modbus_rig_device(rtu);
    /* A device of its own, since it serves one connection. */
    g_autoptr(VirtualModbus) other = modbus_rig_device(rtu);
    const char *address = virtual_modbus_bus(other);
    modbus_t *raw = rtu ? modbus_new_rtu(address, 115200, 'E', 8, 1)
                        : modbus_new_tcp("127.0.0.1", atoi(strrchr(address, ':') + 1));
    modbus_set_slave(raw, RIG_UNIT);
    if (modbus_connect(raw) != 0)
        exit(1);
    g_autoptr(Clock) clock = clock_new_real();
    GError *error = NULL;
    g_autofree char *text = modbus_rig_section(virtual_modbus_bus(device), "axis arc", RIG_AXIS);
    g_autoptr(Config) config = config_parse(text, "./bench.conf", &error);
    bench_check(error);
    const struct config_section *section = config_find(config, "axis", "arc");
    Axis *axis = axis_open(&modbus_axis_driver, section, NULL, clock, &error);
    bench_check(error);
    /* Shares the driver's line: its settings are the first member of the driver's struct. */
    const struct modbus_link *link = axis->device.priv;
    const struct device device_of_line = {
        .info = &modbus_axis_driver.info, .clock = clock, .section = section};
    ModbusBus *bus = modbus_bus_get(link, &device_of_line, &error);
    bench_check(error);
    time_both(raw, bus, link, &result);
    time_start(device, axis, clock, &result);
    modbus_bus_unref(bus);
    axis_close(axis);
    modbus_close(raw);
    modbus_free(raw);
    return result;
}

static void print(const char *name, const struct result *r) {
    const double raw = r->raw.median, line = r->line.median, start = r->start.median;
    bench_row(name,
              "%.1f{libmodbus_us} %.1f{libmodbus_p99_us} %.1f{line_us} %.1f{line_p99_us} "
              "%.2f{line_ratio} %.1f{command_to_motion_us} %.1f{command_to_motion_p99_us} "
              "%.2f{command_to_motion_ratio}",
              raw, r->raw.p99, line, r->line.p99, line / raw, start, r->start.p99, start / raw);
}

int main(int argc, char **argv) {
    bench_parse(&argc, &argv, NULL, NULL);
    struct result tcp = measure(FALSE), rtu = measure(TRUE);
    struct gige_latency g;
    gige_latency(1024, 768, &g);
    const double protocol = g.protocol.median, driver = g.driver.median;
    bench_begin(NULL);
    print("tcp", &tcp);
    print("rtu", &rtu);
    bench_row("gige_1024x768",
              "%.1f{register_us} %.1f{protocol_us} %.1f{protocol_p99_us} %.1f{trigger_to_frame_us} "
              "%.1f{trigger_to_frame_p99_us} %.2f{trigger_to_frame_ratio}",
              g.register_us, protocol, g.protocol.p99, driver, g.driver.p99, driver / protocol);
    bench_end();
    return 0;
}
