/*
 * Latencies of real drivers against the protocol's own round trip in the same run, taken in turns.
 *
 * Modbus: how long a transaction takes through a line's thread, and how soon a drive begins to move
 * after axis_move(), against libmodbus alone. A pseudo-terminal has no baud rate: add the wire's.
 *
 * GigE Vision: from a trigger to the whole picture, against bare GVCP and GVSP on plain sockets.
 */
#include "devices_gige.h"
#include "quantile.h"

#include "lib/modbus_rig.h"

#include <locale.h>
#include <modbus/modbus.h>
#include <stdio.h>
#include <stdlib.h>

#define ROUNDS 2000
#define MOVES  40

struct result {
    double raw, line, start; /* µs, medians */
    double raw_p99, line_p99, start_p99;
};

static void check(GError *error) {
    if (!error)
        return;
    fprintf(stderr, "bench_devices: %s\n", error->message);
    exit(1);
}

static modbus_t *connect_raw(const VirtualModbus *device, gboolean rtu) {
    const char *bus = virtual_modbus_bus(device);
    modbus_t *raw = rtu ? modbus_new_rtu(bus, 115200, 'E', 8, 1)
                        : modbus_new_tcp("127.0.0.1", atoi(strrchr(bus, ':') + 1));
    modbus_set_slave(raw, RIG_UNIT);
    if (modbus_connect(raw) != 0)
        exit(1);
    return raw;
}

static double time_raw(modbus_t *raw) {
    guint16 value;
    gint64 start = g_get_monotonic_time();
    if (modbus_read_registers(raw, VIRTUAL_MODBUS_PLAIN, 1, &value) != 1)
        exit(1);
    return (double)(g_get_monotonic_time() - start);
}

static double time_line(ModbusBus *bus, const struct modbus_link *link) {
    struct modbus_job job = {0};
    GError *error = NULL;
    modbus_job_add(&job, MODBUS_READ_HOLDING, VIRTUAL_MODBUS_PLAIN, 1);
    gint64 start = g_get_monotonic_time();
    modbus_bus_do(bus, link, &job, 1000, &error);
    check(error);
    return (double)(g_get_monotonic_time() - start);
}

/* In turns, so that whatever else the machine does falls on both. */
static void time_both(modbus_t *raw, ModbusBus *bus, const struct modbus_link *link,
                      struct result *ret) {
    static double raw_us[ROUNDS], line_us[ROUNDS];
    for (int i = 0; i < ROUNDS; i++) {
        raw_us[i] = time_raw(raw);
        line_us[i] = time_line(bus, link);
    }
    ret->raw = quantile(raw_us, ROUNDS, 0.5);
    ret->raw_p99 = quantile(raw_us, ROUNDS, 0.99);
    ret->line = quantile(line_us, ROUNDS, 0.5);
    ret->line_p99 = quantile(line_us, ROUNDS, 0.99);
}

static void count(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    if (error)
        check(g_error_copy(error));
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
        check(error);
        conformance_wait(clock, &n, i + 2, 10);
        virtual_modbus_state(device, &state);
        us[i] = (double)(state.began_us - start);
    }
    ret->start = quantile(us, MOVES, 0.5);
    ret->start_p99 = quantile(us, MOVES, 0.99);
}

static struct result measure(gboolean rtu) {
    struct result result = {0};
    g_autoptr(VirtualModbus) device = modbus_rig_device(rtu);
    /* A device of its own, since it serves one connection. */
    g_autoptr(VirtualModbus) other = modbus_rig_device(rtu);
    modbus_t *raw = connect_raw(other, rtu);
    g_autoptr(Clock) clock = clock_new_real();
    GError *error = NULL;
    g_autofree char *text = modbus_rig_section(virtual_modbus_bus(device), "axis arc", RIG_AXIS);
    g_autoptr(Config) config = config_parse(text, "./bench.conf", &error);
    check(error);
    const struct config_section *section = config_find(config, "axis", "arc");
    Axis *axis = axis_open(&modbus_axis_driver, section, NULL, clock, &error);
    check(error);
    /* Shares the driver's line: its settings are the first member of the driver's struct. */
    const struct modbus_link *link = axis->device.priv;
    const struct device device_of_line = {
        .info = &modbus_axis_driver.info, .clock = clock, .section = section};
    ModbusBus *bus = modbus_bus_get(link, &device_of_line, &error);
    check(error);
    time_both(raw, bus, link, &result);
    time_start(device, axis, clock, &result);
    modbus_bus_unref(bus);
    axis_close(axis);
    modbus_close(raw);
    modbus_free(raw);
    return result;
}

static void print(const char *name, const struct result *r, gboolean json) {
    if (json)
        printf("\"%s\":{\"libmodbus_us\":%.1f,\"libmodbus_p99_us\":%.1f,\"line_us\":%.1f,"
               "\"line_p99_us\":%.1f,\"line_ratio\":%.2f,\"command_to_motion_us\":%.1f,"
               "\"command_to_motion_p99_us\":%.1f,\"command_to_motion_ratio\":%.2f}",
               name, r->raw, r->raw_p99, r->line, r->line_p99, r->line / r->raw, r->start,
               r->start_p99, r->start / r->raw);
    else
        printf("%s: libmodbus %.0f µs, through the line's thread %.0f µs (%.2f), move to motion "
               "%.0f µs (%.2f: target, read back, start)\n",
               name, r->raw, r->line, r->line / r->raw, r->start, r->start / r->raw);
}

static void print_gige(const struct gige_latency *g, gboolean json) {
    if (json)
        printf("\"gige_1024x768\":{\"register_us\":%.1f,\"protocol_us\":%.1f,"
               "\"protocol_p99_us\":%.1f,\"trigger_to_frame_us\":%.1f,"
               "\"trigger_to_frame_p99_us\":%.1f,\"trigger_to_frame_ratio\":%.2f}",
               g->register_us, g->protocol_us, g->protocol_p99_us, g->driver_us, g->driver_p99_us,
               g->driver_us / g->protocol_us);
    else
        printf("gige, 1024 × 768 of 8 bits: a register %.0f µs, trigger to picture by the bare "
               "protocol %.0f µs, by the driver %.0f µs (%.2f)\n",
               g->register_us, g->protocol_us, g->driver_us, g->driver_us / g->protocol_us);
}

int main(int argc, char **argv) {
    setlocale(LC_CTYPE, "");
    gboolean json = argc > 1 && g_str_equal(argv[1], "--json");
    struct result tcp = measure(FALSE), rtu = measure(TRUE);
    struct gige_latency gige;
    gige_latency(1024, 768, &gige);
    if (json)
        putchar('{');
    print("tcp", &tcp, json);
    if (json)
        putchar(',');
    print("rtu", &rtu, json);
    if (json)
        putchar(',');
    print_gige(&gige, json);
    if (json)
        puts("}");
    return 0;
}
