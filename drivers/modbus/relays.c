#include "address.h"
#include "bus.h"
#include "devices.h"
#include "watchdog.h"

/* Shorter than the deadline of the class, so that the error of the line is reported. */
#define DEADLINE_MS 1500

/* Largest value of a timed pulse. Function 5 writes this value in the place of "on", which is
 * 0xff00, so the value must not be 0xff00. */
#define MAX_PULSE 0x7fff

/* Some relays of a board: the relays of a lamp bank, or the relay of a laser. */
struct relays {
    struct modbus_link link;
    struct modbus_watchdog watchdog;
    int first_coil, n;
    int pulse_coil; /* −1 if the relays stay as they are switched */
    double warm_up_s;

    const struct device *device;
    void (*lost)(gpointer device, GError *error);
    ModbusBus *bus;
    gboolean on[MODBUS_MAX_VALUES]; /* the board has confirmed "on", and no "off" was sent since */
    /* The relay should be off, and the board has not confirmed it. */
    gboolean off_due[MODBUS_MAX_VALUES];
    int n_switching, n_feeding; /* jobs without an answer yet */
    gint64 fed_us;              /* time of the last confirmed switch or feeding */
    guint timer;                /* runs while a relay with a watchdog is on */
};

#define RELAYS(name) G_STRUCT_OFFSET(struct relays, name)

#define PULSE_OPTION                                                                               \
    {                                                                                              \
        "pulse_coil", OPTION_INT, NULL, -1, 65535, "-1", NULL, RELAYS(pulse_coil),                 \
            "Address to which function 5 repeatedly writes the time for which the (first) relay "  \
            "stays on, watchdog_after_s × watchdog_scale; −1: the relay stays on until it is "  \
            "switched off"                                                                         \
    }

static GList *all_relays; /* all open relays, because sections may share a board */

static gboolean has_watchdog(const struct relays *relays) {
    return relays->watchdog.address >= 0 || relays->pulse_coil >= 0;
}

static gboolean any_on(const struct relays *relays) {
    for (int i = 0; i < relays->n; i++)
        if (relays->on[i])
            return TRUE;
    return FALSE;
}

static gboolean any_off_due(const struct relays *relays) {
    for (int i = 0; i < relays->n; i++)
        if (relays->off_due[i])
            return TRUE;
    return FALSE;
}

/* Returns the tag of a job that feeds the watchdog. The tag of a job that switches a relay is
 * the index of the relay, or n for all relays. */
static int feeding_tag(const struct relays *relays) {
    return relays->n + 1;
}

static void add_pulse(const struct relays *relays, struct modbus_job *job, int index) {
    struct modbus_request *request =
        modbus_job_add(job, MODBUS_PULSE_COIL, relays->pulse_coil + index, 1);
    request->values[0] = (guint16)modbus_watchdog_value(&relays->watchdog);
    request->coil = relays->first_coil + index;
    request->verify = TRUE;
}

/* Adds the request that switches relay index, or all of them with −1. */
static void add_switch(const struct relays *relays, struct modbus_job *job, int index,
                       gboolean on) {
    if (on && relays->pulse_coil >= 0) {
        add_pulse(relays, job, index);
        return;
    }
    struct modbus_request *request = modbus_job_add(
        job, MODBUS_WRITE_COILS, relays->first_coil + MAX(index, 0), index < 0 ? relays->n : 1);
    for (int i = 0; i < request->n; i++)
        request->values[i] = on != FALSE;
    request->verify = TRUE;
}

static void relays_feed(gpointer data);

static void feed_later(struct relays *relays) {
    Clock *clock = relays->device->clock;
    clock_cancel(clock, &relays->timer);
    if (has_watchdog(relays) && any_on(relays))
        relays->timer = clock_call_in(clock, modbus_watchdog_period_us(&relays->watchdog),
                                      relays_feed, (gpointer)relays->device);
}

static struct relays *relays_of(gpointer device) {
    return ((struct device *)device)->priv;
}

/* Takes the result of a feeding. After a failure, the next feeding tries again. If the board was
 * not reached for its watchdog time, or its answer is wrong, its relays may be off, and this is
 * reported. Call it last, because the listener may close the device. */
