#include "axis_bench.h"

#include "ok.h"
#include "wait.h"

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    struct axis_bench *bench = data;
    if (event == AXIS_PASSING)
        return;
    bench->n++;
    bench->last = event;
    g_clear_error(&bench->error);
    bench->error = error ? g_error_copy(error) : NULL;
}

void axis_bench_begin(struct axis_bench *bench, const struct axis_driver *driver, Clock *clock,
                      const char *text, const char *keys) {
    const struct config_section *section;
    const struct conformance with = {.section = text};
    *bench = (struct axis_bench){.clock = clock};
    g_autoptr(Config) config = conformance_config(&with, keys, &section);
    bench->axis = ok(axis_open(driver, section, NULL, clock, ERR));
    axis_listen(bench->axis, on_axis, bench);
}

void axis_bench_end(struct axis_bench *bench) {
    g_clear_pointer(&bench->axis, axis_close);
    g_clear_pointer(&bench->clock, clock_unref);
    g_clear_error(&bench->error);
}

void axis_bench_expect(struct axis_bench *bench, enum axis_event event) {
    conformance_wait(bench->clock, &bench->n, 1, 60);
    if (event != AXIS_FAULT)
        g_assert_no_error(bench->error);
    g_assert_cmpint(bench->last, ==, event);
    bench->n = 0;
}

void axis_bench_home(struct axis_bench *bench) {
    ok(axis_home(bench->axis, ERR));
    axis_bench_expect(bench, AXIS_HOMED);
}

void axis_bench_move(struct axis_bench *bench, double deg) {
    ok(axis_move(bench->axis, deg, ERR));
    axis_bench_expect(bench, AXIS_ARRIVED);
}

void axis_bench_wait_safe(struct axis_bench *bench) {
    UNTIL (axis_safety(bench->axis) == DEVICE_SAFE)
        conformance_pass(bench->clock, 0.01);
}
