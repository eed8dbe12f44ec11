#include "bus.h"
#include "devices.h"

struct modbus_inputs {
    struct modbus_link link;
    int input;
    gboolean closed_when_off;
    double poll_ms, lost_ms;
    ModbusBus *bus;
    guint timer, lost;
};

#define FIELD(name) G_STRUCT_OFFSET(struct modbus_inputs, name)

static const struct option options[] = {
    MODBUS_LINK_OPTIONS,
    {"input", OPTION_INT, NULL, 0, 65535, "0", NULL, FIELD(input),
     "Discrete input that the contact is wired to, counted from 0"},
    {"closed_when_off", OPTION_BOOL, NULL, 0, 0, "no", NULL, FIELD(closed_when_off),
     "The contact is closed when the input reads 0; a broken wire then counts as closed"},
    {"poll_ms", OPTION_DOUBLE, "ms", 1, 1000, "20", NULL, FIELD(poll_ms), "Time between readings"},
    {"lost_ms", OPTION_DOUBLE, "ms", 50, 10000, "1500", NULL, FIELD(lost_ms),
     "Time without an answer after which the contact counts as open; a late answer takes "
     "timeout_ms + 2 late_ms"},
    {NULL},
};

static gboolean is_closed(const struct modbus_inputs *inputs, const struct modbus_job *job) {
    return (job->requests[0].values[0] != 0) != inputs->closed_when_off;
}

static void read_input(const struct modbus_inputs *inputs, struct modbus_job *job) {
    modbus_job_add(job, MODBUS_READ_INPUTS, inputs->input, 1);
}

static void on_read(const struct modbus_job *job, const GError *error, gpointer data);

static void inputs_on_timer(gpointer data) {
    Interlock *interlock = data;
    struct modbus_inputs *inputs = interlock->device.priv;
    struct modbus_job job = {0};
    inputs->timer = 0;
    read_input(inputs, &job);
    modbus_bus_start(inputs->bus, &inputs->link, &job, MODBUS_POLL, inputs->lost_ms, on_read,
                     interlock);
}

static void inputs_on_lost(gpointer data) {
    Interlock *interlock = data;
    ((struct modbus_inputs *)interlock->device.priv)->lost = 0;
    interlock_report_lost(interlock);
}

static void await(Interlock *interlock, gboolean answered) {
    struct modbus_inputs *inputs = interlock->device.priv;
    Clock *clock = interlock->device.clock;
    inputs->timer =
        clock_call_in(clock, (gint64)(inputs->poll_ms * 1000), inputs_on_timer, interlock);
    if (!answered)
        return;
    clock_cancel(clock, &inputs->lost);
    inputs->lost =
        clock_call_in(clock, (gint64)(inputs->lost_ms * 1000), inputs_on_lost, interlock);
}

static void on_read(const struct modbus_job *job, const GError *error, gpointer data) {
    Interlock *interlock = data;
    await(interlock, !error);
    if (error)
        interlock_report_lost(interlock);
    else
        interlock_report(interlock, is_closed(interlock->device.priv, job));
}

static void inputs_check(gconstpointer given, const struct config_section *section,
                         Mistakes *mistakes) {
    modbus_link_check(&((const struct modbus_inputs *)given)->link, section, mistakes);
}

static gboolean open_inputs(Interlock *interlock, GError **error) {
    struct modbus_inputs *inputs = interlock->device.priv;
    struct modbus_job job = {0};
    inputs->bus = modbus_bus_get(&inputs->link, &interlock->device, error);
    if (!inputs->bus)
        return FALSE;
    read_input(inputs, &job);
    if (!modbus_bus_do(inputs->bus, &inputs->link, &job, 1500, error)) {
        error_details_add_subject(error, interlock->device.who);
        g_clear_pointer(&inputs->bus, modbus_bus_unref);
        return FALSE;
    }
    await(interlock, TRUE);
    interlock_report(interlock, is_closed(inputs, &job));
    return TRUE;
}

static void close_inputs(Interlock *interlock) {
    struct modbus_inputs *inputs = interlock->device.priv;
    clock_cancel(interlock->device.clock, &inputs->timer);
    clock_cancel(interlock->device.clock, &inputs->lost);
    modbus_bus_cancel(inputs->bus, interlock);
    g_clear_pointer(&inputs->bus, modbus_bus_unref);
}

const struct interlock_driver modbus_inputs_driver = {
    .info = {"interlock", "modbus-inputs", "A contact on a discrete input of a Modbus board",
             options, sizeof(struct modbus_inputs), inputs_check},
    .open = open_inputs,
    .close = close_inputs,
};