static void on_fed(const struct modbus_job *job, const GError *error, gpointer data) {
    struct relays *relays = relays_of(data);
    gint64 now = clock_now_us(relays->device->clock);
    double unheard_s = (double)(now - relays->fed_us) * 1e-6;
    relays->n_feeding--;
    if (job->skipped)
        return;
    if (!error)
        relays->fed_us = now;
    else if (any_on(relays) && (g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL) ||
                                unheard_s > modbus_watchdog_s(&relays->watchdog))) {
        GError *why = g_error_copy(error);
        g_prefix_error(&why, "may not be on any more: ");
        error_details_add_subject(&why, relays->device->who);
        for (int i = 0; i < relays->n; i++)
            if (relays->on[i]) {
                relays->on[i] = FALSE;
                relays->off_due[i] = TRUE;
            }
        /* Feeding stops here, so the watchdog switches the relays off even if the line is dead. */
        feed_later(relays);
        relays->lost((gpointer)relays->device, why);
    }
}

static void start_feeding(struct relays *relays, const struct modbus_job *job) {
    double deadline_ms =
        MIN(DEADLINE_MS, (double)modbus_watchdog_period_us(&relays->watchdog) / 1000);
    relays->n_feeding++;
    modbus_bus_start(relays->bus, &relays->link, job, MODBUS_COMMAND, deadline_ms, on_fed,
                     (gpointer)relays->device);
}

/* Feeds the watchdog. Checks the state of all relays first, because feeding must not switch a relay
 * on again that went off by itself. While a relay should be off but may be on, no relay is fed,
 * because only the watchdog may still be able to switch it off. */
static void relays_feed(gpointer data) {
    struct relays *relays = relays_of(data);
    struct modbus_job job = {0};
    relays->timer = 0;
    feed_later(relays);
    if (relays->n_switching > 0 || relays->n_feeding > 0 || any_off_due(relays))
        return;
    struct modbus_request *seen =
        modbus_job_add(&job, MODBUS_READ_COILS, relays->first_coil, relays->n);
    for (int i = 0; i < relays->n; i++)
        seen->values[i] = relays->on[i] != FALSE;
    seen->verify = TRUE;
    modbus_watchdog_add_check(&relays->watchdog, &job);
    job.tag = feeding_tag(relays);
    for (int i = 0; i < relays->n && relays->pulse_coil >= 0; i++) {
        if (relays->on[i] && job.n == MODBUS_MAX_REQUESTS) {
            start_feeding(relays, &job);
            job.n = 0;
        }
        if (relays->on[i])
            add_pulse(relays, &job, i);
    }
    start_feeding(relays, &job);
}

/* Switches relays. "Off" also drops the waiting jobs that would undo it: an "on" of the same
 * relays, and the feeding of the section's relays. */
static void relays_switch(struct relays *relays, int index, gboolean on, ModbusFunc func) {
    gpointer data = (gpointer)relays->device;
    struct modbus_job job = {.tag = index < 0 ? relays->n : index};
    add_switch(relays, &job, index, on);
    for (int i = 0; i < relays->n && !on; i++) {
        if (index >= 0 && i != index)
            continue;
        relays->on[i] = FALSE;
        relays->off_due[i] = TRUE;
        modbus_bus_skip(relays->bus, data, i);
    }
    if (!on)
        modbus_bus_skip(relays->bus, data, feeding_tag(relays));
    relays->n_switching++;
    modbus_bus_start(relays->bus, &relays->link, &job, on ? MODBUS_COMMAND : MODBUS_URGENT,
                     DEADLINE_MS, func, data);
}

static gboolean is_on_job(const struct modbus_job *job) {
    return job->requests[0].kind == MODBUS_PULSE_COIL || job->requests[0].values[0] != 0;
}

/* Takes the result of a switch. A relay whose "on" was not confirmed may be on. It is not fed until
 * its "off" was confirmed. */
static void switched(struct relays *relays, const struct modbus_job *job, gboolean failed) {
    const gboolean on = is_on_job(job);
    relays->n_switching--;
    for (int i = 0; i < relays->n && !job->skipped; i++) {
        if (job->tag < relays->n && i != job->tag)
            continue;
        relays->on[i] = on && !failed;
        relays->off_due[i] = failed;
    }
    if (!failed)
        relays->fed_us = clock_now_us(relays->device->clock);
    if (relays->timer == 0 || !any_on(relays))
        feed_later(relays);
}

static gboolean off(struct relays *relays, GError **error) {
    struct modbus_job job = {0};
    add_switch(relays, &job, -1, FALSE);
    return modbus_bus_do(relays->bus, &relays->link, &job, DEADLINE_MS, error);
}

/* Checks that all open sections of a board have the same watchdog register and time, because the
 * timeout of a board switches off the relays of all sections. */
static gboolean check_shared(const struct relays *relays, GError **error) {
    const struct config_section *section = relays->device->section;
    for (GList *l = all_relays; l; l = l->next) {
        const struct relays *other = l->data;
        if (other->bus != relays->bus || other->link.unit != relays->link.unit ||
            (other->watchdog.address == relays->watchdog.address &&
             (other->watchdog.address < 0 ||
              modbus_watchdog_value(&other->watchdog) == modbus_watchdog_value(&relays->watchdog))))
            continue;
        return config_set_error(error, CONFIG_ERROR_VALUE, section, "watchdog_register",
                                "[%s %s] has another watchdog for the same board; make "
                                "watchdog_register, watchdog_after_s and watchdog_scale the same",
                                other->device->info->class_name, other->device->name);
    }
    return TRUE;
}

static gboolean check_watchdog(const struct relays *relays, GError **error) {
    const struct config_section *section = relays->device->section;
    const int max = relays->pulse_coil >= 0 ? MAX_PULSE : G_MAXUINT16;
    g_autoptr(Mistakes) mistakes = mistakes_new();
    if (relays->pulse_coil >= 0 && relays->watchdog.address >= 0)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "pulse_coil",
                       "is given together with watchdog_register; leave one of them out");
    else if (has_watchdog(relays))
        modbus_watchdog_check(&relays->watchdog, &relays->link, section, max, mistakes);
    return mistakes_report(mistakes, error);
}

/* Checks the options of lamps and of a laser, which begin with struct relays. A wrong watchdog is
 * reported only when the relays are opened. If it were reported here, the relays would not be
 * opened, and relays that an earlier program has left on would stay on. */
static void relays_check(gconstpointer given, const struct config_section *section,
                         Mistakes *mistakes) {
    modbus_link_check(&((const struct relays *)given)->link, section, mistakes);
}

/* A laser has one relay. Its n is 0 until the laser is opened. */
static void relays_needs(gconstpointer given, GPtrArray *to) {
    const struct relays *relays = given;
    for (int i = 0; i < MAX(relays->n, 1); i++) {
        g_ptr_array_add(to, modbus_address_of("coil", relays->first_coil + i, relays->link.bus,
                                              relays->link.unit));
        if (relays->pulse_coil >= 0)
            g_ptr_array_add(to, modbus_address_of("coil", relays->pulse_coil + i, relays->link.bus,
                                                  relays->link.unit));
    }
}

static gboolean relays_open(struct relays *relays, const struct device *device,
                            void (*lost)(gpointer device, GError *error), GError **error) {
    relays->device = device;
    relays->lost = lost;
    relays->bus = modbus_bus_get(&relays->link, device, error);
    if (!relays->bus)
        return FALSE;
    /* Switch off first, even if the section has other mistakes. */
    if (off(relays, error) && check_watchdog(relays, error) && check_shared(relays, error) &&
        modbus_watchdog_arm(&relays->watchdog, relays->bus, &relays->link, error)) {
        all_relays = g_list_prepend(all_relays, relays);
        return TRUE;
    }
    if (error && (*error)->domain != CONFIG_ERROR)
        error_details_add_subject(error, device->who);
    g_clear_pointer(&relays->bus, modbus_bus_unref);
    return FALSE;
}

static void relays_close(struct relays *relays) {
    clock_cancel(relays->device->clock, &relays->timer);
    modbus_bus_cancel(relays->bus, (gpointer)relays->device);
    off(relays, NULL);
    all_relays = g_list_remove(all_relays, relays);
    g_clear_pointer(&relays->bus, modbus_bus_unref);
}

static const struct option lamps_options[] = {
    MODBUS_LINK_OPTIONS,
    {"first_coil", OPTION_INT, NULL, 0, 65535, "0", NULL, RELAYS(first_coil),
     "Coil of the bank's first lamp, counted from 0; the others follow"},
    {"n", OPTION_INT, NULL, 1, MODBUS_MAX_VALUES, NULL, NULL, RELAYS(n), "Number of lamps"},
    {"warm_up_s", OPTION_DOUBLE, "s", 0, 36000, "0", NULL, RELAYS(warm_up_s),
     "Time from switching on until the output is stable"},
    MODBUS_WATCHDOG_OPTIONS(RELAYS(watchdog)),
    PULSE_OPTION,
    {NULL},
};

static void relays_on_lamp(const struct modbus_job *job, const GError *error, gpointer data) {
    LampBank *bank = data;
    GError *failed = error ? g_error_copy(error) : NULL;
    switched(bank->device.priv, job, error != NULL);
    error_details_add_subject(&failed, bank->device.who);
    lamps_report(bank, job->tag < bank->n ? job->tag : -1, is_on_job(job), failed);
}

static gboolean set_lamp(LampBank *bank, int index, gboolean on, GError **error) {
    relays_switch(bank->device.priv, index, on, relays_on_lamp);
    return TRUE;
}

static void lost_lamps(gpointer device, GError *error) {
    lamps_lost(device, error);
}

static gboolean relays_open_lamps(LampBank *bank, GError **error) {
    struct relays *relays = bank->device.priv;
    bank->n = relays->n;
    bank->warm_up_s = relays->warm_up_s;
    if (has_watchdog(relays))
        bank->watchdog_s = modbus_watchdog_s(&relays->watchdog);
    return relays_open(relays, &bank->device, lost_lamps, error);
}

static void relays_close_lamps(LampBank *bank) {
    relays_close(bank->device.priv);
}

const struct lamps_driver modbus_relays_driver = {
    .info = {"lamps", "modbus-relays", "Lamps on the coils of a Modbus relay board", lamps_options,
             sizeof(struct relays), relays_check, relays_needs},
    .open = relays_open_lamps,
    .close = relays_close_lamps,
    .set = set_lamp,
};

static const struct option laser_options[] = {
    MODBUS_LINK_OPTIONS,
    {"coil", OPTION_INT, NULL, 0, 65535, "0", NULL, RELAYS(first_coil),
     "Coil that switches it, counted from 0"},
    {"warm_up_s", OPTION_DOUBLE, "s", 0, 36000, "0", NULL, RELAYS(warm_up_s),
     "Time from switching on until the output is stable"},
    MODBUS_WATCHDOG_OPTIONS(RELAYS(watchdog)),
    PULSE_OPTION,
    {NULL},
};

static void relays_on_laser(const struct modbus_job *job, const GError *error, gpointer data) {
    Laser *laser = data;
    GError *failed = error ? g_error_copy(error) : NULL;
    switched(laser->device.priv, job, error != NULL);
    error_details_add_subject(&failed, laser->device.who);
    laser_report(laser, is_on_job(job), failed);
}

static gboolean set_laser(Laser *laser, gboolean on, GError **error) {
    relays_switch(laser->device.priv, 0, on, relays_on_laser);
    return TRUE;
}

static void lost_laser(gpointer device, GError *error) {
    laser_lost(device, error);
}

static gboolean relays_open_laser(Laser *laser, GError **error) {
    struct relays *relays = laser->device.priv;
    relays->n = 1;
    laser->warm_up_s = relays->warm_up_s;
    if (has_watchdog(relays))
        laser->watchdog_s = modbus_watchdog_s(&relays->watchdog);
    return relays_open(relays, &laser->device, lost_laser, error);
}

static void relays_close_laser(Laser *laser) {
    relays_close(laser->device.priv);
}

const struct laser_driver modbus_laser_driver = {
    .info = {"laser", "modbus-laser", "A laser on a coil of a Modbus relay board", laser_options,
             sizeof(struct relays), relays_check, relays_needs},
    .open = relays_open_laser,
    .close = relays_close_laser,
    .set = set_laser,
};
